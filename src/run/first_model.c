// SPDX-License-Identifier: Apache-2.0
// From captured exposures to a model that can be trained: views of the trainer, then first
// Gaussians from depth maps, odometry's points or random ones, or the checkpoint of an earlier run.
#include "src/run/app.h"
#include "src/train/seed.h"

#define NEIGHBOURS_NS (70 * SV_NS_PER_US)

static void beat(void *self) { sv_app_beat(self); }

// Where the first Gaussians are, without a look at the surface: on odometry's points, in the known
// bounds, or on rays through the images.
static void choose_blind(sv_app *app, sv_driver_start *start) {
  sv_trainer *t = &app->trainer;
  const sv_bounds *b = &start->bounds;
  bool is_tracked = app->odometry.is_tracked;
  start->init = (sv_init_cfg){.kind = app->cfg.has_bounds && !is_tracked ? SV_INIT_SPHERE : SV_INIT_POINTS,
                              .centre = {b->centre[0], b->centre[1], b->centre[2]},
                              .radius = b->radius,
                              .opacity = 0.1f,
                              .scale_factor = 1.0f,
                              .seed = t->cfg.seed};
  start->is_scene_set = true;
  start->n_points = start->init.kind == SV_INIT_POINTS ? t->g.n : 0;
  if (is_tracked) start->n_points = sv_odometry_cloud(&app->odometry, app->points, t->g.n);
  else if (start->n_points) sv_seed_points(t, b, t->cfg.seed, app->points, t->g.n);
}

// is_measured: on the surface, where views overlap.
static sv_status first_model(sv_app *app, const sv_bounds *b, bool is_measured, sv_err *err) {
  sv_trainer *t = &app->trainer;
  sv_driver_start start = {
      .bounds = *b, .points = app->points, .cap_points = t->g.n, .scratch = &app->scratch};
  start.beat = beat;
  start.self = app;
  sv_status s = is_measured ? sv_driver_measure(t, &start, err) : SV_AGAIN;
  if (s == SV_OK)
    sv_app_log(app, SV_LOG_INFO, "first model: %d points from the depth maps of %d views", start.n_points,
               start.n_maps);
  else if (s == SV_AGAIN && is_measured && sv_driver_n_views(t) > 1 && !app->odometry.is_tracked)
    sv_app_log(
        app, SV_LOG_WARN,
        "no depth maps of these views (too little overlap or parallax, or a calibration that is off): the "
        "first model is random, and views far from the cameras may show little of the scene");
  app->prior.is_covered = s == SV_OK;
  if (s == SV_AGAIN) choose_blind(app, &start);
  // Their nearest neighbours: 7 us a Gaussian on x86-64, ten times as long on a slow board.
  sv_beat_for(app->port.heartbeats, SV_BEAT_MAIN, NEIGHBOURS_NS * t->g.n);
  // Points of a surface; without depth maps and odometry there are none.
  sv_guidance_set_scene(&app->capture.guidance, b, app->points,
                        s == SV_OK || app->odometry.is_tracked ? start.n_points : 0);
  return s < 0 ? s : sv_driver_place(t, &start, err);
}

static sv_bounds bounds_of_views(sv_app *app) {
  const size_t mark = sv_arena_mark(&app->scratch);
  const int n = sv_driver_n_views(&app->trainer);
  sv_view *views = SV_TAKE(&app->scratch, sv_view, n);
  for (int i = 0; i < n; i++) views[i] = *sv_driver_view(&app->trainer, i);
  const sv_bounds b = sv_bounds_of_views(views, n);
  sv_arena_reset(&app->scratch, mark);
  return b;
}

static sv_status first_or_resumed(sv_app *app, sv_err *err) {
  const bool is_tracked = app->odometry.is_tracked;
  sv_app_log_views(app);
  sv_exposures_note_light(&app->exposures);
  sv_app_begin_moving(app);
  for (int e = 0; e < app->exposures.n; e++) {
    if (is_tracked && !app->exposures.exposure[e].has_pose) continue; // nobody knows where it was
    const sv_status added = sv_app_add_views(app, e, err);
    if (added < 0) return added;
  }
  bool has_bounds = app->cfg.has_bounds && !is_tracked; // bounds are of a world that was not found
  sv_bounds b = has_bounds ? app->cfg.bounds : bounds_of_views(app);
  if (is_tracked) b = sv_odometry_bounds(&app->odometry);
  if (!app->cfg.is_resume) return first_model(app, &b, true, err);
  sv_status s = first_model(app, &b, false, err); // a checkpoint replaces it
  if (s >= 0) s = sv_app_resume(app, err);
  if (s >= 0 && s != SV_AGAIN) sv_app_take_light(app);
  if (s != SV_AGAIN) return s;
  sv_app_log(app, SV_LOG_INFO, "no checkpoint.bin in the output folder; starting at step 0");
  return first_model(app, &b, true, err);
}

void sv_app_hold(sv_app *app, bool is_kept) {
  sv_exposures_hold(&app->exposures, is_kept);
  for (int i = 0; i < app->trainer.n_views; i++) sv_train_mask_changed(&app->trainer, i);
}

sv_status sv_app_start_training(sv_app *app, sv_err *err) {
  // Depth maps need all pixels: a gap in the first model stays one where few exposures look.
  if (app->cfg.is_held_released) sv_app_hold(app, false);
  sv_status s = first_or_resumed(app, err);
  if (app->cfg.is_held_released) sv_app_hold(app, true);
  return s;
}
