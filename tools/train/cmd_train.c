// SPDX-License-Identifier: Apache-2.0
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "src/base/mathx.h"
#include "src/format/axes.h"
#include "src/base/str.h"
#include "src/train/driver.h"
#include "tools/dataset/measurement.h"
#include "tools/import/find.h"
#include "tools/train/appearance.h"
#include "tools/train/evaluate.h"
#include "tools/train/open.h"
#include "tools/train/measured.h"
#include "tools/train/noise.h"
#include "tools/train/plan.h"
#include "tools/train/poses.h"
#include "tools/train/prior.h"

#define N_PANELS 4

#define N_SAVES       6                    // tries to save the model
#define FIRST_WAIT_NS (250 * SV_NS_PER_MS) // between the first two; then twice as long each

// Of a field: distilled, the clip before it has 3,000 or so; at rest at first, it learns slowly.
#define DISTILLED_STEPS 4000
#define FIELD_STEPS     9000

// One training run, from the options to what is saved.
typedef struct {
  const lab_options *o;
  lab_session session;
  lab_views views;
  lab_scene scene;
  sv_driver_start start; // its points are allocated here
  sv_train_cfg cfg;
  lab_plan_extras extras;
  lab_plan plan;
  lab_prior prior;
  sv_driver driver;
  long n_steps;                         // wanted; 0: by time
  double limit_s;                       // 0: by steps
  double load_s, eval_s, measured_psnr; // measured: of multiplexed measurements
  sv_support_summary support;           // of still scenes, with --eval
  bool is_stopped, has_scores, has_time_scores;
  sv_render_options render;       // of the finished model
  lab_scores scores, time_scores; // time: of held-out times of the training cameras
  bool is_standing;               // the rig, while the scene moves
  bool is_stereo;                 // starts from depth maps of its own views
  bool is_refining;               // training moves the poses
  bool has_poses;                 // they are saved
  bool is_aligned;                // held-out poses are refined before they are scored
} run;

// --- settings ------------------------------------------------------------------------------------

static sv_train_cfg train_cfg(const lab_options *o, sv_dynamic_cfg *d) {
  sv_train_cfg c = sv_train_defaults();
  if (o->gaussians > 0) c.n_gaussians = (int)o->gaussians;
  if (o->sh >= 0) c.sh_degree = (int)o->sh;
  if (o->seed >= 0) c.seed = (uint64_t)o->seed;
  *d = sv_dynamic_defaults();
  if (o->method && sv_str_eq(o->method, "4dgs")) lab_dynamic_cfg(o, 0, 0, d);
  c.has_motion = d->kind != SV_DEFORM_NONE;
  const int field_steps = sv_dynamic_has_clip(d) ? DISTILLED_STEPS : FIELD_STEPS;
  if (d->kind == SV_DEFORM_FIELD) c.expected_steps = field_steps;
  if (o->steps > 0) c.expected_steps = (int)o->steps;
  return c;
}

static void choose_objective(run *r) {
  const lab_options *o = r->o;
  sv_train_cfg *c = &r->cfg;
  sv_sampling s = lab_sampling_of(&r->views);
  s.is_moving = c->has_motion;
  if (s.is_moving) lab_dynamic_cfg(o, c->expected_steps, lab_n_times(&r->views), &r->extras.dynamic);
  if (s.is_moving) s.n_exposures = (lab_n_places(&r->views) + s.n_sub_views - 1) / s.n_sub_views;
  r->is_standing = s.is_moving && s.n_exposures == 1;
  s.is_far = o->init && (sv_str_eq(o->init, "sphere") || sv_str_eq(o->init, "cube"));
  sv_driver_set_objective(c, &s, o->optimizer ? 1 + sv_optimizer_by_name(o->optimizer) : 0);
  if (o->background) c->background = lab_background_by_name(o->background);
  if (o->ssim >= 0) c->weight_ssim = o->ssim;
  if (o->tv >= 0) c->weight_tv = o->tv;
  if (o->tv_novel >= 0) c->weight_tv_novel = o->tv_novel;
  if (o->n_novel >= 0) c->n_novel = (int)o->n_novel;
  if (o->novel_every >= 0) c->novel_every = (int)o->novel_every;
  if (o->novel_px >= 0) c->novel_px = (int)o->novel_px;
  if (o->novel_deg >= 0) c->novel_rad = o->novel_deg * (float)(SV_PI / 180);
  if (o->min_scale_px >= 0) c->min_scale_px = o->min_scale_px;
  if (o->is_noise_on_prediction) {
    c->noise_read = o->noise_read;
    c->noise_shot = o->noise_shot;
  }
  if (o->dilation_px2 > 0) c->dilation_px2 = o->dilation_px2;
  if (o->supersample >= 0) {
    c->is_supersampled = o->supersample > 0;
    c->supersample_from = 1.0f - o->supersample;
  }
  if (o->region_px >= 0) c->region_px = (int)o->region_px;
  if (o->opacity >= 0) c->reg_opacity = o->opacity;
  if (o->size >= 0) c->reg_scale = o->size;
  if (o->dropout >= 0) c->dropout = o->dropout;
  if (o->noise) c->random_until = 0; // noisy images are blended over black already
  lab_prior_cfg(o, &r->views, &r->extras.prior);
  sv_prior_prepare(&r->extras.prior, c);
}

// The file of --init points:FILE, or the dataset's own; NULL: another start.
static const char *points_file(run *r) {
  const char *init = r->o->init;
  const long n = r->o->exposures;
  if (init) return strncmp(init, "points:", 7) == 0 ? init + 7 : NULL;
  if (!*r->views.points || r->is_standing) return NULL; // such a rig cannot have measured them
  // Nor can so few views, which lie as far apart as can be. What a device measures by itself is the
  // stereo start's.
  if (n > 0 && n <= SV_FEW_EXPOSURES) {
    if (n > 1)
      lab_say(&r->session,
              "%ld exposures could not have produced the dataset's points; starting without them", n);
    return NULL;
  }
  if (sv_path_exists(r->views.points)) return r->views.points;
  lab_say(&r->session, "%s: the dataset's point file is missing; starting without it", r->views.points);
  return NULL;
}

static sv_status choose_start(run *r, sv_err *err) {
  const char *word = r->o->init, *file = points_file(r);
  sv_init_cfg *init = &r->start.init;
  r->scene = lab_scene_of(&r->views);
  *init = (sv_init_cfg){.kind = SV_INIT_SPHERE,
                        .radius = r->scene.radius,
                        .opacity = 0.1f,
                        .scale_factor = 1.0f,
                        .seed = r->cfg.seed};
  memcpy(init->centre, r->scene.centre, sizeof init->centre);
  if (word && sv_str_eq(word, "cube")) init->kind = SV_INIT_CUBE;
  r->is_stereo = word ? sv_str_eq(word, "stereo") : !file;
  if (!file) return SV_OK;
  init->kind = SV_INIT_POINTS;
  init->opacity = 0.5f;
  init->scale_factor = 0.5f;
  return lab_points_read(file, &r->start.points, &r->start.n_points, init->centre, &init->radius, err);
}

static int check_init(const lab_options *o) {
  const char *i = o->init;
  if (!i || sv_str_eq(i, "sphere") || sv_str_eq(i, "cube") || sv_str_eq(i, "stereo") ||
      (strncmp(i, "points:", 7) == 0 && i[7]))
    return LAB_EXIT_OK;
  return lab_usage("train", "--init must be stereo, sphere, cube or points:FILE, not '%.80s'", i);
}

static void choose_antialiasing(run *r) {
  const char *word = r->o->antialias;
  sv_focal_range focal = {0};
  for (int i = 0; i < r->views.n; i++) sv_focal_range_add(&focal, r->views.frames[i].view.fx);
  r->cfg.is_antialiased =
      !word || sv_str_eq(word, "auto") ? sv_focal_range_needs_antialiasing(&focal) : sv_str_eq(word, "on");
}

static sv_status add_noise(run *r, sv_err *err) {
  sv_noise_model m = {r->o->noise_read, r->o->noise_shot};
  if (!r->o->noise) return SV_OK;
  if (r->o->is_noise_on_prediction)
    return r->views.n_measurements
               ? SV_OK
               : sv_fail(err, SV_E_ARG,
                         "%s: no multiplexed measurements; --noise prediction needs them; use read=V,shot=V",
                         r->o->data);
  return lab_noise_add(&r->views, &r->plan, &m, &r->cfg, &r->session.pool, err);
}

// --- stages --------------------------------------------------------------------------------------

static sv_status add_views(run *r, sv_err *err) {
  for (int i = 0; i < r->views.n; i++) {
    const lab_frame *f = &r->views.frames[i];
    if (f->i_measurement >= 0) continue;
    sv_image_u8 im = {.px = r->plan.pictures[i],
                      .width_px = f->view.width_px,
                      .height_px = f->view.height_px,
                      .n_channels = f->n_channels,
                      .stride_bytes = f->view.width_px * f->n_channels,
                      .mask = r->plan.masks[i]};
    sv_status s = sv_train_add_view(&r->plan.trainer, &f->view, &im, err);
    if (s != SV_OK) return s;
    lab_appearance_set(&r->views, i, &r->plan.trainer, r->plan.trainer.n_views - 1);
  }
  return SV_OK;
}

static sv_status add_measurements(run *r, sv_err *err) {
  sv_lens *lenses = r->plan.lenses;
  for (int i = 0; i < r->views.n_measurements; i++) {
    const lab_measurement *m = &r->views.measurements[i];
    sv_multiplexed model;
    sv_status s = lab_measurement_lenses(&r->views, i, lenses, &model, err);
    if (s == SV_OK) s = sv_train_add_measurement(&r->plan.trainer, &model, r->plan.measurements[i], err);
    if (s != SV_OK) return s;
    sv_train_set_clear(&r->plan.trainer, r->plan.clear[i]);
    lenses += m->n_lenses;
  }
  return SV_OK;
}

static sv_status load_pictures(run *r, sv_err *err) {
  sv_status s = lab_pictures_load(&r->views, r->plan.pictures, r->plan.masks, &r->session.pool, err);
  for (int i = 0; s == SV_OK && i < r->views.n_measurements; i++) {
    s = lab_measurement_load(&r->views.measurements[i], r->plan.measurements[i], err);
    if (s == SV_OK && r->plan.clear[i]) s = lab_measurement_clear(&r->views, i, r->plan.clear[i], err);
  }
  return s == SV_OK ? add_noise(r, err) : s;
}

// Points from the views themselves, where they overlap; else the random start stays.
static sv_status measure_points(run *r, sv_err *err) {
  sv_driver_start *start = &r->start;
  double t0 = lab_seconds(&r->session);
  start->cap_points = r->plan.trainer.g.n;
  if (!(start->points = malloc((size_t)start->cap_points * sizeof *start->points)))
    return sv_fail(err, SV_E_NOMEM, "no memory for %d points", start->cap_points);
  sv_status s = sv_driver_measure(&r->plan.trainer, start, err);
  if (s == SV_OK)
    lab_say(&r->session, "%d points from depth maps of %d views in %.2f s", start->n_points, start->n_maps,
            lab_seconds(&r->session) - t0);
  if (s != SV_AGAIN) return s;
  r->is_stereo = false;
  start->n_points = 0;
  if (r->o->init || sv_driver_n_views(&r->plan.trainer) > 1)
    lab_say(&r->session,
            "no depth maps of these views (too little overlap or parallax, or poses that are off): "
            "the start is random, and views far from the cameras may show little of the scene");
  return SV_OK;
}

static sv_status start(run *r, sv_err *err) {
  sv_driver_start *st = &r->start;
  st->bounds.radius = st->init.radius;
  memcpy(st->bounds.centre, st->init.centre, sizeof st->bounds.centre);
  st->scratch = &r->plan.scratch;
  sv_status s = r->is_stereo ? measure_points(r, err) : SV_OK;
  if (s == SV_OK) s = sv_driver_place(&r->plan.trainer, st, err);
  free(st->points);
  st->points = NULL;
  return s;
}

// --refine-poses: bundle adjustment on matches finds poses best. Training refines what it found,
// or, without matches, the poses as they are.
static sv_status adjust_poses(run *r, sv_err *err) {
  sv_err why = {.text = ""};
  bool is_right = false;
  if (!r->o->is_refining) return SV_OK;
  sv_status s = lab_poses_adjust(&r->views, &r->session, &is_right, &why);
  if (s == SV_E_NOMEM || s == SV_E_INTERRUPTED) return sv_fail(err, s, "%s", why.text);
  if (s != SV_OK) lab_say(&r->session, "poses are refined by training alone: %s", why.text);
  r->is_refining = r->is_aligned = s != SV_OK || !is_right;
  if (r->is_refining) lab_poses_plan(&r->views, s == SV_OK, &r->cfg);
  return SV_OK;
}

static sv_status load(run *r, sv_err *err) {
  double t0 = lab_seconds(&r->session);
  lab_source src = {.folder = r->o->data,
                    .transforms = r->o->transforms,
                    .split = "train",
                    .n_exposures = (int)r->o->exposures,
                    .is_multiplexed = true,
                    .is_white = r->cfg.background == SV_BG_WHITE,
                    .masks = r->o->masks,
                    .has_all_masks = true,
                    .scale = (int)r->o->scale};
  sv_status s = lab_views_open(&r->views, &src, &r->session.pool, err);
  if (s == SV_OK) {
    choose_antialiasing(r);
    choose_objective(r);
  }
  if (s == SV_OK) s = lab_appearance_plan(&r->views, r->o->appearance, &r->cfg, err);
  if (s == SV_OK) s = adjust_poses(r, err);
  if (s == SV_OK) s = choose_start(r, err);
  // depth maps give up to one for each
  r->extras.n_points = r->is_stereo ? r->cfg.n_gaussians : r->start.n_points;
  if (s == SV_OK) s = lab_plan_make(&r->plan, &r->session, &r->views, r->cfg, &r->extras, err);
  if (s == SV_OK) s = load_pictures(r, err);
  if (s == SV_OK) s = add_views(r, err);
  if (s == SV_OK) s = add_measurements(r, err);
  if (s == SV_OK && r->is_refining) lab_poses_set(&r->views, &r->plan.trainer);
  if (s == SV_OK) s = start(r, err);
  r->load_s = lab_seconds(&r->session) - t0;
  return s;
}

static sv_status call_prior(void *self, float progress, sv_driver_turn *turn, sv_err *err) {
  run *r = self;
  const double had_s = r->prior.seconds;
  (void)err;
  lab_prior_tick(&r->prior, progress);
  turn->away_s = r->prior.seconds - had_s; // what an external program takes does not count
  return SV_OK;
}

static sv_status train(run *r, sv_err *err) {
  sv_trainer *t = &r->plan.trainer;
  const sv_driver_cfg cfg = {.n_steps = (uint32_t)r->n_steps,
                             .limit_s = r->limit_s,
                             .clock = r->session.clock,
                             .scratch = &r->plan.scratch,
                             .console = r->session.console,
                             .self = r,
                             .before_step = call_prior};
  sv_status s = sv_driver_run(&r->driver, &cfg, t, err);
  r->is_stopped = s == SV_E_INTERRUPTED;
  if (r->is_stopped && t->step == 0)
    return sv_fail(err, SV_E_INTERRUPTED, "stopped by request before the first step");
  if (s < 0 && !r->is_stopped) return s;
  r->render = sv_train_render_options(t, 1.0f, false);
  if (!t->cfg.has_motion && r->o->is_eval) {
    sv_arena scratch = r->plan.scratch;
    sv_support support;
    if ((s = sv_driver_support(t, &scratch, &support)) < 0)
      return sv_fail(err, s, "which views saw the Gaussians cannot be told: %s", sv_status_text(s));
    r->support = sv_support_sum_up(&support, &t->g);
  }
  if (r->is_refining) {
    const lab_poses_moved m = lab_poses_measure(t);
    lab_say(&r->session, "poses refined: moved by %.3f degrees and %.4g units in the mean", m.deg, m.shift);
  }
  return SV_OK;
}

static lab_source eval_source(const lab_options *o) {
  return (lab_source){.folder = o->data,
                      .transforms = o->transforms,
                      .split = lab_default_split((int)o->exposures),
                      .n_exposures = (int)o->exposures,
                      .masks = o->masks,
                      .scale = (int)o->scale};
}

static sv_status evaluate(run *r, sv_err *err) {
  char folder[SV_CAP_PATH], refined[SV_CAP_PATH];
  lab_views v;
  lab_source src = eval_source(r->o), train = src;
  double t0 = lab_seconds(&r->session);
  sv_status s = lab_views_open(&v, &src, &r->session.pool, err);
  if (s == SV_OK) s = sv_path_join(folder, sizeof folder, r->o->out, "eval", err);
  if (s == SV_OK) s = sv_path_join(refined, sizeof refined, r->o->out, LAB_POSES_NAME, err);
  if (r->has_poses) train.refined = refined;
  lab_eval_job job = {.session = &r->session,
                      .g = &r->plan.trainer.g,
                      .render = r->render,
                      .panel_folder = folder,
                      .n_panels = N_PANELS,
                      .has_lpips = r->o->has_lpips,
                      .lpips_vgg = r->o->lpips_vgg,
                      .is_aligned = r->is_aligned,
                      .mask_from = r->o->mask ? &train : NULL,
                      .is_by_support = r->o->mask && sv_str_eq(r->o->mask, "supported")};
  job.render.has_depth = v.has_depth;
  job.motion.deform = r->plan.trainer.cfg.has_motion ? &r->plan.dynamic.deform : NULL;
  if (s == SV_OK) s = lab_evaluate(&v, &job, &r->scores, err);
  lab_views_free(&v);
  r->has_scores = s == SV_OK;
  // The paper's protocol: held-out frames of the training cameras.
  if (s == SV_OK && job.motion.deform) {
    src.split = "test_time";
    job.panel_folder = NULL;
    job.mask_from = NULL;
    s = lab_views_open(&v, &src, &r->session.pool, err);
    if (s == SV_E_NOT_FOUND) s = SV_OK; // the file marks none
    else if (s == SV_OK) {
      job.render.has_depth = v.has_depth;
      s = lab_evaluate(&v, &job, &r->time_scores, err);
      r->has_time_scores = s == SV_OK;
    }
    lab_views_free(&v);
  }
  r->eval_s = lab_seconds(&r->session) - t0;
  return s;
}

// --- what is written -----------------------------------------------------------------------------

static void report_support(lab_report *j, const sv_support_summary *m) {
  char text[256];
  sv_str s = sv_str_make(text, sizeof text);
  sv_str_add(&s, "\"support\": ");
  sv_driver_add_support(&s, m);
  lab_report_members(j, text);
}

static void report_figures(lab_report *j, const run *r) {
  if (r->has_scores) lab_report_text(j, "split", lab_default_split((int)r->o->exposures));
  if (r->has_scores) lab_scores_report(j, &r->scores);
  else lab_report_int(j, "views", r->views.n); // trained on; with scores: scored
  if (r->has_time_scores) lab_time_scores_report(j, &r->time_scores);
  if (r->plan.trainer.cfg.has_motion)
    lab_report_int(j, "moving", sv_deform_n_moving(&r->plan.dynamic.deform));
  lab_prior_report(j, &r->prior);
  lab_report_int(j, "training_views", r->views.n);
  if (r->views.n_masked) lab_report_int(j, "training_masks", r->views.n_masked);
  lab_report_int(j, "steps", (long long)r->plan.trainer.step);
  lab_report_int(j, "gaussians", r->plan.trainer.g.n);
  lab_report_num(j, "loss", r->driver.loss);
  if (r->views.n_measurements) lab_report_num(j, "measurement_psnr", r->measured_psnr);
  if (r->support.n_views) report_support(j, &r->support);
  lab_report_num(j, "seconds", r->driver.train_s);
  lab_report_num(j, "load_seconds", r->load_s);
  if (r->has_scores) lab_report_num(j, "eval_seconds", r->eval_s);
  lab_report_num(j, "steps_per_second", sv_driver_steps_per_s(&r->driver));
  lab_report_int(j, "threads", r->session.n_threads);
  lab_report_text(j, "isa", sv_isa_name(r->session.k.isa));
  lab_report_int(j, "arena_bytes", (long long)r->plan.bytes);
  lab_report_int(j, "peak_rss_bytes", lab_peak_rss_bytes());
  lab_report_hex(j, "digest", sv_train_digest(&r->plan.trainer));
}

static void report_settings(lab_report *j, const run *r) {
  const sv_trainer *t = &r->plan.trainer;
  const char *const kinds[] = {"sphere", "cube", "points"};
  char text[1024];
  sv_str settings = sv_str_make(text, sizeof text);
  sv_driver_add_settings(&settings, t);
  lab_report_text(j, "program", "subview-lab " LAB_VERSION);
  lab_report_text(j, "data", r->o->data);
  lab_report_text(j, "transforms", r->views.transforms);
  if (r->o->exposures > 0) lab_report_int(j, "exposures", r->o->exposures);
  lab_report_text(j, "model", t->cfg.has_motion ? "4dgs" : "3dgs");
  lab_report_text(j, "prior", r->o->prior ? r->o->prior : "none");
  if (r->n_steps > 0) lab_report_int(j, "steps_wanted", r->n_steps);
  else lab_report_num(j, "time_limit", r->limit_s);
  lab_report_text(j, "init", r->is_stereo ? "stereo" : kinds[r->start.init.kind]);
  lab_report_int(j, "scale", r->views.scale);
  lab_report_members(j, text);
  lab_report_text(j, "antialias", r->o->antialias ? r->o->antialias : "auto");
  if (r->o->noise) {
    lab_report_bool(j, "noise_on_prediction", r->o->is_noise_on_prediction);
    lab_report_num(j, "noise_read", (double)r->o->noise_read);
    lab_report_num(j, "noise_shot", (double)r->o->noise_shot);
  }
  // images of training and evaluation alike
  lab_report_bool(j, "undistorted", r->views.is_undistorted);
  lab_report_num(j, "near_z", (double)r->render.near_z);
  lab_report_bool(j, "stopped", r->is_stopped);
  if (r->has_poses) lab_report_text(j, "refined_poses", LAB_POSES_NAME);
}

// All are written before the first takes its place: what can fail or take long leaves an older
// model whole.
static sv_status save_in(run *r, const char *folder, sv_err *err) {
  enum { MODEL, MOTION, POSES, SETTINGS, N_FILES };
  sv_file files[N_FILES];
  char model[SV_CAP_PATH], path[SV_CAP_PATH];
  lab_report j;
  sv_model_notes notes = sv_driver_notes(&r->plan.trainer);
  notes.up = sv_up_name(r->scene.up);
  notes.unit = r->views.unit;
  const bool is_dynamic = r->plan.trainer.cfg.has_motion;
  const sv_gaussians *g = &r->plan.trainer.g;
  for (int i = 0; i < N_FILES; i++) sv_file_init(&files[i]);
  if (r->is_refining) {
    sv_err why; // the dataset may be gone by now; the model is worth more than its poses
    r->has_poses =
        lab_poses_begin(&files[POSES], &r->views, &r->plan.trainer, r->o->data, folder, &why) == SV_OK;
    if (!r->has_poses) {
      sv_file_abandon(&files[POSES]);
      lab_say(&r->session, "the refined poses are not saved: %s", why.text);
    }
  }
  lab_report_begin(&j);
  report_settings(&j, r);
  report_figures(&j, r);
  lab_report_end(&j);
  sv_status s = sv_path_join(model, sizeof model, folder, "model.ply", err);
  if (s == SV_OK) s = sv_path_join(path, sizeof path, folder, "train.json", err);
  if (s == SV_OK) s = lab_model_begin(&files[MODEL], g, &notes, model, err);
  if (s == SV_OK && is_dynamic) s = lab_motion_begin(&files[MOTION], &r->plan.dynamic.deform, g, model, err);
  if (s == SV_OK && j.is_failed) s = sv_fail(err, SV_E_NOMEM, "%s: no memory for its text", path);
  if (s == SV_OK) s = sv_file_begin(&files[SETTINGS], path, err);
  if (s == SV_OK) s = sv_file_append(&files[SETTINGS], j.text, j.bytes, err);
  lab_report_free(&j);
  for (int i = 0; i < N_FILES; i++)
    if (s == SV_OK && files[i].dir_fd >= 0) s = sv_file_commit(&files[i], err);
    else if (s == SV_OK && i == MOTION) s = lab_motion_remove(model, err); // of an earlier model
    else if (s != SV_OK) sv_file_abandon(&files[i]);
  return s;
}

// A disk may refuse for a moment; a model that took an hour is worth a few more seconds, and a
// second place.
static sv_status save(run *r, sv_err *err) {
  const sv_clock *c = &r->session.clock;
  sv_status s = save_in(r, r->o->out, err);
  for (int i = 1; s == SV_E_IO && i < N_SAVES; i++) {
    if (i == 1) r->session.console.log(r->session.console.self, SV_LOG_WARN, err->text);
    c->sleep_until_ns(c->self, c->now_ns(c->self) + (FIRST_WAIT_NS << (i - 1)));
    s = save_in(r, r->o->out, err);
  }
  char place[SV_LINUX_CAP_PATH];
  sv_err second;
  if (s != SV_E_IO || sv_linux_rescue_dir(place, sizeof place, &second) < 0) return s;
  if (save_in(r, place, &second) < 0) {
    (void)rmdir(place);
    return s;
  }
  const sv_err why = *err;
  return sv_fail(err, s, "%.150s; the model is saved in %s instead", why.text, place);
}

static sv_status print(const run *r, sv_err *err) {
  if (r->o->is_json) {
    lab_report j;
    lab_report_begin(&j);
    report_figures(&j, r);
    lab_report_end(&j);
    return lab_report_print(&j, err);
  }
  printf("trained %d Gaussians on %d view%s: %u steps in %.1f s (%.1f steps/s), loss %.4f%s\n",
         r->plan.trainer.g.n, r->views.n, r->views.n == 1 ? "" : "s", r->plan.trainer.step, r->driver.train_s,
         sv_driver_steps_per_s(&r->driver), r->driver.loss, r->is_stopped ? ", stopped early" : "");
  if (r->has_poses) printf("refined poses: %s/" LAB_POSES_NAME "\n", r->o->out);
  if (r->has_scores) {
    printf("%s views %d: ", lab_default_split((int)r->o->exposures), r->scores.n);
    lab_scores_print(&r->scores);
    printf("\n");
  }
  printf("model: %s/model.ply, settings and figures: %s/train.json%s%s%s\n", r->o->out, r->o->out,
         r->has_scores ? ", images: " : "", r->has_scores ? r->o->out : "", r->has_scores ? "/eval" : "");
  return SV_OK;
}

static sv_status check_eval(const run *r, sv_err *err) { // before an hour of training, not after
  lab_views v;
  lab_source src = eval_source(r->o);
  sv_status s = lab_views_open(&v, &src, &r->session.pool, err);
  lab_views_free(&v);
  return s;
}

static sv_status stages(run *r, sv_err *err) {
  sv_status s = load(r, err);
  if (s == SV_OK && r->o->is_eval) s = check_eval(r, err);
  if (s == SV_OK) s = lab_session_folder(&r->session, r->o->out, err);
  if (s != SV_OK) return s;
  lab_say(&r->session, "%d view%s of up to %dx%d%s, %d Gaussians, %.1f MB, loaded in %.2f s", r->views.n,
          r->views.n == 1 ? "" : "s", r->views.cap_width_px, r->views.cap_height_px,
          r->views.is_undistorted ? " (undistorted)" : "", r->plan.trainer.g.n, 1e-6 * (double)r->plan.bytes,
          r->load_s);
  r->plan.prior.is_covered = r->is_stereo;
  s = lab_prior_begin(&r->prior, &(lab_prior_input){&r->session, r->o, &r->views, &r->plan.prior},
                      &r->start.bounds, &r->plan.scratch, err);
  if (s != SV_OK || (s = train(r, err)) != SV_OK) return s;
  r->measured_psnr = lab_measured_psnr(&r->plan.trainer, &r->render);
  if ((s = save(r, err)) != SV_OK) return s; // whatever comes later, the model is there
  if (r->o->is_eval && !r->is_stopped) {
    if ((s = evaluate(r, err)) != SV_OK) return s;
    lab_say(&r->session, "evaluated in %.2f s: loading %.2f, rendering %.2f, comparing %.2f", r->eval_s,
            r->scores.load_s, r->scores.render_s, r->scores.compare_s);
    if ((s = save(r, err)) != SV_OK) return s;
  }
  return SV_OK;
}

int lab_cmd_train(const lab_options *given) {
  sv_err err = {0};
  static char folder[SV_CAP_PATH]; // of the dataset
  static lab_options found;
  const lab_options *o = &found;
  int code = check_init(given);
  if (code == LAB_EXIT_OK) code = lab_prior_check(given);
  if (code != LAB_EXIT_OK) return code;
  found = *given;
  found.data = folder;
  run *r = calloc(1, sizeof *r);
  if (!r) return LAB_EXIT_FAILED;
  r->o = o;
  r->cfg = train_cfg(o, &r->extras.dynamic);
  r->n_steps = o->time_limit_s > 0 ? 0 : r->cfg.expected_steps;
  r->limit_s = o->time_limit_s;
  sv_status s = lab_session_start(&r->session, o->threads, o->is_quiet, &err);
  if (s == SV_OK) s = sv_linux_catch_signals(&err);
  if (s == SV_OK) s = lab_find_dataset(given, folder, &err);
  if (s == SV_OK) s = stages(r, &err);
  sv_linux_console_finish(&r->session.lines);
  if (s == SV_OK) s = print(r, &err);
  if (s == SV_OK && o->is_opened) s = lab_open_model(&r->session, o, &err);
  if (s != SV_OK) code = lab_failed(&r->session, &err);
  lab_session_stop(&r->session);
  free(r->start.points);
  lab_prior_end(&r->prior);
  lab_views_free(&r->views);
  lab_plan_free(&r->plan);
  free(r);
  return code;
}
