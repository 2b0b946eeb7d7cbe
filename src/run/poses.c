// SPDX-License-Identifier: Apache-2.0
// What training made of the rig's poses.
#include "src/run/app.h"
#include "src/base/mathx.h"

#define LINE_BYTES 512

void sv_app_take_poses(sv_app *app) {
  double sum_rad = 0, sum = 0;
  int n = 0;
  for (int i = 0; i < app->trainer.n_views; i++) {
    const int e = app->trainer.poses.pose_of[i];
    if (i > 0 && e == app->trainer.poses.pose_of[i - 1]) continue; // the exposure's first view
    const sv_train_pose *p = &app->trainer.poses.pose[e];
    sv_pose back = sv_pose_inv(&p->start);
    sv_pose moved = sv_pose_mul(&p->rig_from_world, &back);
    double w[3], a[3], b[3];
    sv_rodrigues_inv(w, moved.r);
    sv_pose_centre(a, &p->rig_from_world);
    sv_pose_centre(b, &p->start);
    sv_sub3(a, a, b);
    sum_rad += sv_norm3(w);
    sum += sv_norm3(a);
    n++;
    app->exposures.exposure[e].rig_from_world = p->rig_from_world;
  }
  if (n > 0)
    sv_app_log(app, SV_LOG_INFO, "poses of %d exposures: refined by %.3f degrees and %.4f m in the mean", n,
               sum_rad / n * 180 / SV_PI, sum / n);
}

sv_status sv_app_write_poses(sv_app *app, sv_sink sink, sv_err *err) {
  static const char tail[] = "\n]}\n";
  const bool is_tracked = app->odometry.is_tracked;
  char line[LINE_BYTES];
  bool has = false;
  sv_str head = sv_str_make(line, sizeof line);
  sv_str_add(&head, "{\"version\": 1, ");
  if (is_tracked && app->odometry.summary.scale_sigma > 0)
    sv_str_add(&head, "\"scale_sigma\": %.3g, ", app->odometry.summary.scale_sigma);
  sv_str_add(&head, "\"poses\": [");
  sv_status s = sink.write(sink.self, head.buf, head.len, err);
  for (int i = 0; i < app->exposures.n && s >= 0; i++) {
    const sv_exposure *e = &app->exposures.exposure[i];
    double q[4];
    const double *t = e->rig_from_world.t;
    sv_str out = sv_str_make(line, sizeof line);
    if (is_tracked && !e->has_pose) continue;
    sv_quat_from_mat(q, e->rig_from_world.r);
    sv_str_add(
        &out,
        "%s\n  {\"time_ns\": %lld, \"rig_from_world\": [%.17g, %.17g, %.17g, %.17g, %.17g, %.17g, %.17g]}",
        has ? "," : "", (long long)e->time_ns, q[0], q[1], q[2], q[3], t[0], t[1], t[2]);
    has = true;
    s = sink.write(sink.self, out.buf, out.len, err);
  }
  return s < 0 ? s : sink.write(sink.self, tail, sizeof tail - 1, err);
}
