// SPDX-License-Identifier: Apache-2.0
// Depth maps from the pictures that are trained on, where their views overlap: plane sweep (Collins
// 1996, "A space-sweep approach to true multi-image matching") with zero-mean normalised
// cross-correlation over 5x5 pixels, and a check from the other side. For starting Gaussians; needs
// no rectification, so any views with known poses do: sub-views of one exposure, of different focal
// lengths, or neighbouring pictures of one camera.
#ifndef SV_TRAIN_SWEEP_H
#define SV_TRAIN_SWEEP_H

#include "kernels/kernels.h"
#include "src/rig/bounds.h"
#include "src/train/train.h"

#ifdef __cplusplus
extern "C" {
#endif

#define SV_SWEEP_CAP_VIEWS  32 // views that get a depth map
#define SV_SWEEP_CAP_PLANES 128
#define SV_SWEEP_CAP_PX     48000 // of a map: more points than Gaussians are not needed

typedef struct {
  int i_view;                                  // of the trainer's views
  int k;                                       // its picture is reduced so many times
  sv_view view;                                // reduced
  int n_sources, source[SV_SWEEP_CAP_SOURCES]; // other maps
  float w0, dw;          // inverse depth of the first plane (farthest), and from one to the next
  float w_reach, w_near; // those of the first and the last plane of a scene that ends
  int n_planes;
  uint16_t *grey; // [height][width] luma x 256
  uint16_t *code; // [height][width] 0: not measured, else 1 + 256 x (plane of the surface)
  int n_measured;
} sv_depth_map;

typedef struct {
  sv_depth_map *map; // [SV_SWEEP_CAP_VIEWS], in the scratch
  int n;
  bool is_open; // the scene does not end: much of it is far behind the bounds
} sv_sweep;

// Scratch that sv_sweep_run takes for views of these sizes; 0: there are no two views.
size_t sv_sweep_bytes(const sv_train_cfg *cfg);
// Depth maps of up to SV_SWEEP_CAP_VIEWS of the trainer's views; of a moving scene, of those at
// its middle time. More views than that are taken as groups of neighbours from all sides. The
// planes reach from the near side of `bounds` to far behind it, or to infinity if the scene does
// not end. A map has at most cap_px pixels, of up to SV_SWEEP_CAP_PX. The maps lie in scratch,
// which the caller resets. AGAIN: no two views see the same.
sv_status sv_sweep_run(sv_sweep *s, const sv_trainer *t, const sv_bounds *bounds, int cap_px,
                       sv_arena *scratch) SV_MUST_USE;
// Depth along the optical axis at an inverse depth; at most that of the plane before infinity, as
// what is farther does not shift.
float sv_sweep_distance(const sv_depth_map *m, float inverse);
// Depth along the optical axis, world units; 0: not measured.
float sv_sweep_depth(const sv_depth_map *m, int x, int y);

#ifdef __cplusplus
}
#endif
#endif
