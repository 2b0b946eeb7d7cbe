// SPDX-License-Identifier: Apache-2.0
#include "src/train/poses.h"

#include "src/base/mathx.h"
#include "src/track/bundle.h"
#include "src/train/train.h"

sv_train_poses_cfg sv_train_poses_defaults(void) {
  return (sv_train_poses_cfg){.rot_rad = 2e-3f, .place = 2e-3f, .decay = 0.01f, .from = 0.05f, .until = 1};
}

void sv_pose_twist_bwd(const sv_pose *c, const double g[6], double out[6]) {
  // omega_c = R omega, v_c = R v + t x R omega: what v_c feels of omega is its moment about the
  // camera.
  double moment[3];
  sv_cross3(moment, g + 3, c->t);
  for (int i = 0; i < 3; i++) {
    out[i] = out[3 + i] = 0;
    for (int k = 0; k < 3; k++) {
      out[i] += c->r[3 * k + i] * (g[k] + moment[k]);
      out[3 + i] += c->r[3 * k + i] * g[3 + k];
    }
  }
}

void sv_train_pose_step(sv_train_pose *p, const double g[6], double rot_rad, double place) {
  double twist[6], n = (double)++p->n_steps;
  double bias1 = 1 - sv_pow(0.9, n), bias2 = 1 - sv_pow(0.999, n);
  for (int i = 0; i < 6; i++) {
    p->m[i] = 0.9 * p->m[i] + 0.1 * g[i];
    p->v[i] = 0.999 * p->v[i] + 0.001 * g[i] * g[i];
    twist[i] = -(i < 3 ? rot_rad : place) * (p->m[i] / bias1) / (sqrt(p->v[i] / bias2) + 1e-20);
  }
  sv_pose_twist(&p->rig_from_world, twist);
}

void sv_view_set_pose(sv_view *v, const sv_pose *p) {
  for (int i = 0; i < 9; i++) v->r[i] = (float)p->r[i];
  for (int i = 0; i < 3; i++) v->t[i] = (float)p->t[i];
}

void sv_train_refine_view(sv_trainer *t, int i_view, int i_pose, const sv_pose *cam_from_rig,
                          const sv_pose *rig_from_world, bool is_held) {
  sv_train_pose *p = &t->poses.pose[i_pose];
  t->poses.pose_of[i_view] = i_pose;
  t->poses.cam_from_rig[i_view] = *cam_from_rig;
  *p = (sv_train_pose){.rig_from_world = *rig_from_world, .start = *rig_from_world, .is_held = is_held};
}

void sv_train_move_pose(sv_trainer *t, int i_view, float progress, int n_sums) {
  const sv_train_poses_cfg *c = &t->cfg.poses;
  sv_train_poses *s = &t->poses;
  if (c->cap_poses < 1 || s->pose_of[i_view] < 0 || progress < c->from || progress > c->until) return;
  sv_train_pose *p = &s->pose[s->pose_of[i_view]];
  double dl_dcam[6] = {0}, dl_drig[6];
  if (p->is_held) return;
  for (int i = 0; i < n_sums; i++)
    for (int k = 0; k < 6; k++) dl_dcam[k] += (double)s->sum[i][k];
  sv_pose_twist_bwd(&s->cam_from_rig[i_view], dl_dcam, dl_drig);
  double rate = sv_exp(sv_log((double)c->decay) * (double)progress);
  sv_train_pose_step(p, dl_drig, rate * (double)c->rot_rad, rate * (double)(c->place * t->radius));
  // The exposure's other views follow: all of them are where the rig is.
  for (int i = 0; i < t->n_views; i++) {
    if (s->pose_of[i] != s->pose_of[i_view]) continue;
    sv_pose cam = sv_pose_mul(&s->cam_from_rig[i], &p->rig_from_world);
    sv_view_set_pose(&t->views[i].view, &cam);
  }
}
