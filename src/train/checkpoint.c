// SPDX-License-Identifier: Apache-2.0
#include "src/train/checkpoint.h"

#include <string.h>

#define BACKGROUND_GUESS 0x1000000u // beside 0xRRGGBB

typedef struct {
  int32_t n, sh_degree, n_items, i_order;
  uint32_t step, n_relocated;
  uint64_t rng_state, rng_inc;
  float centre[3], radius, jitter[2];
  sv_checkpoint_motion motion; // 0 for still scenes
  uint32_t optimizer, background;
  double trained_s;
  uint64_t seed, origin; // of the run: another one has another order of views, or other pictures
} head_t;

static int n_items(const sv_trainer *t) { return t->n_views + t->n_regions; }

static size_t rows_bytes(const sv_trainer *t) {
  return (size_t)t->g.cap * (size_t)t->g.n_rows * sizeof(float);
}

// Section FLOR. A trainer that is planned only has no memory yet.
static size_t floors_bytes(const sv_trainer *t) {
  return t->cfg.min_scale_px > 0.0f ? (size_t)t->g.cap * sizeof *t->floor : 0;
}

// Sections APPC and APPE: what was learned of cameras and exposures; APPM: what was measured of
// cameras.
static size_t cameras_bytes(const sv_trainer *t) {
  return (size_t)t->cfg.appearance.n_cameras * sizeof *t->appearance.camera;
}
static size_t measured_bytes(const sv_trainer *t) {
  return (size_t)t->cfg.appearance.n_cameras * sizeof *t->appearance.measured;
}
static size_t exposures_bytes(const sv_trainer *t) {
  return cameras_bytes(t) ? (size_t)t->cfg.appearance.n_exposures * sizeof *t->appearance.exposure : 0;
}

// Section LITE: what the light of deep pictures is counted from.
static size_t light_bytes(const sv_trainer *t) { return (size_t)t->n_light * sizeof *t->light; }

static size_t moments_bytes(const sv_trainer *t) { return rows_bytes(t) / sizeof(float) * sizeof *t->m; }

// Section CROS.
static size_t cross_bytes(const sv_trainer *t) {
  return t->cfg.optimizer != SV_OPTIMIZER_ADAM ? 3 * (size_t)t->g.cap * sizeof *t->cross : 0;
}

size_t sv_checkpoint_bytes(const sv_trainer *t) {
  return SV_SECTIONS_OVERHEAD_BYTES + 20 * 40 + light_bytes(t) + cross_bytes(t) + floors_bytes(t) +
         cameras_bytes(t) + measured_bytes(t) + exposures_bytes(t) + sizeof(head_t) + rows_bytes(t) +
         2 * moments_bytes(t) + (size_t)t->g.cap * sizeof(float) +
         (size_t)(t->cfg.cap_views + t->cfg.cap_regions) * sizeof(int) +
         (SV_TRAIN_HAS(t, checkpoint_bytes) ? t->hooks->checkpoint_bytes(t->hooked) : 0);
}

sv_status sv_checkpoint_write(const sv_trainer *t, sv_sink sink, sv_err *err) {
  head_t h;
  sv_sections_writer w;
  sv_status s = sv_gaussians_check(&t->g, err);
  if (s < 0) return s;
  memset(&h, 0, sizeof h);
  h.n = t->g.n;
  h.sh_degree = t->g.sh_degree;
  h.n_items = n_items(t);
  h.i_order = t->i_order;
  h.step = t->step;
  h.n_relocated = t->n_relocated;
  h.rng_state = t->rng.state;
  h.rng_inc = t->rng.inc;
  memcpy(h.centre, t->centre, sizeof h.centre);
  memcpy(h.jitter, t->jitter, sizeof h.jitter);
  h.radius = t->radius;
  h.trained_s = t->trained_s;
  h.seed = t->cfg.seed;
  h.origin = t->origin;
  h.optimizer = (uint32_t)t->cfg.optimizer;
  h.background = t->background.rgb | (t->background.is_guess ? BACKGROUND_GUESS : 0);
  if (SV_TRAIN_HAS(t, save_head)) t->hooks->save_head(t->hooked, &h.motion);
  s = sv_sections_begin(&w, sink, SV_CHECKPOINT_KIND, SV_CHECKPOINT_VERSION, err);
  if (s >= 0) s = sv_sections_put(&w, "HEAD", &h, sizeof h, err);
  if (s >= 0) s = sv_sections_put(&w, "GAUS", t->g.param, rows_bytes(t), err);
  if (s >= 0) s = sv_sections_put(&w, "ADAM", t->m, moments_bytes(t), err);
  if (s >= 0) s = sv_sections_put(&w, "ADAV", t->v, moments_bytes(t), err);
  if (s >= 0 && cross_bytes(t)) s = sv_sections_put(&w, "CROS", t->cross, cross_bytes(t), err);
  if (s >= 0) s = sv_sections_put(&w, "ERRS", t->err, (size_t)t->g.cap * sizeof(float), err);
  if (s >= 0) s = sv_sections_put(&w, "ORDR", t->order, (size_t)n_items(t) * sizeof(int), err);
  if (s >= 0 && t->floor) s = sv_sections_put(&w, "FLOR", t->floor, floors_bytes(t), err);
  if (s >= 0 && cameras_bytes(t))
    s = sv_sections_put(&w, "APPC", t->appearance.camera, cameras_bytes(t), err);
  if (s >= 0 && cameras_bytes(t))
    s = sv_sections_put(&w, "APPM", t->appearance.measured, measured_bytes(t), err);
  if (s >= 0 && exposures_bytes(t))
    s = sv_sections_put(&w, "APPE", t->appearance.exposure, exposures_bytes(t), err);
  if (s >= 0 && t->n_light) s = sv_sections_put(&w, "LITE", t->light, light_bytes(t), err);
  if (s >= 0 && SV_TRAIN_HAS(t, save)) s = t->hooks->save(t->hooked, &w, err);
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

// Pictures of two scenes in one model, or a sequence of random numbers that is no run's, are worse
// than no resume.
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

// A model of deep pictures is in units of their light, others in display values.
static sv_status check_depth(const sv_sections *r, const sv_trainer *t, sv_err *err) {
  const void *data;
  size_t bytes;
  sv_err none;
  const bool is_deep = sv_sections_find(r, "LITE", &data, &bytes, &none) >= 0;
  if (is_deep == (t->n_light > 0)) return SV_OK;
  return sv_fail(err, SV_E_RANGE, "%s: made with --depth %d; give the same one, or another --out", r->name,
                 is_deep ? 16 : 8);
}

sv_status sv_checkpoint_read(sv_trainer *t, const char *name, const void *buf, size_t bytes, sv_err *err) {
  sv_sections r;
  head_t h;
  sv_status s =
      sv_sections_open(&r, &(sv_file_data){name, buf, bytes}, SV_CHECKPOINT_KIND, SV_CHECKPOINT_VERSION, err);
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
      SV_TRAIN_HAS(t, is_loadable) ? t->hooks->is_loadable(t->hooked, &h.motion) : h.motion.kind == 0;
  if (!is_kind || h.motion.n_moving < 0 || h.motion.n_moving > h.n)
    return sv_fail(err, SV_E_RANGE, "%s: made for another kind of scene (still or moving) than this run",
                   name);
  if (!(h.radius > 0)) return sv_fail(err, SV_E_FORMAT, "%s: the scene radius is not positive", name);
  if (!(h.trained_s >= 0)) return sv_fail(err, SV_E_FORMAT, "%s: the time of training is negative", name);
  if ((s = check_depth(&r, t, err)) < 0) return s;
  if ((s = check_order(&r, h.n_items, err)) < 0) return s;
  s = sv_sections_get(&r, "GAUS", t->g.param, rows_bytes(t), err);
  if (s >= 0) s = sv_sections_get(&r, "ADAM", t->m, moments_bytes(t), err);
  if (s >= 0) s = sv_sections_get(&r, "ADAV", t->v, moments_bytes(t), err);
  if (s >= 0 && cross_bytes(t)) s = sv_sections_get(&r, "CROS", t->cross, cross_bytes(t), err);
  if (s >= 0) s = sv_sections_get(&r, "ERRS", t->err, (size_t)t->g.cap * sizeof(float), err);
  if (s >= 0) s = sv_sections_get(&r, "ORDR", t->order, (size_t)h.n_items * sizeof(int), err);
  if (s >= 0 && t->floor) s = sv_sections_get(&r, "FLOR", t->floor, floors_bytes(t), err);
  if (s >= 0 && cameras_bytes(t))
    s = sv_sections_get(&r, "APPC", t->appearance.camera, cameras_bytes(t), err);
  if (s >= 0 && cameras_bytes(t))
    s = sv_sections_get(&r, "APPM", t->appearance.measured, measured_bytes(t), err);
  if (s >= 0 && exposures_bytes(t))
    s = sv_sections_get(&r, "APPE", t->appearance.exposure, exposures_bytes(t), err);
  if (s >= 0 && t->n_light) s = sv_sections_get(&r, "LITE", t->light, light_bytes(t), err);
  if (s >= 0 && SV_TRAIN_HAS(t, load)) s = t->hooks->load(t->hooked, &r, &h.motion, err);
  if (s < 0) return s;
  t->i_order = h.i_order;
  t->step = h.step;
  t->n_relocated = h.n_relocated;
  t->background.rgb = h.background & 0xffffff;
  t->background.is_guess = (h.background & BACKGROUND_GUESS) != 0;
  t->trained_s = h.trained_s;
  memcpy(t->jitter, h.jitter, sizeof t->jitter);
  t->rng = (sv_rng){h.rng_state, h.rng_inc};
  sv_train_set_scene(t, h.centre, h.radius);
  return SV_OK;
}
