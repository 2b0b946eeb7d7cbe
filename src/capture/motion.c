// SPDX-License-Identifier: Apache-2.0
#include "src/capture/motion.h"

#define MAX_GAP_NS (SV_NS_PER_S / 2)

// The located exposure next to time_ns, before it (sign -1) or after it (1); -1: none near enough.
static int neighbor(const sv_exposures *e, sv_ns time_ns, int sign) {
  int best = -1;
  for (int i = 0; i < e->n; i++) {
    const sv_ns gap = sign * (e->exposure[i].time_ns - time_ns);
    if (!e->exposure[i].has_pose || gap <= 0 || gap > MAX_GAP_NS) continue;
    if (best < 0 || gap < sign * (e->exposure[best].time_ns - time_ns)) best = i;
  }
  return best;
}

static double gap_s(const sv_exposure *a, const sv_exposure *b) {
  const double s = sv_ns_to_s(a->time_ns - b->time_ns);
  return s < 0 ? -s : s;
}

sv_motion_summary sv_exposures_find_motion(sv_exposures *e) {
  sv_motion_summary sum = {0};
  for (int i = 0; i < e->n; i++) {
    sv_exposure *x = &e->exposure[i];
    if (x->has_pose && !x->has_motion) {
      const int before = neighbor(e, x->time_ns, -1), after = neighbor(e, x->time_ns, 1);
      const sv_exposure *b = before < 0 ? x : &e->exposure[before], *a = after < 0 ? x : &e->exposure[after];
      x->has_motion = sv_motion_between(x->motion, &x->rig_from_world, &b->rig_from_world, gap_s(x, b),
                                        &a->rig_from_world, gap_s(a, x));
    }
    if (!x->has_motion) continue;
    sum.n++;
    sum.turn_rad_s += sv_dot3(x->motion, x->motion);
    sum.move += sv_dot3(x->motion + 3, x->motion + 3); // the rig's place moves by -R^T v
  }
  if (sum.n > 0) {
    sum.turn_rad_s = sqrt(sum.turn_rad_s / sum.n);
    sum.move = sqrt(sum.move / sum.n);
  }
  return sum;
}

bool sv_exposures_rolling(const sv_exposures *e, int i, int i_sub, sv_row_time *time, double motion[6]) {
  const sv_exposure *x = &e->exposure[i];
  if (!e->sub || !x->has_motion || !(e->sub[i_sub].row_time.max_s > 0)) return false;
  *time = e->sub[i_sub].row_time;
  sv_motion_of_camera(motion, x->motion, &e->cfg.rig->sub_views[i_sub].cam_from_rig);
  return true;
}
