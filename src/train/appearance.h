// SPDX-License-Identifier: Apache-2.0
// Appearance: what each camera makes of the scene's light, learned with the Gaussians, so that
// differences between cameras and exposures do not end up in the scene. In linear light, per camera
// an affine color transform and a radial falloff, per exposure a 3x3 color transform:
//   out = f(r^2) E (C x + c)                                    (kernels/appearance/appearance.h)
// by Adam, pulled towards where they start (appearance_start.h). The transforms of camera 0 (its
// falloff apart) and of exposure 0 are the identity: the model has the reference camera's colors.
//
// Views with deep pictures (src/image/deep.h) are compared as their sensor counts light: in linear
// light, times the shutter time, through the noise curve (kernels/color/color.h), where all values
// have the same noise. So residuals weigh what the noise lets them, and L1 and D-SSIM stay as they
// are. The model's colors are those of the first exposure, display values that may exceed 1.
// Owns the groups and one rendered image. Never changes what is exported, and knows no sensors
// whose lens images overlap.
#ifndef SV_TRAIN_APPEARANCE_H
#define SV_TRAIN_APPEARANCE_H

#include <stdint.h>

#include "src/port/compute.h"
#include "src/base/arena.h"
#include "src/image/planes.h"
#include "src/rig/rig.h"

#ifdef __cplusplus
extern "C" {
#endif

typedef struct sv_trainer sv_trainer;
typedef struct sv_train_cfg sv_train_cfg;

#define SV_APPEARANCE_ROWS    12 // of a thread's scratch
#define SV_APPEARANCE_UNKNOWN 1.0

typedef struct {
  int n_cameras;   // Cameras with a transform and a falloff of their own. Default 0: no appearance.
  int n_exposures; // Exposures with a transform of their own. Default 0: they are all alike.
  // Adam's steps at the start, of cameras' matrices, offsets and falloffs, and of exposures.
  // Defaults 0.002, 0.0002, 0.0005 and 0.002. Offsets are small: black levels that are off, and
  // stray light.
  float lr_camera, lr_offset, lr_falloff, lr_exposure;
  float decay; // What is left of both at the end, log-linear. Default 0.03.
  float pull;  // Weight of half the squared distance from the start in the loss. Default 1e-3.
} sv_appearance_cfg;

typedef struct {
  double p[SV_APPEARANCE_SUMS];                        // M row-major, b, k
  double start[SV_APPEARANCE_SUMS];                    // where p is pulled to
  double m[SV_APPEARANCE_SUMS], v[SV_APPEARANCE_SUMS]; // Adam's moments
  uint32_t n_steps;
} sv_appearance_group;

typedef struct {
  sv_appearance_group *camera, *exposure; // [n_cameras], [n_exposures]
  // [n_cameras] What the start measured (appearance_start.h), r as of the falloff here; not known
  // where it did not. A falloff_sigma of SV_APPEARANCE_UNKNOWN: not estimated, taken as none.
  sv_photometry *measured;
  int32_t *camera_of, *exposure_of; // [cap_views]; -1: a view without
  sv_planes image;                  // the rendering as the camera shows it
  float *row_sum;                   // [cap rows][SV_APPEARANCE_SUMS]
  float *scratch;                   // [n_threads][SV_APPEARANCE_ROWS][cap_stride]
  int cap_stride;
} sv_appearance;

sv_appearance_cfg sv_appearance_defaults(void);
// Takes its memory, for images of so many floats a plane; a dry arena only counts.
void sv_appearance_carve(sv_appearance *a, const sv_train_cfg *cfg, size_t cap_floats, sv_arena *arena);
void sv_appearance_reset(sv_appearance *a, const sv_appearance_cfg *cfg);
// View i_view, added before, is of these groups; -1: of none.
void sv_train_set_appearance(sv_trainer *t, int i_view, int i_camera, int i_exposure);
// Whether a view has one.
bool sv_train_has_appearance(const sv_trainer *t, int i_view);
// Whether its rendering is compared as its camera shows it: with appearance, or deep.
bool sv_train_is_shown(const sv_trainer *t, int i_view);
// A rendering x of a view, at any scale, as its camera shows it, compared with t->target, which has
// the same size. Valid until the next call; x itself for views without appearance.
const sv_planes *sv_train_appear(sv_trainer *t, int i_view, const sv_view *view, const sv_planes *x);
// t->grad, dL/d(what the camera shows), becomes dL/dx; then the view's groups move. x as before.
void sv_train_appear_bwd(sv_trainer *t, int i_view, const sv_planes *x, const sv_view *view, float progress);
// Of a deep view: a probe (curvature.h) of what the camera shows becomes one of x. After
// sv_train_appear_bwd.
void sv_train_appear_probe(sv_trainer *t, int i_view, const sv_planes *x, const sv_view *view,
                           sv_planes *probe);
// From sums [SV_APPEARANCE_SUMS] of the product's gradients to those of camera and exposure, whose
// parameters are given: d_camera[12], d_exposure[9].
void sv_appearance_share(const double *sum, const double *camera, const double *exposure, double *d_camera,
                         double *d_exposure);
// The transform of a view (M, b, k).
void sv_train_appearance_of(const sv_trainer *t, int i_view, double out[SV_APPEARANCE_SUMS]);

#ifdef __cplusplus
}
#endif
#endif
