// SPDX-License-Identifier: Apache-2.0
// The step between capture and training of a run whose source tells no poses.
#include "src/run/app.h"
#include "src/base/str.h"

#define SCALE_DOUBT 0.02 // a relative standard deviation of the scale that is worth a warning

static void log_odometry(sv_app *app) {
  const sv_track_summary *s = &app->odometry.summary;
  if (s->is_still) {
    sv_app_log(app, SV_LOG_INFO, "odometry: stationary rig (images move by %.2f px)", s->still_px);
    if (s->n_placed < s->n_exposures)
      sv_app_log(app, SV_LOG_WARN, "odometry: %d exposures overlap too little with the first one%s",
                 s->n_exposures - s->n_placed, app->odometry.is_tracked ? " and are skipped" : "");
    return;
  }
  if (!app->odometry.is_tracked) {
    sv_app_log(app, SV_LOG_WARN,
               "odometry: located only %d of %d exposures from %d points; assuming a stationary rig; %s",
               s->n_placed, s->n_exposures, s->n_points,
               app->cfg.rig->n_sub_views < 2
                   ? "a single camera cannot measure how far it moves"
                   : "expected a textured scene and exposures at most about 12 degrees apart");
    return;
  }
  char scale[32] = "unknown";
  if (s->scale_sigma >= 0) sv_fmt(scale, sizeof scale, "+- %.2f %%", 100 * s->scale_sigma);
  sv_app_log(
      app, SV_LOG_INFO,
      "odometry: located %d of %d exposures over a %.2f m path, %d points, reprojection %.2f px, scale %s",
      s->n_placed, s->n_exposures, s->path_m, s->n_points, s->rms_px, scale);
  if (s->n_placed < s->n_exposures)
    sv_app_log(app, SV_LOG_WARN,
               "odometry: %d exposures could not be located and are skipped; move more slowly or take more "
               "exposures",
               s->n_exposures - s->n_placed);
  if (s->scale_sigma < 0 || s->scale_sigma > SCALE_DOUBT)
    sv_app_log(app, SV_LOG_WARN,
               "odometry: the rig's baseline is too small to measure the scale of this scene: lengths may be "
               "off by a "
               "factor, shape and views are not");
}

// Runs that are not tracked: a rig on a tripod is meant to be so, one in a hand should know.
static void log_untracked(sv_app *app) {
  const sv_app_cfg *c = &app->cfg;
  if (c->n_exposures < 2) return;
  for (int e = 0; e < app->exposures.n; e++)
    if (app->exposures.exposure[e].has_pose) return;
  sv_app_log(app, SV_LOG_INFO, "the source has no poses and %s; assuming a stationary rig",
             c->is_continuous                            ? "--live does not track"
             : c->is_dynamic                             ? "a moving scene is not tracked"
             : c->rig->forward == SV_FORWARD_MULTIPLEXED ? "a multiplexed sensor is not tracked"
                                                         : "tracking is off");
}

sv_status sv_app_track(sv_app *app, sv_err *err) {
  sv_odometry *o = &app->odometry;
  if (!o->is_on) {
    log_untracked(app);
    return SV_OK;
  }
  for (int e = 0; e < app->exposures.n; e++)
    if (app->exposures.exposure[e].has_pose) return SV_OK; // the source knew after all
  for (int e = 0; e < app->exposures.n; e++) {
    sv_app_beat(app);
    if (sv_app_is_stop_requested(app)) return SV_E_INTERRUPTED;
    sv_status s = sv_odometry_add(o, &app->exposures, e);
    if (s < 0) return sv_fail(err, s, "odometry, exposure %d: %s", e, sv_status_text(s));
    sv_app_log(app, SV_LOG_LIVE, "odometry %d/%d exposures", e + 1, app->exposures.n);
  }
  sv_odometry_finish(o, &app->exposures);
  log_odometry(app);
  return SV_OK;
}
