// SPDX-License-Identifier: Apache-2.0
#include "src/capture/motion.h"

sv_motion_summary sv_exposures_motion(const sv_exposures *e) {
  sv_motion_summary sum = {0};
  for (int i = 0; i < e->n; i++) {
    const double *m = e->exposure[i].motion;
    if (!e->exposure[i].has_motion) continue;
    sum.n++;
    sum.turn_rad_s += sv_dot3(m, m);
    sum.move += sv_dot3(m + 3, m + 3); // the rig's place moves by -R^T v
  }
  if (sum.n < 1) return sum;
  sum.turn_rad_s = sqrt(sum.turn_rad_s / sum.n);
  sum.move = sqrt(sum.move / sum.n);
  return sum;
}

bool sv_exposures_rolling(const sv_exposures *e, int i, int i_sub, sv_row_time *time, double motion[6]) {
  const sv_exposure *x = &e->exposure[i];
  if (!e->sub || !x->has_motion || !(e->sub[i_sub].row_time.max_s > 0)) return false;
  *time = e->sub[i_sub].row_time;
  sv_motion_of_camera(motion, x->motion, &e->cfg.rig->sub_views[i_sub].cam_from_rig);
  return true;
}
