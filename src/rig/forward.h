// SPDX-License-Identifier: Apache-2.0
// The forward model: from sub-views to the measurement of one sensor, and its adjoint (the paper,
// sections 3.1 and 3.2). Owns planes for one region of the sensor, and scratch per thread.
// Never renders: the caller brings the rendered crops.
//
// direct, light field: each sub-view has its own sensor pixels, so its image is its measurement and
// the model is the identity. The trainer supervises these images directly, without this model.
// multiplexed: the lens images overlap, and their sum is measured:
//   y(x) = encode( (1 / M_max) sum_m w_m(x) decode(I_m(x)) ),  M_max = max_x sum_m w_m(x)
// with the footprints w_m. Light adds linearly, so decode is the sRGB curve and encode its inverse;
// measurements made by adding display values use neither. The adjoint is
//   dL/dI_m(x) = w_m(x) / M_max decode'(I_m(x)) encode'(s(x)) dL/dy(x)
//
// Sensor noise may be added to the prediction, as in the authors' simulator: after the sum, in the
// measurement's encoding, y + (read + shot y) n with fresh n ~ N(0, 1), rounded to 14 bits.
// Gradients pass through it unchanged.
//
// A measurement that was computed may be known over other backgrounds, too, by the sum of what its
// lenses see through, sum_m w_m (1 - alpha_m). A background's light, times the transmittance T_m of
// each rendering, is then added to the sum:
//   s(x) = sum_m w_m(x) (decode(I_m(x)) + backdrop T_m(x))
//   dL/dT_m(x) = w_m(x) / M_max encode'(s(x)) backdrop . dL/dy(x)
//
// Work is done per region of the sensor: only the parts of lens images inside it are rendered, so
// cost and memory depend on the region and the overlap, not on the number of lenses.
#ifndef SV_RIG_FORWARD_H
#define SV_RIG_FORWARD_H

#include "src/image/planes.h"
#include "src/port/compute.h"
#include "src/rig/rig.h"

#ifdef __cplusplus
extern "C" {
#endif

// One lens image: pixel (i, j) of the view falls on sensor pixel (x0_px + i, y0_px + j) of the
// footprint, which has the view's size.
typedef struct {
  sv_view view;
  sv_footprint footprint;
} sv_lens;

typedef struct {
  int width_px, height_px; // of the sensor
  int n_lenses;
  const sv_lens *lenses; // [n_lenses]
  float max_overlap;     // largest sum of footprints of any pixel, > 0
  bool is_linear;        // linear light is added; false: display values
} sv_multiplexed;

// M_max of lenses on a sensor; 0 when no lens lights it. O(pixels of all footprints).
float sv_multiplexed_max_overlap(const sv_lens *lenses, int n_lenses, int width_px, int height_px,
                                 float *row);
// E_RANGE with a sentence: a footprint outside of the sensor or of another size than its view, or
// nothing lit.
sv_status sv_multiplexed_check(const sv_multiplexed *c, sv_err *err) SV_MUST_USE;

typedef struct {
  int x0, y0, x1, y1; // columns [x0, x1), rows [y0, y1) of the sensor
} sv_region;

// The part of one lens image in a region.
typedef struct {
  const sv_lens *lens;
  sv_view view;       // a window of the lens's view
  int x_px, y_px;     // its corner in the region
  int lens_x, lens_y; // and in the lens image
} sv_crop;

// False when the lens image does not overlap the region.
bool sv_multiplexed_crop(const sv_multiplexed *c, int i_lens, const sv_region *region, sv_crop *out);

typedef struct {
  int cap_width_px, cap_height_px; // of a region
  int n_threads;                   // of the pool that will be used
} sv_forward_cfg;

// Standard deviations (src/image/noise.h has variances). Off when both are 0.
typedef struct {
  float read, shot;
  uint32_t key; // other keys give independent noise
} sv_forward_noise;

typedef struct {
  sv_forward_cfg cfg;
  sv_compute compute;
  sv_planes sum;          // weighted sum; after finish: encode'(s) / M_max
  sv_planes predicted;    // the measurement, set by finish
  sv_forward_noise noise; // the caller's; off after init
  // Light of a background beside that of the renderings, R G B. The caller's; 0 after init.
  float backdrop[3];
  float *scratch; // [n_threads][2][cap stride]
} sv_forward;

size_t sv_forward_bytes(const sv_forward_cfg *cfg);
sv_status sv_forward_init(sv_forward *f, const sv_forward_cfg *cfg, sv_compute compute,
                          sv_arena *arena) SV_MUST_USE;

// begin, add for each crop, finish: fills f->predicted. rgb is the crop's rendering, trans its
// transmittance with rgb's stride; NULL without a backdrop.
sv_status sv_forward_begin(sv_forward *f, const sv_region *region) SV_MUST_USE;
void sv_forward_add(sv_forward *f, const sv_multiplexed *c, const sv_crop *crop, const sv_planes *rgb,
                    const float *trans);
void sv_forward_finish(sv_forward *f, const sv_multiplexed *c);

// Gradients of a region and of one of its crops. The errors may be NULL together.
typedef struct {
  const sv_planes *predicted; // dL/dpredicted
  const float *err;           // a weight per pixel of the region
  sv_planes *rgb;             // out: dL/drgb
  float *rgb_err;             // out: the crop's share of err
  float *trans;               // out: dL/dtrans, of a backdrop; or NULL
} sv_forward_grad;
// After finish. The outputs have the rendering's stride and zero padding.
void sv_forward_bwd(const sv_forward *f, const sv_multiplexed *c, const sv_crop *crop, const sv_planes *rgb,
                    const sv_forward_grad *grad);

#ifdef __cplusplus
}
#endif
#endif
