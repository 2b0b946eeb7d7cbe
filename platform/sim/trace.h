// SPDX-License-Identifier: Apache-2.0
// The ray caster. A shot is one scene at one time seen by one view, a pinhole or a fisheye: prepare
// it once, then render any ranges of rows from any number of threads; the ranges cannot change a
// bit.
// One visibility sample a pixel, shaded with a texture filtered to the pixel's footprint; pixels on
// an edge of a surface or of a shadow, or near a part only a few pixels wide, take 16 visibility
// samples and shade each surface among them once.
#ifndef SV_SIM_TRACE_H
#define SV_SIM_TRACE_H

#include <stdbool.h>
#include <stdint.h>

#include "platform/sim/scene.h"
#include "src/rig/rig.h"

#ifdef __cplusplus
extern "C" {
#endif

#define SV_SIM_GRID 32 // cells a side of the shadow grid

// One primitive as the view sees it. Local frame: the primitive's own axes, metres.
typedef struct {
  float m[9], o[3];               // local_from_cam: x_local = o + m x_cam, o is the camera's centre
  float sun[3], up[3];            // unit, local
  float half[3];                  // size_m
  float wide[3];                  // size grown by about a pixel, for parts that are only a few
                                  // pixels wide
  float texture_origin[3];        // cells; differs between primitives
  int x0_px, x1_px, y0_px, y1_px; // conservative bounds, x1 and y1 exclusive; empty when not
                                  // visible
  float near_m;                   // no point of it has a smaller depth
  float sunward_m;                // no point of it lies further towards the sun (grid_w)
  bool is_fine;
} sv_sim_seen;

typedef struct {
  const sv_sim_scene *scene;
  sv_view view;
  // Of a fisheye, through a place on its lens: that place over the distance that is sharp, by which
  // rays lean towards the axis. 0 after prepare.
  float lean[2];
  int n_prims;
  uint8_t order[SV_SIM_CAP_PRIMS]; // visible primitives, nearest first
  int n_order;
  sv_sim_seen seen[SV_SIM_CAP_PRIMS];
  // The plane across the sun's rays: which primitives can shade a cell. Rows (u, v) act on x_cam.
  float grid_u[4], grid_v[4]; // cell coordinate = row . (x, y, z, 1)
  float grid_w[4];            // metres towards the sun
  uint64_t grid[SV_SIM_GRID * SV_SIM_GRID];
} sv_sim_shot;

// Where a rendered run of pixels goes: n pixels from (x, y), rgb linear light [n][3], depth in
// metres [n]: camera z, of a fisheye the distance; 0 = background.
typedef struct {
  void *self;
  void (*put)(void *self, int x_px, int y_px, int n, const float *rgb, const float *depth_m);
} sv_sim_sink;

void sv_sim_shot_prepare(sv_sim_shot *shot, const sv_sim_scene *scene, const sv_view *view, double time_s);

// Rows y0 <= y < y1 of the view. The shot is only read.
void sv_sim_shot_rows(const sv_sim_shot *shot, int y0, int y1, const sv_sim_sink *sink);

#ifdef __cplusplus
}
#endif
#endif
