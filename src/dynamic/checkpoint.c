// SPDX-License-Identifier: Apache-2.0
#include "src/dynamic/checkpoint.h"

#include <string.h>

#include "src/dynamic/distil.h"

static size_t rows_bytes(const sv_trainer *t) {
  return (size_t)t->g.cap * (size_t)t->g.n_rows * sizeof(float);
}

// The motion's parameters and Adam's moments of them.
typedef struct {
  float *param;
  uint16_t *m, *v;
  size_t n;
} motion_state;

static size_t motion_bytes(motion_state s) { return s.n * (sizeof *s.param + sizeof *s.m + sizeof *s.v); }

static motion_state field_of(const sv_dynamic *dyn) {
  const sv_field *f = &dyn->deform.field;
  return (motion_state){f->param, f->m, f->v, f->n_param};
}

// Sections MOTN, MOTM, MOTV: the clip's, or a field's that has none.
static motion_state motion_of(const sv_dynamic *dyn) {
  const sv_motion *mo = &dyn->deform.motion;
  if (!sv_dynamic_has_clip(&dyn->cfg)) return field_of(dyn);
  return (motion_state){mo->param, mo->m, mo->v, (size_t)mo->cap * (size_t)mo->n_rows};
}

// Sections FLDN, FLDM, FLDV: of a field that begins with a clip.
static bool has_both(const sv_dynamic *dyn) {
  return dyn->cfg.kind == SV_DEFORM_FIELD && sv_dynamic_has_clip(&dyn->cfg);
}

// Rigid bodies: their number and sizes; then BTIM, BKNO, BADM, and BSLO, the body of each Gaussian.
// FSLO is that of a distilled field.
typedef struct {
  int32_t n, n_knots, cap_knots;
  float centre[SV_CAP_BODIES][3], radius[SV_CAP_BODIES];
} bodies_head;

static size_t knots_of(const sv_bodies *b) { return (size_t)SV_CAP_BODIES * (size_t)b->cap_knots; }

static size_t bodies_bytes(const sv_dynamic *dyn) {
  const sv_bodies *b = &dyn->deform.motion.bodies;
  if (!b->of) return 0;
  return 6 * 40 + sizeof(bodies_head) + (size_t)b->cap_knots * sizeof(float) +
         knots_of(b) * (sizeof *b->knot + sizeof *b->adam) + (has_both(dyn) ? 2 : 1) * (size_t)dyn->t->g.cap;
}

static sv_status put_bodies(sv_sections_writer *w, const sv_dynamic *dyn, sv_err *err) {
  const sv_bodies *b = &dyn->deform.motion.bodies;
  bodies_head h = {.n = b->n, .n_knots = b->n_knots, .cap_knots = b->cap_knots};
  memcpy(h.centre, b->centre, sizeof h.centre);
  memcpy(h.radius, b->radius, sizeof h.radius);
  sv_status s = sv_sections_put(w, "BODY", &h, sizeof h, err);
  if (s >= 0) s = sv_sections_put(w, "BTIM", b->time, (size_t)b->cap_knots * sizeof(float), err);
  if (s >= 0) s = sv_sections_put(w, "BKNO", b->knot, knots_of(b) * sizeof *b->knot, err);
  if (s >= 0) s = sv_sections_put(w, "BADM", b->adam, knots_of(b) * sizeof *b->adam, err);
  if (s >= 0) s = sv_sections_put(w, "BSLO", b->of, (size_t)dyn->t->g.cap, err);
  if (s < 0 || !sv_distil_is_on(dyn)) return s;
  return sv_sections_put(w, "FSLO", dyn->deform.field.bodies.of, (size_t)dyn->t->g.cap, err);
}

// The body of each Gaussian, of n bodies.
static sv_status get_members(const sv_sections *r, const char *name, uint8_t *of, int cap, int n,
                             sv_err *err) {
  sv_status s = sv_sections_get(r, name, of, (size_t)cap, err);
  for (int i = 0; i < cap && s >= 0; i++)
    if (of[i] >= n)
      s = sv_fail(err, SV_E_FORMAT, "%s: Gaussian %d belongs to rigid body %d of %d", r->name, i, of[i],
                  n - 1);
  return s;
}

static sv_status get_bodies(const sv_sections *r, sv_dynamic *dyn, bool is_distilled, sv_err *err) {
  const int cap = dyn->t->g.cap;
  sv_bodies *b = &dyn->deform.motion.bodies, *of_field = &dyn->deform.field.bodies;
  bodies_head h;
  sv_status s = sv_sections_get(r, "BODY", &h, sizeof h, err);
  if (s < 0) return s;
  if (h.cap_knots != b->cap_knots || h.n_knots < 0 || h.n_knots > h.cap_knots || h.n < 1 ||
      h.n > SV_CAP_BODIES)
    return sv_fail(err, SV_E_FORMAT, "%s: %d rigid bodies at %d of %d times, expected at most %d at %d",
                   r->name, h.n - 1, h.n_knots, h.cap_knots, SV_CAP_BODIES - 1, b->cap_knots);
  s = sv_sections_get(r, "BTIM", b->time, (size_t)b->cap_knots * sizeof(float), err);
  if (s >= 0) s = sv_sections_get(r, "BKNO", b->knot, knots_of(b) * sizeof *b->knot, err);
  if (s >= 0) s = sv_sections_get(r, "BADM", b->adam, knots_of(b) * sizeof *b->adam, err);
  if (s >= 0) s = get_members(r, "BSLO", b->of, cap, h.n, err);
  if (s < 0) return s;
  b->n = h.n;
  b->n_knots = h.n_knots;
  memcpy(b->centre, h.centre, sizeof h.centre);
  memcpy(b->radius, h.radius, sizeof h.radius);
  if (!is_distilled) return SV_OK;
  sv_bodies_copy(of_field, b, cap, cap);
  return get_members(r, "FSLO", of_field->of, cap, h.n, err);
}

static const char *const of_motion[3] = {"MOTN", "MOTM", "MOTV"};
static const char *const of_field[3] = {"FLDN", "FLDM", "FLDV"};

static sv_status put_state(sv_sections_writer *w, const char *const name[3], motion_state o, sv_err *err) {
  sv_status s = sv_sections_put(w, name[0], o.param, o.n * sizeof *o.param, err);
  if (s >= 0) s = sv_sections_put(w, name[1], o.m, o.n * sizeof *o.m, err);
  return s >= 0 ? sv_sections_put(w, name[2], o.v, o.n * sizeof *o.v, err) : s;
}

static sv_status put_motion(sv_sections_writer *w, const sv_dynamic *dyn, sv_err *err) {
  sv_status s = put_state(w, of_motion, motion_of(dyn), err);
  if (s >= 0 && has_both(dyn)) s = put_state(w, of_field, field_of(dyn), err);
  if (s >= 0 && sv_distil_is_on(dyn))
    s = sv_sections_put(w, "TEAC", dyn->distilled.param, rows_bytes(dyn->t), err);
  if (s >= 0) s = sv_sections_put(w, "MOVE", dyn->is_moving, (size_t)dyn->t->g.cap, err);
  return s >= 0 && bodies_bytes(dyn) ? put_bodies(w, dyn, err) : s;
}

static sv_status get_state(const sv_sections *r, const char *const name[3], motion_state o, sv_err *err) {
  sv_status s = sv_sections_get(r, name[0], o.param, o.n * sizeof *o.param, err);
  if (s >= 0) s = sv_sections_get(r, name[1], o.m, o.n * sizeof *o.m, err);
  return s >= 0 ? sv_sections_get(r, name[2], o.v, o.n * sizeof *o.v, err) : s;
}

static sv_status get_motion(const sv_sections *r, sv_dynamic *dyn, bool is_distilled, sv_err *err) {
  sv_status s = get_state(r, of_motion, motion_of(dyn), err);
  if (s >= 0 && has_both(dyn)) s = get_state(r, of_field, field_of(dyn), err);
  if (s >= 0 && is_distilled) s = sv_sections_get(r, "TEAC", dyn->distilled.param, rows_bytes(dyn->t), err);
  if (s >= 0) s = sv_sections_get(r, "MOVE", dyn->is_moving, (size_t)dyn->t->g.cap, err);
  return s >= 0 && bodies_bytes(dyn) ? get_bodies(r, dyn, is_distilled, err) : s;
}

size_t sv_dynamic_checkpoint_bytes(const void *self) {
  const sv_dynamic *dyn = self;
  return motion_bytes(motion_of(dyn)) +
         (has_both(dyn) ? motion_bytes(field_of(dyn)) + rows_bytes(dyn->t) : 0) + bodies_bytes(dyn) +
         (size_t)dyn->t->g.cap;
}

void sv_dynamic_save_head(const void *self, sv_checkpoint_motion *h) {
  const sv_dynamic *dyn = self;
  *h = (sv_checkpoint_motion){.kind = (int32_t)dyn->deform.kind,
                              .n_moving = sv_deform_n_moving(&dyn->deform),
                              .next_search = dyn->next_search,
                              .matched_until = dyn->matched_until,
                              .field_step = dyn->field_step,
                              .fit_steps_left = dyn->fit_steps_left};
  memcpy(h->lo, dyn->deform.field.lo, sizeof h->lo);
  memcpy(h->inv, dyn->deform.field.inv, sizeof h->inv);
}

sv_status sv_dynamic_save(const void *self, sv_sections_writer *w, sv_err *err) {
  return put_motion(w, self, err);
}

bool sv_dynamic_is_loadable(const void *self, const sv_checkpoint_motion *h) {
  const sv_dynamic *dyn = self;
  return h->kind == (int)dyn->cfg.kind || (has_both(dyn) && h->kind == SV_DEFORM_CLIP);
}

sv_status sv_dynamic_load(void *self, const sv_sections *r, const sv_checkpoint_motion *h, sv_err *err) {
  sv_dynamic *dyn = self;
  sv_status s = get_motion(r, dyn, has_both(dyn) && h->kind == SV_DEFORM_FIELD, err);
  if (s < 0) return s;
  dyn->deform.kind = (sv_deform_kind)h->kind;
  sv_deform_set_moving(&dyn->deform, h->n_moving);
  dyn->next_search = h->next_search;
  dyn->matched_until = h->matched_until;
  dyn->field_step = h->field_step;
  dyn->fit_steps_left = h->fit_steps_left;
  if (dyn->deform.kind == SV_DEFORM_FIELD) {
    memcpy(dyn->deform.field.lo, h->lo, sizeof h->lo);
    memcpy(dyn->deform.field.inv, h->inv, sizeof h->inv);
  }
  return SV_OK;
}
