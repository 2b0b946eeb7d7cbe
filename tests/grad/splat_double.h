// SPDX-License-Identifier: Apache-2.0
// A renderer in double precision, written from the formulas of the literature and not from the
// kernels: EWA projection with clamped ratios, exact exponentials, no tiles, no bounds. The judge
// of values and, by central differences, of gradients.
#ifndef SV_TESTS_GRAD_SPLAT_DOUBLE_H
#define SV_TESTS_GRAD_SPLAT_DOUBLE_H

#include <stdbool.h>

#include "calib/model.h"

#define DR_CAP_GAUSSIANS 160
#define DR_N_PARAMS      59 // mean 3, quaternion wxyz 4, log-scale 3, logit, SH [16][3]

typedef struct {
  int width_px, height_px;
  double fx, fy, cx, cy; // first pixel's centre at 0.5
  double r[9], t[3];     // cam_from_world before the twist
  double twist[6];       // (omega, v), applied from the left
  double near_z, bg[3];
  bool is_antialiased;
  int sh_degree;
  const sv_camera_model *fisheye; // NULL: a pinhole
} dr_view;

typedef struct {
  int n;
  double p[DR_CAP_GAUSSIANS][DR_N_PARAMS];
  bool is_dropped[DR_CAP_GAUSSIANS];
  double gain; // of the others' opacities
  dr_view view;
} dr_scene;

// What lies behind the Gaussian that takes a pixel's light below 1e-4, in terms of that light:
// gradients take it for given.
typedef struct {
  double rgb[3], depth, trans;
} dr_rest;

// Planes without padding, [height][width]; any may be NULL.
typedef struct {
  double *rgb[3], *depth, *trans;
  double *margin; // smallest relative distance of a contribution to the 1/255 skip, or of the light
                  // to 1e-4
  dr_rest *rest;
  int *n_low; // pixels of a transmittance below 1e-4
} dr_picture;

typedef struct {
  bool is_drawn;     // in front of the near plane and above 1/255 at its peak
  double peak_alpha; // largest alpha at any pixel, before the clamp
  double err;        // sum over pixels of weight x err, where the light is not low
  double weight;     // sum over them of weight
} dr_share;

// err: [height][width] or NULL; share: [n] or NULL.
void dr_render(const dr_scene *s, const dr_picture *out, const double *err, dr_share *share);

// Sum over pixels of w_rgb . rgb + w_depth depth + w_trans trans; planes as above, NULL counts as
// 0.
typedef struct {
  double *rgb[3], *depth, *trans;
  const dr_rest *rest; // as dr_render left it
} dr_weights;
double dr_loss(const dr_scene *s, const dr_weights *w);

#endif
