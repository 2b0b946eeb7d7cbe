// SPDX-License-Identifier: Apache-2.0
#include "src/train/driver.h"

#include <string.h>

#include "src/base/mathx.h"
#include "src/metric/metric.h"
#include "src/rig/limits.h"
#include "src/splat/constants.h"
#include "src/train/appearance_start.h"
#include "src/train/demultiplex.h"
#include "src/train/step.h"
#include "src/train/stereo.h"
#include "src/train/sweep.h"
#include "src/train/measurement.h"
#include "src/train/supersample.h"

#define LOSS_STEPS   50  // that the mean loss is over, about
#define LINE_EVERY_S 0.5 // between two progress lines
#define BAR_LENGTH   20  // characters
#define LINE_BYTES   768

// --- objective -----------------------------------------------------------------------------------

void sv_focal_range_add(sv_focal_range *f, float focal_px) {
  f->min_px = f->max_px > 0 ? sv_minf(f->min_px, focal_px) : focal_px;
  f->max_px = sv_maxf(f->max_px, focal_px);
}

bool sv_focal_range_needs_antialiasing(const sv_focal_range *f) {
  return f->max_px > SV_MIP_FOCAL_RATIO * f->min_px;
}

void sv_driver_set_objective(sv_train_cfg *cfg, const sv_sampling *sampling, int optimizer) {
  sv_train_set_objective(cfg, sampling);
  if (optimizer > 0) cfg->optimizer = (sv_optimizer)(optimizer - 1);
}

// --- first model ---------------------------------------------------------------------------------

size_t sv_driver_scratch_bytes(const sv_train_cfg *cfg, int n_points) {
  const sv_train_cfg lenses = sv_demultiplex_cfg(cfg);
  const size_t fill = sv_init_scratch_bytes(cfg->n_gaussians, n_points);
  const size_t sweep =
      cfg->cap_lenses > 0 ? sv_demultiplex_bytes(cfg) + sv_sweep_bytes(&lenses) : sv_sweep_bytes(cfg);
  const size_t radius = (size_t)cfg->n_gaussians * sizeof(float); // sv_gaussians_radius
  size_t most = fill > sweep ? fill : sweep;
  if (most < radius) most = radius;
  const size_t appearance = sv_appearance_start_bytes(cfg);
  if (most < appearance) most = appearance;
  const size_t support = sv_support_bytes(cfg->n_gaussians, cfg->n_threads); // at the end
  if (most < support) most = support;
  return most + 4096;
}

// How often the model that tells lens images apart sees each region of a sensor. With more, its
// floaters settle between the lenses, and depth maps find them (docs/notes/few-exposures.md).
#define SKETCH_EPOCHS 10

// A first model of what multiplexed sensors show, for telling their lens images apart.
static sv_status train_sketch(sv_trainer *t, const sv_driver_start *start) {
  const sv_bounds *b = &start->bounds;
  const sv_init_cfg sphere = {.kind = SV_INIT_SPHERE,
                              .centre = {b->centre[0], b->centre[1], b->centre[2]},
                              .radius = b->radius,
                              .opacity = 0.1f,
                              .scale_factor = 1.0f,
                              .seed = t->cfg.seed};
  const sv_train_cfg usual = t->cfg;
  const int n_steps = SKETCH_EPOCHS * t->n_regions;
  sv_step_stats st;
  sv_status s = sv_train_start(t, &sphere, NULL, 0, start->scratch);
  t->cfg.expected_steps = n_steps;
  if (usual.optimizer != SV_OPTIMIZER_ADAM)
    t->cfg.optimizer = SV_OPTIMIZER_MIXED; // as from afar (objective.c)
  t->cfg.reg_opacity_until = 1.0f;
  for (int i = 0; s >= 0 && i < n_steps; i++) {
    if (start->beat) start->beat(start->self);
    s = sv_train_step(t, (float)i / (float)n_steps, &st);
  }
  t->cfg = usual;
  t->n_relocated = 0;
  return s;
}

static sv_status measure_lenses(sv_trainer *t, const sv_driver_start *start, sv_stereo_cloud *cloud) {
  const size_t mark = sv_arena_mark(start->scratch);
  sv_lens_images images = {0};
  sv_status s = train_sketch(t, start);
  if (s >= 0) s = sv_demultiplex(t, start->scratch, &images);
  // Floaters are in all lens images, so that maps of them agree. The model knows better.
  cloud->depth = images.depth;
  if (s >= 0) s = sv_stereo_points(images.lenses, &start->bounds, start->scratch, cloud);
  sv_arena_reset(start->scratch, mark);
  return s;
}

sv_status sv_driver_measure(sv_trainer *t, sv_driver_start *start, sv_err *err) {
  sv_stereo_cloud cloud = {.point = start->points, .cap = t->g.n};
  sv_status s = t->n_measurements > 0 && t->cfg.cap_lenses > 0
                    ? measure_lenses(t, start, &cloud)
                    : sv_stereo_points(t, &start->bounds, start->scratch, &cloud);
  start->n_points = cloud.n;
  start->n_maps = cloud.n_maps;
  if (s < 0) return sv_fail(err, s, "no depth maps for the first model: %s", sv_status_text(s));
  if (s != SV_OK) return s;
  start->init = sv_stereo_init(&start->bounds, t->cfg.seed);
  start->is_scene_set = true;
  return SV_OK;
}

static bool is_in_view(const sv_view *v, const float *p) {
  float x[3];
  for (int r = 0; r < 3; r++)
    x[r] = v->r[3 * r] * p[0] + v->r[3 * r + 1] * p[16] + v->r[3 * r + 2] * p[32] + v->t[r];
  float uv[2], depth;
  return sv_view_project(v, x, uv, &depth) && uv[0] >= 0 && uv[0] < (float)v->width_px && uv[1] >= 0 &&
         uv[1] < (float)v->height_px;
}

#define SEEN_PART 100 // one of so many Gaussians must be in a view for a start

static bool is_seen(const sv_trainer *t) {
  const int n_views = sv_driver_n_views(t), n_needed = sv_maxi(t->g.n / SEEN_PART, 1);
  int n = 0;
  for (int v = 0; v < n_views && n < n_needed; v++)
    for (int i = 0; i < t->g.n && n < n_needed; i++)
      n += is_in_view(sv_driver_view(t, v), sv_gaussians_at(&t->g, i, SV_ROW_MEAN));
  return n >= n_needed;
}

static sv_status start_appearance(sv_trainer *t, sv_arena *scratch, sv_err *err) {
  int n_points;
  sv_status s = sv_appearance_start(t, scratch, &n_points);
  return s < 0 ? sv_fail(err, s, "the colors of the cameras could not be compared: %s", sv_status_text(s))
               : SV_OK;
}

sv_status sv_driver_place(sv_trainer *t, const sv_driver_start *start, sv_err *err) {
  sv_status s = sv_train_start(t, &start->init, start->points, start->n_points, start->scratch);
  if (s < 0)
    return sv_fail(err, s, "the first Gaussians could not be placed from %d points: %s", start->n_points,
                   sv_status_text(s));
  if (start->is_scene_set) sv_train_set_scene(t, start->bounds.centre, start->bounds.radius);
  const double centre[3] = {(double)t->centre[0], (double)t->centre[1], (double)t->centre[2]};
  if ((s = sv_limits_check_scene(centre, (double)t->radius, "the first model", err)) < 0) return s;
  if (is_seen(t)) return start->n_maps > 0 ? start_appearance(t, start->scratch, err) : SV_OK;
  return sv_fail(
      err, SV_E_RANGE,
      "no camera sees the first model: %d of %d Gaussians were expected in front of one; are points "
      "and poses of one world, and poses not inverted?",
      sv_maxi(t->g.n / SEEN_PART, 1), t->g.n);
}

// --- loop ----------------------------------------------------------------------------------------

static double seconds(const sv_driver *d) { return sv_ns_to_s(d->cfg.clock.now_ns(d->cfg.clock.self)); }

static bool is_stop_requested(const sv_driver *d) {
  const sv_console *c = &d->cfg.console;
  return c->is_stop_requested && c->is_stop_requested(c->self);
}

double sv_driver_steps_per_s(const sv_driver *d) {
  return d->train_s > 0 ? (double)d->step_time.n / d->train_s : 0;
}

static void progress_line(const sv_driver *d, const sv_trainer *t, float progress) {
  const sv_driver_cfg *c = &d->cfg;
  char line[LINE_BYTES];
  sv_str s = sv_str_make(line, sizeof line);
  if (!c->console.log) return;
  const sv_plateau *p = &d->plateau;
  const double rest = 1 - (double)progress;
  sv_str_add(&s, "train [");
  for (int i = 0; i < BAR_LENGTH; i++) sv_str_add(&s, "%s", (float)i < progress * BAR_LENGTH ? "#" : ".");
  sv_str_add(&s, "]  %u", t->step);
  if (c->n_steps) sv_str_add(&s, "/%u", c->n_steps);
  sv_str_add(&s, " steps  %.0f steps/s  loss %.4f  ", sv_driver_steps_per_s(d), d->loss);
  if (p->db > 0) sv_str_add(&s, "held-out pixels %.1f dB  ", p->db);
  if (p->n_steps)
    sv_str_add(&s, "ETA %.0f s", (p->from_step + p->n_steps - t->step) / sv_driver_steps_per_s(d));
  else if (c->n_steps)
    sv_str_add(&s, "ETA %.0f s", progress > 0.001f ? t->trained_s * rest / (double)progress : 0);
  else sv_str_add(&s, "%.0f of %.0f s", t->trained_s, c->limit_s);
  if (c->add_progress) c->add_progress(c->self, &s);
  c->console.log(c->console.self, SV_LOG_LIVE, line);
}

// One step, timed from *now_s, which is moved on to its end.
static sv_status timed_step(sv_driver *d, sv_trainer *t, float progress, double *now_s, sv_err *err) {
  sv_step_stats st;
  sv_status s = sv_train_step(t, progress, &st);
  if (s < 0) return sv_fail(err, s, "training step %u failed: %s", t->step, sv_status_text(s));
  const double from_s = *now_s;
  *now_s = seconds(d);
  if (st.i_view >= 0) { // else a field was fitted, without an image
    const double n = (double)d->step_time.n + 1, keep = n < LOSS_STEPS ? 1 - 1 / n : 1 - 1.0 / LOSS_STEPS;
    d->last = st;
    d->loss = keep * d->loss + (1 - keep) * st.loss;
    sv_time_stats_add(&d->step_time, *now_s - from_s);
  }
  return d->cfg.after_step ? d->cfg.after_step(d->cfg.self, from_s, now_s, err) : SV_OK;
}

// Quality on the pixels that are kept from training; says when the end begins.
static sv_status measure(sv_driver *d, const sv_trainer *t, float progress, sv_err *err) {
  const sv_driver_cfg *c = &d->cfg;
  char line[LINE_BYTES];
  sv_str out = sv_str_make(line, sizeof line);
  double db = 0;
  sv_status s = c->measure(c->self, &db);
  if (s < 0) return sv_fail(err, s, "quality after step %u: %s", t->step, sv_status_text(s));
  if (!sv_plateau_measured(&d->plateau, db, t->step, progress, t->trained_s) || !c->console.log) return SV_OK;
  sv_str_add(&out, "step %u: %.2f dB on held-out pixels, less than %g dB a second is won: %u more steps",
             t->step, db, c->least_db_per_s, (unsigned)d->plateau.n_steps);
  c->console.log(c->console.self, SV_LOG_INFO, line);
  return SV_OK;
}

// Before a step.
static float progress_at(const sv_driver *d, const sv_trainer *t, uint32_t step) {
  const sv_driver_cfg *c = &d->cfg;
  const float of_limit = c->n_steps ? (float)step / (float)c->n_steps : (float)(t->trained_s / c->limit_s);
  return sv_plateau_progress(&d->plateau, step, of_limit);
}

// Trained Gaussians lie closer to the surface than those of the start, and lie where depth maps
// found nothing: they tell more of cameras and exposures. Moving ones lie elsewhere at other times.
static sv_status measure_appearance(const sv_driver *d, sv_trainer *t, float progress, sv_err *err) {
  static const float at[] = {0.25f, 0.5f};
  bool is_due = false;
  for (int i = 0; i < 2; i++) is_due |= d->progress < at[i] && progress >= at[i];
  if (!is_due || !d->cfg.scratch || SV_TRAIN_HAS(t, set_time)) return SV_OK;
  if (!sv_appearance_is_uncertain(t)) return SV_OK;
  return start_appearance(t, d->cfg.scratch, err);
}

sv_status sv_driver_run(sv_driver *d, const sv_driver_cfg *cfg, sv_trainer *t, sv_err *err) {
  const double had_s = t->trained_s; // before the run that this one resumes was stopped
  *d = (sv_driver){.cfg = *cfg, .plateau.least_db_per_s = cfg->least_db_per_s};
  double t0_s = seconds(d), now_s = t0_s, line_s = t0_s;
  d->progress = progress_at(d, t, t->step > 0 ? t->step - 1 : 0);
  for (;;) {
    d->train_s = now_s - t0_s;
    t->trained_s = had_s + d->train_s;
    const float progress = progress_at(d, t, t->step);
    if (cfg->n_steps && progress >= 1.0f) return SV_OK;
    const bool is_over = progress >= 1.0f || (cfg->limit_s > 0 && t->trained_s >= cfg->limit_s);
    if (is_over && (!cfg->may_end || cfg->may_end(cfg->self))) return SV_OK;
    if (is_stop_requested(d))
      return sv_fail(err, SV_E_INTERRUPTED, "stopped by request after %u steps", t->step);
    const float scheduled = cfg->steady_progress > 0 ? cfg->steady_progress : progress;
    sv_driver_turn turn = {0};
    sv_status s = cfg->before_step ? cfg->before_step(cfg->self, scheduled, &turn, err) : SV_OK;
    if (s < 0) return s;
    t0_s += turn.away_s;
    now_s += turn.away_s;
    if (turn.has_taken_time || turn.is_other_work) now_s = seconds(d);
    if (turn.is_other_work) continue;
    if ((s = measure_appearance(d, t, progress, err)) < 0) return s;
    d->progress = progress;
    if ((s = timed_step(d, t, scheduled, &now_s, err)) < 0) return s;
    if (sv_plateau_is_due(&d->plateau, progress, t->trained_s)) {
      if ((s = measure(d, t, progress, err)) < 0) return s;
      now_s = seconds(d);
    }
    if (now_s - line_s < LINE_EVERY_S) continue;
    progress_line(d, t, progress);
    line_s = now_s;
  }
}

// --- views ---------------------------------------------------------------------------------------

int sv_driver_n_views(const sv_trainer *t) {
  int n = t->n_views;
  for (int i = 0; i < t->n_measurements; i++) n += t->measurements[i].model.n_lenses;
  return n;
}

const sv_view *sv_driver_view(const sv_trainer *t, int i) {
  if (i < t->n_views) return &t->views[i].view;
  const sv_train_measurement *c = t->measurements;
  for (i -= t->n_views; i >= c->model.n_lenses; c++) i -= c->model.n_lenses;
  return &c->model.lenses[i].view;
}

static sv_status add_part(sv_trainer *t, const sv_view *part, sv_support *out) {
  const sv_render_options o = sv_train_render_options(t, 1.0f, false);
  const sv_support_planes planes = {&t->grad, t->err_plane};
  sv_train_size_images(t, part->width_px, part->height_px);
  sv_status s = sv_render(&t->render, &t->g, part, &o);
  return s < 0 ? s : sv_support_add(out, &t->render, &planes);
}

// Lens images may be larger than the trainer's planes.
static sv_status add_lens(sv_trainer *t, const sv_view *v, sv_support *out) {
  const int side = t->cfg.region_px;
  sv_status s = SV_OK;
  for (int y = 0; y < v->height_px && s >= 0; y += side)
    for (int x = 0; x < v->width_px && s >= 0; x += side) {
      sv_view part = *v;
      part.width_px = sv_mini(side, v->width_px - x);
      part.height_px = sv_mini(side, v->height_px - y);
      part.cx -= (float)x;
      part.cy -= (float)y;
      s = add_part(t, &part, out);
    }
  return s;
}

sv_status sv_driver_support(sv_trainer *t, sv_arena *scratch, sv_support *out) {
  const int n = sv_driver_n_views(t);
  sv_status s = sv_support_init(out, t->g.n, t->cfg.n_threads, scratch);
  for (int k = 0; k < sv_support_n_asked(n) && s >= 0; k++) {
    const int i = sv_support_asked(n, k);
    const sv_view *v = sv_driver_view(t, i);
    const bool is_lens = i >= t->n_views;
    sv_support_begin(out, v, v->i_exposure);
    if (!is_lens) sv_train_roll(t, i, v, sv_train_render_options(t, 1.0f, false).near_z);
    s = is_lens ? add_lens(t, v, out) : add_part(t, v, out);
    if (!is_lens) sv_train_unroll(t);
    sv_support_end(out);
  }
  return s;
}

void sv_driver_add_support(sv_str *out, const sv_support_summary *s) {
  sv_str_add(
      out, "{\"views\": %d, \"unseen\": %.4f, \"one_view\": %.4f, \"angle_deg\": %.3f, \"supported\": %.4f}",
      s->n_views, s->unseen, s->one_view, s->angle_deg, s->supported);
}

// --- evaluation ----------------------------------------------------------------------------------

sv_status sv_driver_render(sv_trainer *t, const sv_view *view, const sv_planes **out) {
  sv_render_options o = sv_train_render_options(t, 1.0f, false);
  sv_train_set_time(t, view->time);
  return sv_train_measure(t, view, &o, sv_train_is_supersampled(t, 1, 1.0f), out);
}

sv_status sv_driver_render_view(sv_trainer *t, int i_view, const sv_planes **out) {
  const sv_view *view = &t->views[i_view].view;
  sv_train_roll(t, i_view, view, sv_train_render_options(t, 1.0f, false).near_z);
  sv_status s = sv_driver_render(t, view, out);
  sv_train_unroll(t);
  return s;
}

// Over the pixels that count; 0 when none does.
static double mse_of(const sv_planes *p, const sv_image_u8 *im) {
  double sum = 0;
  const long n_counted = sv_image_n_counted(im);
  for (int y = 0; y < im->height_px; y++)
    for (int x = 0; x < im->width_px; x++) {
      const uint8_t *rgb = im->px + (size_t)y * (size_t)im->stride_bytes + (size_t)x * (size_t)im->n_channels;
      if (!sv_image_counts(im, 1, x, y)) continue;
      for (int c = 0; c < 3; c++) {
        double d = (double)sv_clampf(p->c[c][(long)y * p->stride + x], 0.0f, 1.0f) - rgb[c] / 255.0;
        sum += d * d;
      }
    }
  return n_counted ? sum / (3.0 * (double)n_counted) : 0;
}

// A rendering with another light, in t->target.
static const sv_planes *lit(sv_trainer *t, const sv_planes *p, float light) {
  const sv_kernels *k = t->compute.k;
  if (light == 1.0f) return p;
  sv_train_size_images(t, p->width_px, p->height_px);
  for (int c = 0; c < 3; c++) {
    float *out = t->target.c[c];
    const int n = p->stride * p->height_px;
    k->srgb_to_linear(&(sv_curve_args){.src = p->c[c], .dst = out, .n = n});
    for (int i = 0; i < n; i++) out[i] *= light;
    k->linear_to_srgb(&(sv_curve_args){.src = out, .dst = out, .n = n});
  }
  return &t->target;
}

sv_status sv_driver_mse(sv_trainer *t, const sv_view *view, const uint8_t *rgb, double *mse) {
  return sv_driver_lit_mse(t, view, 1, rgb, mse);
}

sv_status sv_driver_lit_mse(sv_trainer *t, const sv_view *view, float light, const uint8_t *rgb,
                            double *mse) {
  const sv_planes *p;
  sv_status s = sv_driver_render(t, view, &p);
  if (s >= 0) p = lit(t, p, light);
  if (s >= 0)
    *mse = mse_of(p, &(sv_image_u8){rgb, view->width_px, view->height_px, 3, 3 * view->width_px, NULL});
  return s;
}

sv_status sv_driver_view_mse(sv_trainer *t, int i_view, const uint8_t *mask, double *mse) {
  const sv_train_view *v = &t->views[i_view];
  const sv_planes *p;
  const float black[3] = {0};
  sv_status s = sv_driver_render_view(t, i_view, &p);
  // Deep ones are compared with what the first exposure would show.
  const bool is_shown = sv_train_has_appearance(t, i_view) && !v->deep.px;
  if (s >= 0 && is_shown) sv_train_load_image(t, &v->image, 1, black, &t->target);
  sv_image_u8 im = v->image;
  if (mask) im.mask = mask;
  if (s >= 0) *mse = mse_of(is_shown ? sv_train_appear(t, i_view, &v->view, p) : p, &im);
  return s;
}

// Of one region, which was predicted.
static double region_sum(const sv_planes *p, const sv_train_measurement *tc, const sv_region *r) {
  double sum = 0;
  for (int y = r->y0; y < r->y1; y++)
    for (int x = r->x0; x < r->x1; x++)
      for (int k = 0; k < 3; k++) {
        double d = (double)sv_clampf(p->c[k][(long)(y - r->y0) * p->stride + (x - r->x0)], 0.0f, 1.0f) -
                   tc->px[((size_t)y * (size_t)tc->model.width_px + (size_t)x) * 3 + (size_t)k] / 65535.0;
        sum += d * d;
      }
  return sum;
}

// Over a sensor's measurement.
static sv_status measurement_mse(sv_trainer *t, const sv_train_measurement *tc, double *mse) {
  const int side = t->cfg.region_px, width_px = tc->model.width_px, height_px = tc->model.height_px;
  sv_render_options o = sv_train_render_options(t, 1.0f, false);
  double sum = 0;
  for (int y0 = 0; y0 < height_px; y0 += side)
    for (int x0 = 0; x0 < width_px; x0 += side) {
      sv_region r = {x0, y0, sv_mini(x0 + side, width_px), sv_mini(y0 + side, height_px)};
      sv_status s = sv_train_predict(t, &tc->model, &r, &o, NULL, NULL);
      if (s < 0) return s;
      sum += region_sum(&t->forward.predicted, tc, &r);
    }
  *mse = sum / (3.0 * width_px * height_px);
  return SV_OK;
}

sv_status sv_driver_training_psnr(sv_trainer *t, double *psnr) {
  const int n = t->n_views + t->n_measurements;
  *psnr = 0;
  for (int i = 0; i < n; i++) {
    double mse;
    sv_status s = i < t->n_views ? sv_driver_view_mse(t, i, NULL, &mse)
                                 : measurement_mse(t, &t->measurements[i - t->n_views], &mse);
    if (s < 0) return s;
    *psnr += sv_psnr_of_mse(mse) / n;
  }
  return SV_OK;
}

// --- settings ------------------------------------------------------------------------------------

const char *sv_background_name(sv_background b) {
  static const char *const names[] = {"black", "white", "random", "backdrop", "pictures"};
  return (unsigned)b < sizeof names / sizeof *names ? names[b] : "?";
}

static void add_number(sv_str *out, const char *key, double v) { sv_str_add(out, ", \"%s\": %.9g", key, v); }

void sv_driver_add_settings(sv_str *out, const sv_trainer *t) {
  const sv_train_cfg *c = &t->cfg;
  char of_pictures[8];
  const char *background = sv_background_name(c->background);
  if (c->background == SV_BG_BACKDROP || c->background == SV_BG_OF_PICTURES) {
    sv_fmt(of_pictures, sizeof of_pictures, "#%06x", t->background.rgb);
    background = t->background.rgb ? of_pictures : sv_background_name(SV_BG_BLACK);
  }
  sv_str_add(out, "\"sh\": %d, \"background\": \"%s\", \"optimizer\": \"%s\", \"seed\": %llu", c->sh_degree,
             background, sv_optimizer_name(c->optimizer), (unsigned long long)c->seed);
  sv_str_add(out, ", \"antialiased\": %s, \"novel_views\": %d", c->is_antialiased ? "true" : "false",
             c->n_novel);
  add_number(out, "loss_ssim", (double)c->weight_ssim);
  add_number(out, "loss_tv", (double)c->weight_tv);
  add_number(out, "loss_tv_novel", (double)c->weight_tv_novel);
  add_number(out, "loss_smooth_novel", (double)c->weight_smooth_novel);
  add_number(out, "loss_reproject_novel", (double)c->weight_reproject_novel);
  add_number(out, "loss_smooth", (double)c->weight_smooth);
  add_number(out, "loss_reproject", (double)c->weight_reproject);
  add_number(out, "supersample", c->is_supersampled ? 1.0 - (double)c->supersample_from : 0);
  add_number(out, "min_scale_px", (double)c->min_scale_px);
  add_number(out, "dilation_px2", (double)c->dilation_px2);
  add_number(out, "loss_opacity", (double)c->reg_opacity);
  add_number(out, "loss_scale", (double)c->reg_scale);
  add_number(out, "dropout", (double)c->dropout);
  add_number(out, "scene_radius", (double)t->radius);
  sv_str_add(out, ", \"scene_centre\": [%.9g, %.9g, %.9g]", (double)t->centre[0], (double)t->centre[1],
             (double)t->centre[2]);
}

sv_model_notes sv_driver_notes(const sv_trainer *t) {
  return (sv_model_notes){
      .is_mip = t->cfg.is_antialiased, .dilation_px2 = t->cfg.dilation_px2, .background = t->background.rgb};
}
