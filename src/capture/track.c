// SPDX-License-Identifier: Apache-2.0
// The step between capture and training of a run whose source tells no poses.
#include "src/capture/capture.h"

#include "src/base/str.h"

static void log_odometry(sv_capture_side *c, const sv_odometry *o) {
  const sv_track_summary *s = &o->summary;
  if (s->is_still) {
    sv_capture_side_log(c, SV_LOG_INFO, "odometry: stationary rig (images move by %.2f px)", s->still_px);
    if (s->n_placed < s->n_exposures)
      sv_capture_side_log(c, SV_LOG_WARN, "odometry: %d exposures overlap too little with the first one%s",
                          s->n_exposures - s->n_placed, o->is_tracked ? " and are skipped" : "");
    return;
  }
  if (!o->is_tracked) {
    sv_capture_side_log(
        c, SV_LOG_WARN,
        "odometry: located only %d of %d exposures from %d points; assuming a stationary rig; %s",
        s->n_placed, s->n_exposures, s->n_points,
        c->cfg.rig->n_sub_views < 2
            ? "a single camera cannot measure how far it moves"
            : "expected a textured scene and exposures at most about 12 degrees apart");
    return;
  }
  char scale[32] = "unknown";
  if (s->scale_sigma >= 0) sv_fmt(scale, sizeof scale, "+- %.2f %%", 100 * s->scale_sigma);
  sv_capture_side_log(c, SV_LOG_INFO,
                      "odometry: located %d of %d exposures over a %.2f m path, %d points (%d times seen "
                      "again), reprojection "
                      "%.2f px, scale %s",
                      s->n_placed, s->n_exposures, s->path_m, s->n_points, s->n_seen_again, s->rms_px, scale);
  if (s->n_placed < s->n_exposures)
    sv_capture_side_log(
        c, SV_LOG_WARN,
        "odometry: %d exposures could not be located and are skipped; move more slowly or take more "
        "exposures",
        s->n_exposures - s->n_placed);
  if (s->scale_sigma < 0 || s->scale_sigma > SV_ODOMETRY_SCALE_DOUBT)
    sv_capture_side_log(
        c, SV_LOG_WARN,
        "odometry: the rig's baseline is too small to measure the scale of this scene: lengths may be "
        "off by a "
        "factor, shape and views are not");
}

// Runs that are not tracked: a rig on a tripod is meant to be so, one in a hand should know.
static void log_untracked(sv_capture_side *c, const char *why) {
  if (c->cfg.n_exposures < 2) return;
  for (int e = 0; e < c->cfg.exposures->n; e++)
    if (c->cfg.exposures->exposure[e].has_pose) return;
  sv_capture_side_log(c, SV_LOG_INFO, "the source has no poses and %s; assuming a stationary rig", why);
}

sv_status sv_capture_side_track(sv_capture_side *c, sv_odometry *o, const char *why_untracked, sv_err *err) {
  if (!o->is_on) {
    log_untracked(c, why_untracked);
    return SV_OK;
  }
  for (int e = 0; e < c->cfg.exposures->n; e++)
    if (c->cfg.exposures->exposure[e].has_pose) return SV_OK; // the source knew after all
  // Those that were placed as they came are behind it.
  for (int e = o->tracker.n_exposures; e < c->cfg.exposures->n; e++) {
    if (c->cfg.calls.poll(c->cfg.calls.self) < 0) return SV_E_INTERRUPTED;
    sv_status s = sv_odometry_add(o, c->cfg.exposures, e);
    if (s < 0) return sv_fail(err, s, "odometry, exposure %d: %s", e, sv_status_text(s));
    sv_capture_side_log(c, SV_LOG_LIVE, "odometry %d/%d exposures", e + 1, c->cfg.exposures->n);
  }
  sv_odometry_finish(o, c->cfg.exposures);
  log_odometry(c, o);
  return SV_OK;
}
