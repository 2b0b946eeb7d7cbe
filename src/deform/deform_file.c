// SPDX-License-Identifier: Apache-2.0
#include "src/deform/deform_file.h"

#include <string.h>

#define KIND    "MOTN"
#define VERSION 1

uint64_t sv_deform_model_digest(const sv_gaussians *g) {
  uint64_t h = 14695981039346656037ull; // FNV-1a over the used slots: the file of a model has no others
  for (int i = 0; i < g->n; i++)
    for (int r = 0; r < g->n_rows; r++) {
      uint32_t b;
      memcpy(&b, sv_gaussians_at(g, i, r), 4);
      for (int k = 0; k < 4; k++) h = (h ^ (b >> (8 * k) & 255)) * 1099511628211ull;
    }
  return h;
}

static size_t moving_bytes(int n_moving, int n_rows) {
  return (size_t)((n_moving + 15) / 16) * 16 * (size_t)n_rows * sizeof(float);
}

sv_status sv_deform_write(const sv_deform *d, const sv_gaussians *g, sv_sink sink, sv_err *err) {
  const sv_motion_cfg *c = &d->motion.cfg;
  sv_sections_writer w;
  sv_deform_head h;
  memset(&h, 0, sizeof h); // padding, too, goes to the file
  h.kind = (int32_t)d->kind, h.n_gaussians = g->n, h.n_moving = d->motion.n_moving;
  h.functions = (int32_t)c->functions, h.n_pos = c->n_pos, h.n_rot = c->n_rot, h.n_colour = c->n_colour;
  h.t0 = c->t0, h.model_digest = sv_deform_model_digest(g);
  sv_status s = sv_sections_begin(&w, sink, KIND, VERSION, err);
  if (s >= 0) s = sv_sections_put(&w, "HEAD", &h, sizeof h, err);
  if (s >= 0)
    s = sv_sections_put(&w, "ROWS", d->motion.param, moving_bytes(d->motion.n_moving, d->motion.n_rows), err);
  return s >= 0 ? sv_sections_end(&w, err) : s;
}

static bool is_count(int32_t n) { return n >= 0 && n <= SV_CAP_MOTION_FUNCTIONS; }

sv_status sv_deform_open(sv_sections *r, sv_deform_head *h, const char *name, const void *buf, size_t bytes,
                         sv_err *err) {
  sv_status s = sv_sections_open(r, name, buf, bytes, KIND, VERSION, err);
  if (s >= 0) s = sv_sections_get(r, "HEAD", h, sizeof *h, err);
  if (s < 0) return s;
  if (h->kind != SV_DEFORM_CLIP)
    return sv_fail(err, SV_E_UNSUPPORTED, "%s: a motion of kind %d, which this program does not know", name,
                   h->kind);
  if (h->n_moving < 0 || h->n_moving > h->n_gaussians || !is_count(h->n_pos) || !is_count(h->n_rot) ||
      !is_count(h->n_colour) || h->functions < SV_MOTION_CHEBYSHEV || h->functions > SV_MOTION_POWERS ||
      !(h->t0 >= -1e9f && h->t0 <= 1e9f))
    return sv_fail(err, SV_E_FORMAT, "%s: its head has numbers that no motion has", name);
  return SV_OK;
}

sv_status sv_deform_read(sv_deform *d, const sv_sections *r, const sv_deform_head *h, const sv_gaussians *g,
                         sv_arena *arena, sv_err *err) {
  if (h->n_gaussians != g->n || h->model_digest != sv_deform_model_digest(g))
    return sv_fail(err, SV_E_RANGE, "%s: belongs to another model of %d Gaussians, not to this one of %d",
                   r->name, h->n_gaussians, g->n);
  sv_motion_cfg c = {.functions = (sv_motion_functions_kind)h->functions,
                     .n_pos = h->n_pos,
                     .n_rot = h->n_rot,
                     .n_colour = h->n_colour,
                     .t0 = h->t0};
  memset(d, 0, sizeof *d);
  d->kind = (sv_deform_kind)h->kind;
  sv_status s = sv_motion_init(&d->motion, &c, g, arena);
  if (s < 0) return sv_fail(err, s, "%s: no memory for its motion", r->name);
  sv_motion_reset(&d->motion, 0);
  d->motion.n_moving = h->n_moving;
  return sv_sections_get(r, "ROWS", d->motion.param, moving_bytes(h->n_moving, d->motion.n_rows), err);
}
