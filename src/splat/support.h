// SPDX-License-Identifier: Apache-2.0
// Support of a model: which views saw each Gaussian, and the largest angle between two of them.
// Found by one pass over the views, and by no state of training.
// Owns a word for each Gaussian and the weights of the view at work, carved at init. Never renders.
//
// A view saw a Gaussian when the sum of its weights a T over the pixels is at least a quarter of
// what it would be with nothing in front (T = 1) and all of it inside of the image: that is, when
// a quarter of it is visible. In closed form, with c = 1/255 under which alpha is not evaluated:
//   sum of alpha = 2 pi sqrt(det S2) (o - c),    S2 the covariance on the screen, o the opacity.
#ifndef SV_SPLAT_SUPPORT_H
#define SV_SPLAT_SUPPORT_H

#include "src/splat/render.h"

#ifdef __cplusplus
extern "C" {
#endif

#define SV_SUPPORT_VIEWS 64    // that are asked, at most: of more, so many spread evenly
#define SV_SUPPORT_SHARE 0.25f // of a Gaussian that is visible when a view saw it
// Angle between two views from which on what both saw is well supported.
#define SV_SUPPORT_DEG 5.0

typedef struct {
  int n;          // Gaussians
  int n_views;    // that were asked
  uint64_t *seen; // [n] bit v: view v saw it
  // [n] of the view at work: sum of a T, and what it would be with T = 1
  float *weight, *alone;
  float *block; // [n_threads] scratch of a block of 16 Gaussians
  float eye[SV_SUPPORT_VIEWS][3];
  int32_t exposure[SV_SUPPORT_VIEWS];
} sv_support;

size_t sv_support_bytes(int n_gaussians, int n_threads);
sv_status sv_support_init(sv_support *s, int n_gaussians, int n_threads, sv_arena *arena) SV_MUST_USE;

// Which of n views is asked k-th, k below sv_support_n_asked(n).
int sv_support_n_asked(int n_views);
int sv_support_asked(int n_views, int k);

// Image planes of the caller for one image of the renderer: zero is 0, one is 1 in the image and 0
// in its padding.
typedef struct {
  sv_planes *zero; // set and cleared by sv_support_add
  float *one;      // the same
} sv_support_planes;

// For each view: begin, add for each rendering of it or of a part of it, end. r has gradients, and
// rendered all Gaussians over any background. exposure: views of one instant share it; below 0: the
// view is of an instant of its own.
void sv_support_begin(sv_support *s, const sv_view *view, int exposure);
sv_status sv_support_add(sv_support *s, sv_renderer *r, const sv_support_planes *p) SV_MUST_USE;
void sv_support_end(sv_support *s);

typedef struct {
  int n_views, n_exposures; // that saw it
  double angle_deg;         // the largest between two of the views, as seen from it
} sv_support_value;

sv_support_value sv_support_of(const sv_support *s, const sv_gaussians *g, int i);
// 0 to 1: how well it is supported, 1 from SV_SUPPORT_DEG on.
double sv_support_score(const sv_support_value *v);

// Of the Gaussians that are not nearly transparent (opacity 0.05 and more).
typedef struct {
  int n_views;             // that were asked
  double unseen, one_view; // shares
  double angle_deg;        // mean
  double supported;        // mean score
} sv_support_summary;
sv_support_summary sv_support_sum_up(const sv_support *s, const sv_gaussians *g);

#ifdef __cplusplus
}
#endif
#endif
