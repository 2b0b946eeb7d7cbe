// SPDX-License-Identifier: Apache-2.0
#include "src/train/checkpoint.h"

#include <string.h>

#include "src/dynamic/distil.h"

typedef struct {
  int32_t n, sh_degree, n_items, i_order;
  uint32_t step, n_relocated;
  uint64_t rng_state, rng_inc;
  float centre[3], radius, jitter[2];
  int32_t deform_kind, n_moving; // 0 for still scenes
  float find_at, followed, lo[3], inv[3];
  uint32_t field_step, fit_left, optimizer, unused;
  double trained_s;
  uint64_t seed, origin; // of the run: another one has another order of views, or other pictures
} head_t;

static int n_items(const sv_trainer *t) { return t->n_views + t->n_regions; }

static size_t rows_bytes(const sv_trainer *t) {
  return (size_t)t->g.cap * (size_t)t->g.n_rows * sizeof(float);
}

// Section FLOR. A trainer that is planned only has no memory yet.
static size_t floors_bytes(const sv_trainer *t) {
  return t->cfg.floor_px > 0.0f ? (size_t)t->g.cap * sizeof *t->floor : 0;
}

static size_t moments_bytes(const sv_trainer *t) { return rows_bytes(t) / sizeof(float) * sizeof *t->m; }

// The motion's parameters and Adam's moments of them.
typedef struct {
  float *param;
  uint16_t *m, *v;
  size_t n;
} motion_state;

static size_t motion_bytes(motion_state s) { return s.n * (sizeof *s.param + sizeof *s.m + sizeof *s.v); }

static motion_state field_of(const sv_trainer *t) {
  const sv_field *f = &t->deform.field;
  return (motion_state){f->param, f->m, f->v, f->n_param};
}

// Sections MOTN, MOTM, MOTV: the clip's, or a field's that has none.
static motion_state motion_of(const sv_trainer *t) {
  const sv_motion *mo = &t->deform.motion;
  if (!sv_train_is_dynamic(t)) return (motion_state){0};
  if (!sv_train_has_clip(&t->cfg)) return field_of(t);
  return (motion_state){mo->param, mo->m, mo->v, (size_t)mo->cap * (size_t)mo->n_rows};
}

// Sections FLDN, FLDM, FLDV: of a field that begins with a clip.
static bool has_both(const sv_trainer *t) {
  return t->cfg.dynamic.kind == SV_DEFORM_FIELD && sv_train_has_clip(&t->cfg);
}

// Rigid bodies: their number and sizes; then BTIM, BKNO, BADM, BSLO.
typedef struct {
  int32_t n, n_knots, cap_knots;
  float centre[SV_CAP_BODIES][3], radius[SV_CAP_BODIES];
} bodies_head;

static size_t knots_of(const sv_bodies *b) { return (size_t)SV_CAP_BODIES * (size_t)b->cap_knots; }

static size_t bodies_bytes(const sv_trainer *t) {
  const sv_bodies *b = &t->deform.motion.bodies;
  if (!b->of) return 0;
  return 5 * 40 + sizeof(bodies_head) + (size_t)b->cap_knots * sizeof(float) +
         knots_of(b) * (sizeof *b->knot + sizeof *b->adam) + (size_t)t->g.cap;
}

static sv_status put_bodies(sv_sections_writer *w, const sv_trainer *t, sv_err *err) {
  const sv_bodies *b = &t->deform.motion.bodies;
  bodies_head h = {.n = b->n, .n_knots = b->n_knots, .cap_knots = b->cap_knots};
  memcpy(h.centre, b->centre, sizeof h.centre);
  memcpy(h.radius, b->radius, sizeof h.radius);
  sv_status s = sv_sections_put(w, "BODY", &h, sizeof h, err);
  if (s >= 0) s = sv_sections_put(w, "BTIM", b->time, (size_t)b->cap_knots * sizeof(float), err);
  if (s >= 0) s = sv_sections_put(w, "BKNO", b->knot, knots_of(b) * sizeof *b->knot, err);
  if (s >= 0) s = sv_sections_put(w, "BADM", b->adam, knots_of(b) * sizeof *b->adam, err);
  return s >= 0 ? sv_sections_put(w, "BSLO", b->of, (size_t)t->g.cap, err) : s;
}

static sv_status get_bodies(const sv_sections *r, sv_trainer *t, sv_err *err) {
  sv_bodies *b = &t->deform.motion.bodies;
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
  if (s >= 0) s = sv_sections_get(r, "BSLO", b->of, (size_t)t->g.cap, err);
  for (int i = 0; i < t->g.cap && s >= 0; i++)
    if (b->of[i] >= h.n)
      s = sv_fail(err, SV_E_FORMAT, "%s: Gaussian %d belongs to rigid body %d of %d", r->name, i, b->of[i],
                  h.n - 1);
  if (s < 0) return s;
  b->n = h.n, b->n_knots = h.n_knots;
  memcpy(b->centre, h.centre, sizeof h.centre);
  memcpy(b->radius, h.radius, sizeof h.radius);
  return SV_OK;
}

static const char *const of_motion[3] = {"MOTN", "MOTM", "MOTV"};
static const char *const of_field[3] = {"FLDN", "FLDM", "FLDV"};

static sv_status put_state(sv_sections_writer *w, const char *const name[3], motion_state o, sv_err *err) {
  sv_status s = sv_sections_put(w, name[0], o.param, o.n * sizeof *o.param, err);
  if (s >= 0) s = sv_sections_put(w, name[1], o.m, o.n * sizeof *o.m, err);
  return s >= 0 ? sv_sections_put(w, name[2], o.v, o.n * sizeof *o.v, err) : s;
}

static sv_status put_motion(sv_sections_writer *w, const sv_trainer *t, sv_err *err) {
  sv_status s = put_state(w, of_motion, motion_of(t), err);
  if (s >= 0 && has_both(t)) s = put_state(w, of_field, field_of(t), err);
  if (s >= 0 && sv_train_is_taught(t)) s = sv_sections_put(w, "TEAC", t->teacher.param, rows_bytes(t), err);
  if (s >= 0) s = sv_sections_put(w, "MOVE", t->is_moving, (size_t)t->g.cap, err);
  return s >= 0 && bodies_bytes(t) ? put_bodies(w, t, err) : s;
}

static sv_status get_state(const sv_sections *r, const char *const name[3], motion_state o, sv_err *err) {
  sv_status s = sv_sections_get(r, name[0], o.param, o.n * sizeof *o.param, err);
  if (s >= 0) s = sv_sections_get(r, name[1], o.m, o.n * sizeof *o.m, err);
  return s >= 0 ? sv_sections_get(r, name[2], o.v, o.n * sizeof *o.v, err) : s;
}

static sv_status get_motion(const sv_sections *r, sv_trainer *t, bool is_taught, sv_err *err) {
  sv_status s = get_state(r, of_motion, motion_of(t), err);
  if (s >= 0 && has_both(t)) s = get_state(r, of_field, field_of(t), err);
  if (s >= 0 && is_taught) s = sv_sections_get(r, "TEAC", t->teacher.param, rows_bytes(t), err);
  if (s >= 0) s = sv_sections_get(r, "MOVE", t->is_moving, (size_t)t->g.cap, err);
  return s >= 0 && bodies_bytes(t) ? get_bodies(r, t, err) : s;
}

size_t sv_checkpoint_bytes(const sv_trainer *t) {
  return SV_SECTIONS_OVERHEAD_BYTES + 15 * 40 + floors_bytes(t) + motion_bytes(motion_of(t)) +
         (has_both(t) ? motion_bytes(field_of(t)) + rows_bytes(t) : 0) + bodies_bytes(t) + (size_t)t->g.cap +
         sizeof(head_t) + rows_bytes(t) + 2 * moments_bytes(t) + (size_t)t->g.cap * sizeof(float) +
         (size_t)(t->cfg.cap_views + t->cfg.cap_regions) * sizeof(int);
}

sv_status sv_checkpoint_write(const sv_trainer *t, sv_sink sink, sv_err *err) {
  head_t h;
  sv_sections_writer w;
  memset(&h, 0, sizeof h);
  h.n = t->g.n, h.sh_degree = t->g.sh_degree, h.n_items = n_items(t), h.i_order = t->i_order;
  h.step = t->step, h.n_relocated = t->n_relocated;
  h.rng_state = t->rng.state, h.rng_inc = t->rng.inc;
  memcpy(h.centre, t->centre, sizeof h.centre);
  memcpy(h.jitter, t->jitter, sizeof h.jitter);
  h.radius = t->radius;
  h.trained_s = t->trained_s;
  h.seed = t->cfg.seed, h.origin = t->origin;
  h.optimizer = (uint32_t)t->cfg.optimizer;
  if (sv_train_is_dynamic(t)) {
    h.deform_kind = (int32_t)t->deform.kind, h.n_moving = sv_deform_n_moving(&t->deform);
    h.find_at = t->find_at, h.followed = t->followed, h.field_step = t->field_step;
    h.fit_left = t->fit_left;
    memcpy(h.lo, t->deform.field.lo, sizeof h.lo);
    memcpy(h.inv, t->deform.field.inv, sizeof h.inv);
  }
  sv_status s = sv_sections_begin(&w, sink, SV_CHECKPOINT_KIND, SV_CHECKPOINT_VERSION, err);
  if (s >= 0) s = sv_sections_put(&w, "HEAD", &h, sizeof h, err);
  if (s >= 0) s = sv_sections_put(&w, "GAUS", t->g.param, rows_bytes(t), err);
  if (s >= 0) s = sv_sections_put(&w, "ADAM", t->m, moments_bytes(t), err);
  if (s >= 0) s = sv_sections_put(&w, "ADAV", t->v, moments_bytes(t), err);
  if (s >= 0) s = sv_sections_put(&w, "ERRS", t->err, (size_t)t->g.cap * sizeof(float), err);
  if (s >= 0) s = sv_sections_put(&w, "ORDR", t->order, (size_t)n_items(t) * sizeof(int), err);
  if (s >= 0 && t->floor) s = sv_sections_put(&w, "FLOR", t->floor, floors_bytes(t), err);
  if (s >= 0 && sv_train_is_dynamic(t)) s = put_motion(&w, t, err);
  return s >= 0 ? sv_sections_end(&w, err) : s;
}

static sv_status check_order(const sv_sections *r, int n, sv_err *err) {
  const void *data;
  size_t bytes;
  sv_status s = sv_sections_find(r, "ORDR", &data, &bytes, err);
  if (s < 0) return s;
  if (bytes != (size_t)n * sizeof(int))
    return sv_fail(err, SV_E_FORMAT, "%s: the order of views has another size", r->name);
  for (int i = 0; i < n; i++) {
    int v;
    memcpy(&v, (const char *)data + (size_t)i * sizeof v, sizeof v);
    if (v < 0 || v >= n)
      return sv_fail(err, SV_E_FORMAT, "%s: the order of views names view %d of %d", r->name, v, n);
  }
  return SV_OK;
}

// Pictures of two scenes in one model, or a sequence of random numbers that is no run's, are worse than no resume.
static sv_status check_run(const head_t *h, const sv_trainer *t, const char *name, sv_err *err) {
  if (h->origin != t->origin)
    return sv_fail(err, SV_E_RANGE,
                   "%s: made by a run of another source; give the same --source, or another --out", name);
  if (h->seed != t->cfg.seed)
    return sv_fail(err, SV_E_RANGE,
                   "%s: made by a run with --seed %llu, this one has --seed %llu; give the same one, or "
                   "another --out",
                   name, (unsigned long long)h->seed, (unsigned long long)t->cfg.seed);
  return SV_OK;
}

sv_status sv_checkpoint_read(sv_trainer *t, const char *name, const void *buf, size_t bytes, sv_err *err) {
  sv_sections r;
  head_t h;
  sv_status s = sv_sections_open(&r, name, buf, bytes, SV_CHECKPOINT_KIND, SV_CHECKPOINT_VERSION, err);
  if (s >= 0 && r.version != SV_CHECKPOINT_VERSION)
    return sv_fail(err, SV_E_UNSUPPORTED, "%s: a checkpoint of version %u, expected %u; begin a new run",
                   name, r.version, SV_CHECKPOINT_VERSION);
  if (s >= 0) s = sv_sections_get(&r, "HEAD", &h, sizeof h, err);
  if (s < 0) return s;
  if (h.n != t->g.n || h.sh_degree != t->g.sh_degree || h.n_items != n_items(t) || h.i_order < 0 ||
      h.i_order >= (h.n_items > 0 ? h.n_items : 1))
    return sv_fail(
        err, SV_E_RANGE,
        "%s: made for %d Gaussians of SH degree %d on %d views, this run has %d of degree %d on %d", name,
        h.n, h.sh_degree, h.n_items, t->g.n, t->g.sh_degree, n_items(t));
  if ((s = check_run(&h, t, name, err)) < 0) return s;
  if (h.optimizer != (uint32_t)t->cfg.optimizer)
    return sv_fail(err, SV_E_RANGE, "%s: made with another optimizer, this run has --optimizer %s", name,
                   sv_optimizer_name(t->cfg.optimizer));
  if (!(h.jitter[0] >= 0 && h.jitter[0] < 1 && h.jitter[1] >= 0 && h.jitter[1] < 1))
    return sv_fail(err, SV_E_FORMAT, "%s: the shift of the regions is not in 0..1", name);
  const bool is_kind =
      h.deform_kind == (int)t->cfg.dynamic.kind || (has_both(t) && h.deform_kind == SV_DEFORM_CLIP);
  if (!is_kind || h.n_moving < 0 || h.n_moving > h.n)
    return sv_fail(err, SV_E_RANGE, "%s: made for another kind of scene (still or moving) than this run",
                   name);
  if (!(h.radius > 0)) return sv_fail(err, SV_E_FORMAT, "%s: the scene radius is not positive", name);
  if (!(h.trained_s >= 0)) return sv_fail(err, SV_E_FORMAT, "%s: the time of training is negative", name);
  if ((s = check_order(&r, h.n_items, err)) < 0) return s;
  s = sv_sections_get(&r, "GAUS", t->g.param, rows_bytes(t), err);
  if (s >= 0) s = sv_sections_get(&r, "ADAM", t->m, moments_bytes(t), err);
  if (s >= 0) s = sv_sections_get(&r, "ADAV", t->v, moments_bytes(t), err);
  if (s >= 0) s = sv_sections_get(&r, "ERRS", t->err, (size_t)t->g.cap * sizeof(float), err);
  if (s >= 0) s = sv_sections_get(&r, "ORDR", t->order, (size_t)h.n_items * sizeof(int), err);
  if (s >= 0 && t->floor) s = sv_sections_get(&r, "FLOR", t->floor, floors_bytes(t), err);
  if (s >= 0 && sv_train_is_dynamic(t))
    s = get_motion(&r, t, has_both(t) && h.deform_kind == SV_DEFORM_FIELD, err);
  if (s < 0) return s;
  if (sv_train_is_dynamic(t)) {
    t->deform.kind = (sv_deform_kind)h.deform_kind;
    sv_deform_set_moving(&t->deform, h.n_moving);
    t->find_at = h.find_at, t->followed = h.followed, t->field_step = h.field_step;
    t->fit_left = h.fit_left;
    if (t->deform.kind == SV_DEFORM_FIELD) {
      memcpy(t->deform.field.lo, h.lo, sizeof h.lo);
      memcpy(t->deform.field.inv, h.inv, sizeof h.inv);
    }
  }
  t->i_order = h.i_order, t->step = h.step, t->n_relocated = h.n_relocated, t->trained_s = h.trained_s;
  memcpy(t->jitter, h.jitter, sizeof t->jitter);
  t->rng = (sv_rng){h.rng_state, h.rng_inc};
  sv_train_set_scene(t, h.centre, h.radius);
  return SV_OK;
}
