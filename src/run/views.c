// SPDX-License-Identifier: Apache-2.0
// From the pool of exposures to the views of the trainer.
#include "src/run/app.h"
#include "src/base/mathx.h"
#include "src/capture/motion.h"

static void set_rolling(sv_app *app, int i_view, int e, int i_sub) {
  sv_row_time time;
  double motion[6];
  const bool is_rolling = sv_exposures_rolling(&app->exposures, e, i_sub, &time, motion);
  if (is_rolling) sv_train_set_rolling(&app->trainer, i_view, &time, motion);
}

static void set_deep(sv_app *app, int i_view, int e, int i_sub) {
  sv_image_deep deep;
  if (!app->cfg.is_deep) return;
  sv_exposures_deep(&app->exposures, e, i_sub, &deep);
  sv_train_set_deep(&app->trainer, i_view, &deep);
}

void sv_app_take_light(sv_app *app) {
  int i_view = 0;
  if (!app->cfg.is_deep) return;
  sv_exposures_take_light(&app->exposures);
  for (int e = 0; e < app->exposures.n; e++) {
    if (app->odometry.is_tracked && !app->exposures.exposure[e].has_pose) continue;
    for (int i = 0; i < app->cfg.rig->n_sub_views; i++)
      if (sv_app_is_trained_on(&app->cfg, i)) set_deep(app, i_view++, e, i);
  }
}

void sv_app_describe_view(sv_app *app, int i_view, int e, int i_sub) {
  set_deep(app, i_view, e, i_sub);
  set_rolling(app, i_view, e, i_sub);
}

static sv_status add_pictures(sv_app *app, int e, sv_err *err) {
  for (int i = 0; i < app->cfg.rig->n_sub_views; i++) {
    sv_image_u8 image;
    sv_view view;
    if (!sv_app_is_trained_on(&app->cfg, i)) continue;
    sv_exposures_get(&app->exposures, e, i, &image, &view);
    view.time = sv_app_time_of(app, app->exposures.exposure[e].time_ns);
    sv_status s = sv_train_add_view(&app->trainer, &view, &image, err);
    if (s < 0) return s;
    sv_app_describe_view(app, app->trainer.n_views - 1, e, i);
    sv_train_set_appearance(&app->trainer, app->trainer.n_views - 1, app->cfg.rig->sub_views[i].i_camera, e);
    if (app->cfg.is_refining)
      sv_train_refine_view(&app->trainer, app->trainer.n_views - 1, e,
                           &app->cfg.rig->sub_views[i].cam_from_rig,
                           &app->exposures.exposure[e].rig_from_world,
                           app->trainer.views[0].view.i_exposure == view.i_exposure);
  }
  return SV_OK;
}

static sv_status add_measurements(sv_app *app, int e, sv_err *err) {
  const sv_measurements *pool = &app->exposures.measurements;
  for (int i = 0; i < pool->n_sensors; i++) {
    sv_multiplexed model;
    const uint16_t *px;
    sv_measurements_get(pool, e, i, &model, &px);
    sv_status s = sv_train_add_measurement(&app->trainer, &model, px, err);
    if (s < 0) return s;
  }
  return SV_OK;
}

sv_status sv_app_add_views(sv_app *app, int e, sv_err *err) {
  const bool is_multiplexed = app->cfg.rig->forward == SV_FORWARD_MULTIPLEXED;
  return is_multiplexed ? add_measurements(app, e, err) : add_pictures(app, e, err);
}

// How the rig moves while the lines of its cameras are read.
static void log_motion(sv_app *app) {
  if (!app->trainer.cfg.is_rolling) return;
  const sv_motion_summary m = sv_exposures_motion(&app->exposures);
  sv_app_log(app, SV_LOG_INFO,
             "rolling shutter: motion of %d of %d exposures known, %.1f degrees/s and %.2f m/s in the mean",
             m.n, app->exposures.n, m.turn_rad_s * 180 / SV_PI, m.move);
}

static void log_deep(sv_app *app) {
  bool is_known = true;
  if (!app->cfg.is_deep) return;
  for (int i = 0; i < app->cfg.rig->n_sub_views; i++) {
    const sv_sensor_noise *n = &app->cfg.rig->sub_views[i].noise;
    is_known &= n->read > 0 || n->shot > 0;
  }
  sv_app_log(app, SV_LOG_INFO, "16 bits: white is %.3g of the sensor's range; noise %s",
             (double)app->exposures.white,
             is_known ? "of the rig" : "of a usual sensor (the rig has none: subview-calibrate noise)");
}

void sv_app_log_views(sv_app *app) {
  log_motion(app);
  log_deep(app);
}
