// SPDX-License-Identifier: Apache-2.0
// Rolling shutters: row times enter the reprojection by the rig's motion at each exposure, which
// comes from the poses around it and is found again before each adjustment.
#include <string.h>

#include "src/base/mathx.h"
#include "src/track/tracker.h"

#define MAX_GAP_S 0.5 // between exposures that tell each other's motion

void sv_tracker_set_time(sv_tracker *t, double time_s) {
  if (t->cfg.row_time && t->n_exposures < t->cfg.cap_exposures) t->time_s[t->n_exposures] = time_s;
}

double sv_track_row_s(const sv_tracker *t, int i_view, const float uv_px[2]) {
  const sv_bundle_camera *c = &t->cam[i_view];
  if (!t->cfg.row_time) return 0;
  return sv_row_time_at(&t->cfg.row_time[t->sub_view[i_view]], ((double)uv_px[0] - c->cx) / c->fx,
                        ((double)uv_px[1] - c->cy) / c->fy);
}

sv_pose sv_track_pose_at(const sv_tracker *t, int i_exposure, int i_view, const float uv_px[2]) {
  const double s = sv_track_row_s(t, i_view, uv_px);
  sv_pose p = t->pose[i_exposure];
  double turn[9], at[3];
  if (s == 0) return p;
  sv_motion_apply(at, t->motion[i_exposure], s, p.t, turn);
  sv_mul33(p.r, turn, p.r);
  memcpy(p.t, at, sizeof at);
  return p;
}

// The next located exposure from i on in a direction, within [first, first + n); -1: none near
// enough to e.
static int neighbor(const sv_tracker *t, int first, int n, int e, int i, int step) {
  for (i += step; i >= first && i < first + n; i += step)
    if (t->is_placed[i]) return fabs(t->time_s[i] - t->time_s[e]) <= MAX_GAP_S ? i : -1;
  return -1;
}

void sv_track_beside(const sv_tracker *t, int first, int n, int i, int beside[2], double slope[2]) {
  const int e = first + i;
  double gap_s[2];
  beside[0] = neighbor(t, first, n, e, e, -1);
  beside[1] = neighbor(t, first, n, e, e, 1);
  // At an end, two on the same side.
  if (beside[0] < 0 && beside[1] >= 0) beside[0] = neighbor(t, first, n, e, beside[1], 1);
  else if (beside[1] < 0 && beside[0] >= 0) beside[1] = neighbor(t, first, n, e, beside[0], -1);
  for (int k = 0; k < 2; k++) {
    gap_s[k] = beside[k] < 0 || !t->is_placed[e] ? 0 : t->time_s[beside[k]] - t->time_s[e];
    beside[k] = beside[k] < 0 ? -1 : beside[k] - first;
  }
  sv_motion_slopes(slope, gap_s[0], gap_s[1]);
}

void sv_track_find_motion(sv_tracker *t, int first, int n) {
  for (int e = first; t->cfg.row_time && e < first + n; e++) {
    int beside[2];
    double slope[2];
    sv_track_beside(t, 0, t->n_exposures, e, beside, slope);
    sv_motion_from(t->motion[e], slope, &t->pose[e], &t->pose[sv_maxi(beside[0], 0)],
                   &t->pose[sv_maxi(beside[1], 0)]);
  }
}
