// SPDX-License-Identifier: Apache-2.0
#include "tools/train/poses.h"

#include "src/base/mathx.h"

// The first frame of frame i's exposure.
static int first_of(const lab_views *v, int i) {
  const int e = v->frames[i].f.exposure;
  for (int k = 0; e >= 0 && k < i; k++)
    if (v->frames[k].f.exposure == e) return k;
  return i;
}

void lab_poses_plan(const lab_views *v, sv_train_cfg *cfg) {
  cfg->poses = sv_train_poses_defaults();
  for (int i = 0; i < v->n; i++) cfg->poses.cap_poses += first_of(v, i) == i;
}

void lab_poses_set(const lab_views *v, sv_trainer *t) {
  int n = 0;
  for (int i = 0; i < v->n; i++) {
    const int first = first_of(v, i);
    const sv_pose *rig = &v->frames[first].f.cam_from_world; // the rig's frame is its first view's
    const sv_pose back = sv_pose_inv(rig), mount = sv_pose_mul(&v->frames[i].f.cam_from_world, &back);
    const int pose = first == i ? n++ : t->poses.pose_of[first];
    sv_train_refine_view(t, i, pose, &mount, rig, pose == 0);
  }
}

lab_poses_moved lab_poses_measure(const sv_trainer *t) {
  lab_poses_moved m = {0};
  for (int i = 0; i < t->n_views; i++) {
    const int e = t->poses.pose_of[i];
    double w[3], a[3], b[3];
    if (e < m.n) continue; // counted: poses are numbered in order of their first views
    const sv_train_pose *p = &t->poses.pose[e];
    const sv_pose back = sv_pose_inv(&p->start), d = sv_pose_mul(&p->rig_from_world, &back);
    sv_rodrigues_inv(w, d.r);
    sv_pose_centre(a, &p->rig_from_world);
    sv_pose_centre(b, &p->start);
    sv_sub3(a, a, b);
    m.deg += sv_norm3(w) * 180 / SV_PI;
    m.shift += sv_norm3(a);
    m.n++;
  }
  if (m.n) {
    m.deg /= m.n;
    m.shift /= m.n;
  }
  return m;
}
