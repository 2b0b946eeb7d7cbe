// SPDX-License-Identifier: Apache-2.0
#include "src/base/vec.h"

#include "src/base/mathx.h"

sv_pose sv_pose_identity(void) {
  sv_pose p = {{1, 0, 0, 0, 1, 0, 0, 0, 1}, {0, 0, 0}};
  return p;
}

sv_pose sv_pose_mul(const sv_pose *a, const sv_pose *b) {
  sv_pose c;
  sv_mul33(c.r, a->r, b->r);
  sv_apply33(c.t, a->r, b->t);
  for (int i = 0; i < 3; i++) c.t[i] += a->t[i];
  return c;
}

sv_pose sv_pose_inv(const sv_pose *a) {
  sv_pose c;
  for (int i = 0; i < 3; i++)
    for (int j = 0; j < 3; j++) c.r[i * 3 + j] = a->r[j * 3 + i];
  sv_apply33(c.t, c.r, a->t);
  for (int i = 0; i < 3; i++) c.t[i] = -c.t[i];
  return c;
}

void sv_pose_apply(double out[3], const sv_pose *a, const double x[3]) {
  sv_apply33(out, a->r, x);
  for (int i = 0; i < 3; i++) out[i] += a->t[i];
}

void sv_pose_centre(double out[3], const sv_pose *a) {
  sv_pose inv = sv_pose_inv(a);
  for (int i = 0; i < 3; i++) out[i] = inv.t[i];
}

bool sv_pose_look_at(sv_pose *cam_from_world, const double eye[3], const double at[3], const double up[3]) {
  double z[3], x[3], y[3];
  sv_sub3(z, at, eye);
  double nz = sv_norm3(z);
  if (!(nz > 0)) return false;
  for (int i = 0; i < 3; i++) z[i] /= nz;
  sv_cross3(x, z, up); // right = forward x up
  double nx = sv_norm3(x);
  if (!(nx > 1e-9)) return false;
  for (int i = 0; i < 3; i++) x[i] /= nx;
  sv_cross3(y, z, x); // down
  for (int i = 0; i < 3; i++) {
    cam_from_world->r[i] = x[i];
    cam_from_world->r[3 + i] = y[i];
    cam_from_world->r[6 + i] = z[i];
  }
  sv_apply33(cam_from_world->t, cam_from_world->r, eye);
  for (int i = 0; i < 3; i++) cam_from_world->t[i] = -cam_from_world->t[i];
  return true;
}

void sv_quat_to_mat(double r[9], const double q[4]) {
  double n = sqrt(q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3]);
  if (!(n > 0)) n = 1;
  double w = q[0] / n, x = q[1] / n, y = q[2] / n, z = q[3] / n;
  r[0] = 1 - 2 * (y * y + z * z);
  r[1] = 2 * (x * y - w * z);
  r[2] = 2 * (x * z + w * y);
  r[3] = 2 * (x * y + w * z);
  r[4] = 1 - 2 * (x * x + z * z);
  r[5] = 2 * (y * z - w * x);
  r[6] = 2 * (x * z - w * y);
  r[7] = 2 * (y * z + w * x);
  r[8] = 1 - 2 * (x * x + y * y);
}

// Shepperd's method starts from the largest of the four components, so no root loses digits.
void sv_quat_from_mat(double q[4], const double r[9]) {
  double tr = r[0] + r[4] + r[8];
  if (tr > 0) {
    double s = 2 * sqrt(tr + 1);
    q[0] = 0.25 * s;
    q[1] = (r[7] - r[5]) / s;
    q[2] = (r[2] - r[6]) / s;
    q[3] = (r[3] - r[1]) / s;
    return;
  }
  int i = r[4] > r[0] ? 1 : 0;
  if (r[8] > r[i * 4]) i = 2;
  int j = (i + 1) % 3, k = (i + 2) % 3;
  double s = 2 * sqrt(1 + r[i * 4] - r[j * 4] - r[k * 4]);
  q[0] = (r[k * 3 + j] - r[j * 3 + k]) / s;
  q[1 + i] = 0.25 * s;
  q[1 + j] = (r[j * 3 + i] + r[i * 3 + j]) / s;
  q[1 + k] = (r[k * 3 + i] + r[i * 3 + k]) / s;
}

void sv_rodrigues(double r[9], const double w[3]) {
  double th = sv_norm3(w), a = 1, b = 0.5;
  if (th > 1e-4) {
    a = sv_sin(th) / th;
    b = (1 - sv_cos(th)) / (th * th);
  } else {
    a -= th * th / 6;
    b -= th * th / 24;
  }
  double k[9] = {0, -w[2], w[1], w[2], 0, -w[0], -w[1], w[0], 0}, k2[9];
  sv_mul33(k2, k, k);
  for (int i = 0; i < 9; i++) r[i] = (i % 4 == 0) + a * k[i] + b * k2[i];
}

void sv_rodrigues_inv(double w[3], const double r[9]) {
  double q[4];
  sv_quat_from_mat(q, r);
  double s = q[0] < 0 ? -1 : 1, n = sqrt(q[1] * q[1] + q[2] * q[2] + q[3] * q[3]);
  double f = n > 1e-12 ? 2 * sv_atan2(n, s * q[0]) / n : 2;
  for (int i = 0; i < 3; i++) w[i] = s * f * q[1 + i];
}

double sv_angle_between(const double a[3], const double b[3]) {
  double c[3];
  sv_cross3(c, a, b);
  return sv_atan2(sv_norm3(c), sv_dot3(a, b));
}

double sv_rotation_error(const double r[9]) {
  double e = 0;
  for (int i = 0; i < 3; i++)
    for (int j = 0; j < 3; j++) {
      double d = fabs(sv_dot3(r + 3 * i, r + 3 * j) - (i == j));
      if (!(d <= e)) e = d;
    }
  double c[3];
  sv_cross3(c, r, r + 3);
  return sv_dot3(c, r + 6) > 0 ? e : e + 1;
}
