// SPDX-License-Identifier: Apache-2.0
#include "src/dynamic/dynamic.h"

#include "src/base/mathx.h"

#define CAP_FIELD_TIMES 150 // the most of the reference's configurations

// A field does not extrapolate to new times as per-Gaussian motion does. So in long runs its
// temporal curriculum is slower, but the last FIELD_SETTLE_STEPS steps train on all times.
#define FIELD_SETTLE_STEPS 900.0f
#define FIELD_GROW_LEAST   0.4f
#define FIELD_GROW_MOST    0.7f
// And a short run cannot afford to slow down as much: the last rates of a field are for so many
// steps.
#define FIELD_STEPS 3000.0f

// Points along time for each that there is, of a field that a clip tells what is between them.
#define CLIP_TIMES 2

sv_dynamic_cfg sv_dynamic_defaults(void) {
  sv_dynamic_cfg c = {.from = 0.1f,
                      .distil_at = 0.8f,
                      .fit = 0.22f,
                      .distilled = 0.25f,
                      .find_every = 0.04f,
                      .find_until = 0.6f,
                      .grow_start = 0.02f,
                      .grow_until = 0.5f,
                      .coarse_for = 0.1f,
                      .front_every = 2,
                      .n_bodies = SV_CAP_BODIES - 1,
                      .lr_body = 7.0f,
                      .shrink_pos = 0.1f,
                      .share_min = 0.2f,
                      .min_scale = 1,
                      .keep_hidden = 8,
                      .window_start = 0.4f,
                      .residual_min = 0.01f,
                      .n_pos = 6,
                      .n_rot = 3,
                      .n_colour = 1,
                      .lr_pos = 3.0f,
                      .lr_rot = 6e-4f,
                      .lr_colour = 6e-4f,
                      .lr_window = 0.01f,
                      .reg_pos = 0.01f,
                      .reg_rot = 1e-3f,
                      .reg_colour = 1e-3f,
                      .static_px = 0.25f,
                      .static_fade = 0.1f,
                      .static_colour = 0.01f};
  (void)sv_field_preset("medium", &c.field);
  return c;
}

bool sv_dynamic_has_clip(const sv_dynamic_cfg *c) {
  return c->kind == SV_DEFORM_CLIP || (c->kind == SV_DEFORM_FIELD && c->distil_at > 0);
}

bool sv_dynamic_has_bodies(const sv_dynamic_cfg *c) {
  return sv_dynamic_has_clip(c) && c->grow_until > 0 && c->n_bodies > 0 &&
         c->functions == SV_MOTION_CHEBYSHEV;
}

void sv_dynamic_set_times(sv_dynamic_cfg *d, int expected_steps, int n_times) {
  d->n_pos = sv_clampi(n_times / 3, 1, 8);
  d->n_rot = sv_maxi(1, d->n_pos / 2);
  d->n_colour = sv_maxi(1, d->n_pos / 2);
  d->window_start = sv_maxf(0.4f, 3.0f / (float)sv_maxi(n_times, 1));
  d->field.n_times = sv_clampi(n_times, 4, CAP_FIELD_TIMES);
  if (d->kind == SV_DEFORM_FIELD && d->distil_at > 0) {
    d->field.n_times = sv_clampi(CLIP_TIMES * n_times, 4, CAP_FIELD_TIMES);
    return;
  }
  if (d->kind != SV_DEFORM_FIELD || expected_steps < 1) return;
  d->grow_until =
      sv_clampf(1.0f - FIELD_SETTLE_STEPS / (float)expected_steps, FIELD_GROW_LEAST, FIELD_GROW_MOST);
  d->find_until = sv_maxf(d->find_until, d->grow_until);
  sv_field_cfg *f = &d->field;
  const float pace = FIELD_STEPS / (float)expected_steps;
  f->lr_planes_end = sv_minf(f->lr_planes, pace * f->lr_planes_end);
  f->lr_layers_end = sv_minf(f->lr_layers, pace * f->lr_layers_end);
}
