// SPDX-License-Identifier: Apache-2.0
// Gaussians, views and binned tiles for the checks of the splatting kernels. All memory is the
// case's (ck_bytes): it goes at the next ck_begin.
#ifndef SV_TESTS_KERNELS_SPLAT_SCENE_H
#define SV_TESTS_KERNELS_SPLAT_SCENE_H

#include "tests/kernels/check.h"

typedef enum {
  SC_TYPICAL, // what training holds: a unit cloud before the camera
  SC_OPAQUE,  // large and nearly opaque: pixels end early
  SC_EDGE,    // beyond the frustum limits, at, on and behind the near plane and the camera plane
  // opacities 1e-6..1-1e-7, log-scales -20..8, quaternions near 0, huge and denormal values
  SC_HOSTILE,
  SC_N_KINDS
} sc_kind;
const char *sc_name(int kind);

typedef struct {
  sv_project_args project; // with results of the reference
  int n_blocks, n_tiles_x, n_tiles, n_rows;
  uint32_t n_visible, n_intersections, n_listed;
  uint32_t *order;               // [n_visible] front to back
  sv_intersection *intersection; // [n_intersections + SV_BIN_SLACK]
  uint32_t *list;                // [n_listed] intersections by tile, front to back
  uint32_t *tile_begin;          // [n_tiles + 1]
} sc_scene;

typedef struct {
  int n_gaussians, sh_rows, sh_used, width_px, height_px, kind;
  bool is_antialiased;
  bool has_dropout; // some are left out, the others more opaque
  bool is_fisheye;  // 185 degrees across the diagonal
} sc_cfg;

// Parameters and view; splats and keys are buffers with nothing in them.
void sc_init(ck *c, sc_scene *s, const sc_cfg *cfg);
// The reference's projection, intersections and lists of the same.
void sc_project(ck *c, sc_scene *s);
float *sc_scratch(void); // working memory for project and project_bwd
void sc_bin(ck *c, sc_scene *s);

// A copy of n bytes in the case's memory.
void *sc_copy(ck *c, const void *p, size_t n);
double sc_largest(const float *p, size_t n); // magnitude

#endif
