// SPDX-License-Identifier: Apache-2.0
#include "src/deform/deform_file.h"

#include <float.h>
#include <math.h>
#include <stddef.h>
#include <string.h>

#define KIND           "MOTN"
#define VERSION        1 // as every reader knows
#define VERSION_BODIES 2
#define HEAD_BYTES     offsetof(sv_deform_head, n_bodies)
#define MAX_POSITION   1e9f  // larger coordinates are damage
#define MAX_TIME       1e6f  // a clip lasts from 0 to 1
#define MIN_SPAN       1e-9f // between knots: where they are closer, cubics overflow

typedef struct {
  int32_t n_bodies, n_knots;
  float centre[SV_CAP_BODIES][3]; // n_bodies go to the file
} bodies_head;

uint64_t sv_deform_model_digest(const sv_gaussians *g) {
  // FNV-1a over the Gaussians in use: the model's file has no others
  uint64_t h = 14695981039346656037ull;
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

static void head_of(const sv_deform *d, const sv_gaussians *g, sv_deform_head *h) {
  const sv_motion_cfg *c = &d->motion.cfg;
  const sv_field_cfg *f = &d->field.cfg;
  memset(h, 0, sizeof *h); // padding, too, goes to the file
  h->kind = (int32_t)d->kind;
  h->n_gaussians = g->n;
  h->n_moving = sv_deform_n_moving(d);
  h->functions = (int32_t)c->functions;
  h->n_pos = c->n_pos;
  h->n_rot = c->n_rot;
  h->n_colour = c->n_colour;
  h->t0 = c->t0;
  h->n_channels = f->n_channels;
  h->n_levels = f->n_levels;
  for (int l = 0; l < f->n_levels; l++) h->mult[l] = f->mult[l];
  h->base = f->base;
  h->n_times = f->n_times;
  h->width = f->width;
  h->is_shared = f->is_shared;
  h->has_colour = f->has_colour;
  memcpy(h->lo, d->field.lo, sizeof h->lo);
  memcpy(h->inv, d->field.inv, sizeof h->inv);
  h->model_digest = sv_deform_model_digest(g);
}

static const void *rows_of(const sv_deform *d, size_t *bytes) {
  if (d->kind == SV_DEFORM_FIELD) {
    *bytes = d->field.n_param * sizeof(float);
    return d->field.param;
  }
  *bytes = moving_bytes(d->motion.n_moving, d->motion.n_rows);
  return d->motion.param;
}

static bool has_bodies(const sv_deform *d) { return sv_deform_bodies(d)->n > 1; }

static size_t bodies_head_bytes(int n_bodies) {
  return offsetof(bodies_head, centre) + (size_t)n_bodies * 3 * sizeof(float);
}

static sv_status write_bodies(const sv_deform *d, sv_sections_writer *w, sv_err *err) {
  const sv_bodies *b = sv_deform_bodies(d);
  bodies_head h = {.n_bodies = b->n, .n_knots = b->n_knots};
  memcpy(h.centre, b->centre, (size_t)b->n * sizeof *h.centre);
  const size_t row = (size_t)b->n_knots * sizeof(sv_rigid);
  sv_status s = sv_sections_put(w, "BODY", &h, bodies_head_bytes(b->n), err);
  if (s >= 0) s = sv_sections_put(w, "TIME", b->time, (size_t)b->n_knots * sizeof *b->time, err);
  if (s >= 0) s = sv_sections_section_begin(w, "KNOT", (uint64_t)b->n * row, err);
  for (int i = 0; i < b->n && s >= 0; i++) s = sv_sections_write(w, sv_bodies_knot(b, i, 0), row, err);
  if (s >= 0) s = sv_sections_section_end(w, err);
  return s >= 0 ? sv_sections_put(w, "OF  ", b->of, (size_t)sv_deform_n_moving(d), err) : s;
}

static size_t first_infinite(const float *x, size_t n) {
  size_t i = 0;
  while (i < n && fabsf(x[i]) <= FLT_MAX) i++;
  return i;
}

sv_status sv_deform_write(const sv_deform *d, const sv_gaussians *g, sv_sink sink, sv_err *err) {
  sv_sections_writer w;
  sv_deform_head h;
  size_t bytes;
  const void *rows = rows_of(d, &bytes);
  head_of(d, g, &h);
  if (first_infinite(rows, bytes / sizeof(float)) < bytes / sizeof(float))
    return sv_fail(err, SV_E_RANGE,
                   "the motion is not saved: a value is not finite; check the scene's bounds, the poses and "
                   "the lens models of the source");
  sv_status s = sv_sections_begin(&w, sink, KIND, has_bodies(d) ? VERSION_BODIES : VERSION, err);
  if (s >= 0) s = sv_sections_put(&w, "HEAD", &h, HEAD_BYTES, err);
  if (s >= 0) s = sv_sections_put(&w, "ROWS", rows, bytes, err);
  if (s >= 0 && has_bodies(d)) s = write_bodies(d, &w, err);
  return s >= 0 ? sv_sections_end(&w, err) : s;
}

static bool is_count(int32_t n) { return n >= 0 && n <= SV_CAP_MOTION_FUNCTIONS; }

static bool is_good_clip(const sv_deform_head *h) {
  return is_count(h->n_pos) && is_count(h->n_rot) && is_count(h->n_colour) &&
         (h->functions == SV_MOTION_CHEBYSHEV || h->functions == SV_MOTION_POWERS) && h->t0 >= -1e9f &&
         h->t0 <= 1e9f;
}

// the sizes themselves are checked where they are used
static bool is_good_field(const sv_deform_head *h) {
  for (int l = 0; l < SV_FIELD_CAP_LEVELS; l++)
    if (h->mult[l] < (l < h->n_levels) || h->mult[l] > 16) return false;
  for (int k = 0; k < 3; k++)
    if (!(h->lo[k] >= -1e30f && h->lo[k] <= 1e30f && h->inv[k] > 0 && h->inv[k] <= 1e30f)) return false;
  return true;
}

static bool is_measured(const float *x, int n) {
  for (int k = 0; k < n; k++)
    if (!(x[k] >= -MAX_POSITION && x[k] <= MAX_POSITION)) return false;
  return true;
}

// How many bodies and knots, before there is memory for them.
static sv_status find_bodies(const sv_sections *r, bodies_head *b, sv_err *err) {
  const void *data;
  size_t bytes;
  sv_status s = sv_sections_find(r, "BODY", &data, &bytes, err);
  if (s < 0) return s;
  memset(b, 0, sizeof *b);
  memcpy(b, data, sizeof *b < bytes ? sizeof *b : bytes);
  if (b->n_bodies < 2 || b->n_bodies > SV_CAP_BODIES || b->n_knots < 1 || b->n_knots > SV_CAP_KNOTS ||
      bytes != bodies_head_bytes(b->n_bodies) || !is_measured(*b->centre, 3 * b->n_bodies))
    return sv_fail(err, SV_E_FORMAT,
                   "%s: section \"BODY\" has numbers that no bodies have (2 to %d of them, 1 to %d knots)",
                   r->name, SV_CAP_BODIES, SV_CAP_KNOTS);
  return SV_OK;
}

sv_status sv_deform_open(sv_deform_file *f, const sv_file_data *file, sv_err *err) {
  const char *name = file->name;
  sv_sections *r = &f->sections;
  sv_deform_head *h = &f->head;
  sv_status s = sv_sections_open(r, file, KIND, VERSION_BODIES, err);
  memset(h, 0, sizeof *h);
  if (s >= 0) s = sv_sections_get(r, "HEAD", h, HEAD_BYTES, err);
  if (s < 0) return s;
  if (h->kind != SV_DEFORM_CLIP && h->kind != SV_DEFORM_FIELD)
    return sv_fail(err, SV_E_UNSUPPORTED, "%s: a motion of kind %d, which this program does not know", name,
                   h->kind);
  if (h->n_moving < 0 || h->n_moving > h->n_gaussians ||
      !(h->kind == SV_DEFORM_CLIP ? is_good_clip(h) : is_good_field(h)))
    return sv_fail(err, SV_E_FORMAT, "%s: its head has numbers that no motion has", name);
  if (r->version < VERSION_BODIES) return SV_OK;
  bodies_head b;
  if ((s = find_bodies(r, &b, err)) < 0) return s;
  h->n_bodies = b.n_bodies;
  h->n_knots = b.n_knots;
  return SV_OK;
}

sv_status sv_deform_carve(sv_deform *d, const sv_deform_head *h, const sv_gaussians *g, int n_threads,
                          sv_arena *arena) {
  memset(d, 0, sizeof *d);
  d->kind = (sv_deform_kind)h->kind;
  if (d->kind == SV_DEFORM_CLIP) {
    sv_motion_cfg c = {.functions = (sv_motion_functions_kind)h->functions,
                       .n_pos = h->n_pos,
                       .n_rot = h->n_rot,
                       .n_colour = h->n_colour,
                       .t0 = h->t0,
                       .cap_knots = h->n_knots};
    return sv_motion_init(&d->motion, &c, g, arena);
  }
  sv_field_cfg c = {.n_channels = h->n_channels,
                    .n_levels = h->n_levels,
                    .base = h->base,
                    .n_times = h->n_times,
                    .width = h->width,
                    .is_shared = h->is_shared != 0,
                    .has_colour = h->has_colour != 0,
                    .n_threads = n_threads,
                    .cap_knots = h->n_knots};
  for (int l = 0; l < SV_FIELD_CAP_LEVELS; l++) c.mult[l] = h->mult[l];
  return sv_field_init(&d->field, &c, g, arena);
}

static bool is_motion(const sv_rigid *m) {
  float n2 = m->q[0] * m->q[0] + m->q[1] * m->q[1] + m->q[2] * m->q[2] + m->q[3] * m->q[3];
  return n2 > 0.99f && n2 < 1.01f && is_measured(m->d, 3);
}

// As of a model's PLY: what was exported from it would be refused elsewhere.
static sv_status check_rows(const float *x, size_t n, const char *name, sv_err *err) {
  const size_t i = first_infinite(x, n);
  return i == n ? SV_OK
                : sv_fail(err, SV_E_FORMAT, "%s: value %zu of section \"ROWS\" is not finite", name, i);
}

static sv_status check_bodies(const sv_bodies *b, int n_moving, const char *name, sv_err *err) {
  for (int i = 0; i < b->n_knots; i++)
    if (!(fabsf(b->time[i]) < MAX_TIME) || (i && !(b->time[i] - b->time[i - 1] > MIN_SPAN)))
      return sv_fail(err, SV_E_FORMAT, "%s: knot %d of its bodies is not later than the one before", name, i);
  for (int i = 0; i < b->n * b->n_knots; i++)
    if (!is_motion(sv_bodies_knot(b, i / b->n_knots, i % b->n_knots)))
      return sv_fail(err, SV_E_FORMAT, "%s: knot %d of body %d is no rigid motion", name, i % b->n_knots,
                     i / b->n_knots);
  for (int i = 0; i < n_moving; i++)
    if (b->of[i] >= b->n)
      return sv_fail(err, SV_E_FORMAT, "%s: Gaussian %d is of body %d, there are %d", name, i, b->of[i],
                     b->n);
  return SV_OK;
}

static sv_status read_bodies(sv_deform *d, int cap, const sv_sections *r, sv_err *err) {
  const int n_moving = sv_deform_n_moving(d);
  sv_bodies *b = sv_deform_bodies(d); // its rows are as long as the file's: cap_knots is n_knots
  bodies_head bh;
  sv_status s = find_bodies(r, &bh, err);
  if (s < 0) return s;
  sv_bodies_reset(b, cap);
  memcpy(b->centre, bh.centre, sizeof bh.centre);
  s = sv_sections_get(r, "TIME", b->time, (size_t)bh.n_knots * sizeof *b->time, err);
  if (s >= 0)
    s = sv_sections_get(r, "KNOT", b->knot, (size_t)(bh.n_bodies * bh.n_knots) * sizeof *b->knot, err);
  if (s >= 0) s = sv_sections_get(r, "OF  ", b->of, (size_t)n_moving, err);
  if (s < 0) return s;
  b->n = bh.n_bodies;
  b->n_knots = bh.n_knots;
  if ((s = check_bodies(b, n_moving, r->name, err)) < 0) sv_bodies_reset(b, cap);
  return s;
}

sv_status sv_deform_read(sv_deform *d, const sv_deform_file *f, const sv_gaussians *g, int n_threads,
                         sv_arena *arena, sv_err *err) {
  const sv_sections *r = &f->sections;
  const sv_deform_head *h = &f->head;
  size_t bytes;
  if (h->n_gaussians != g->n || h->model_digest != sv_deform_model_digest(g))
    return sv_fail(err, SV_E_RANGE, "%s: belongs to another model of %d Gaussians, not to this one of %d",
                   r->name, h->n_gaussians, g->n);
  sv_status s = sv_deform_carve(d, h, g, n_threads, arena);
  if (s < 0) return sv_fail(err, s, "%s: its sizes cannot be held", r->name);
  if (d->kind == SV_DEFORM_CLIP) sv_motion_reset(&d->motion, 0);
  memcpy(d->field.lo, h->lo, sizeof h->lo);
  memcpy(d->field.inv, h->inv, sizeof h->inv);
  sv_deform_set_moving(d, h->n_moving);
  void *rows = (void *)(uintptr_t)rows_of(d, &bytes);
  s = sv_sections_get(r, "ROWS", rows, bytes, err);
  if (s >= 0) s = check_rows(rows, bytes / sizeof(float), r->name, err);
  return s >= 0 && h->n_bodies ? read_bodies(d, g->cap, r, err) : s;
}
