// SPDX-License-Identifier: Apache-2.0
// Small linear algebra on plain arrays: 3-vectors, row-major 3x3 matrices, quaternions (w,x,y,z)
// and rigid poses. Transforms are named a_from_b; camera axes are OpenCV's (+x right, +y down, +z
// forward).
#ifndef SV_BASE_VEC_H
#define SV_BASE_VEC_H

#include <math.h>
#include <stdbool.h>

#ifdef __cplusplus
extern "C" {
#endif

// x_a = r x_b + t for a pose a_from_b. r is row-major and orthonormal.
typedef struct {
  double r[9];
  double t[3];
} sv_pose;

static inline double sv_dot3(const double a[3], const double b[3]) {
  return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}
static inline double sv_norm3(const double a[3]) { return sqrt(sv_dot3(a, a)); }
static inline void sv_sub3(double out[3], const double a[3], const double b[3]) {
  for (int i = 0; i < 3; i++) out[i] = a[i] - b[i];
}
static inline void sv_cross3(double out[3], const double a[3], const double b[3]) {
  double c[3] = {a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]};
  for (int i = 0; i < 3; i++) out[i] = c[i];
}
// out may be a or b
static inline void sv_mul33(double out[9], const double a[9], const double b[9]) {
  double c[9];
  for (int i = 0; i < 3; i++)
    for (int j = 0; j < 3; j++)
      c[i * 3 + j] = a[i * 3] * b[j] + a[i * 3 + 1] * b[3 + j] + a[i * 3 + 2] * b[6 + j];
  for (int i = 0; i < 9; i++) out[i] = c[i];
}
static inline void sv_apply33(double out[3], const double a[9], const double v[3]) { // out may be v
  double c[3];
  for (int i = 0; i < 3; i++) c[i] = a[i * 3] * v[0] + a[i * 3 + 1] * v[1] + a[i * 3 + 2] * v[2];
  for (int i = 0; i < 3; i++) out[i] = c[i];
}

sv_pose sv_pose_identity(void);
sv_pose sv_pose_mul(const sv_pose *a_from_b, const sv_pose *b_from_c); // a_from_c
sv_pose sv_pose_inv(const sv_pose *a_from_b);                          // b_from_a
void sv_pose_apply(double out[3], const sv_pose *a_from_b, const double x_b[3]);
// the camera's position in the world
void sv_pose_centre(double out[3], const sv_pose *cam_from_world);

// Camera at `eye`, looking at `at`, image up along `up` (world): cam_from_world. False when
// degenerate.
bool sv_pose_look_at(sv_pose *cam_from_world, const double eye[3], const double at[3], const double up[3]);

void sv_quat_to_mat(double r[9], const double q_wxyz[4]); // q is normalised on use
void sv_quat_from_mat(double q_wxyz[4], const double r[9]);
void sv_rodrigues(double r[9], const double w_rad[3]); // rotation vector -> matrix
// matrix -> rotation vector, |w| <= pi
void sv_rodrigues_inv(double w_rad[3], const double r[9]);
// radians, by atan2: exact for tiny angles
double sv_angle_between(const double a[3], const double b[3]);
// Distance of r from a proper rotation: max |r r^T - I|, plus 1 when the determinant is negative.
double sv_rotation_error(const double r[9]);

#ifdef __cplusplus
}
#endif
#endif
