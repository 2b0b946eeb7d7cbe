// SPDX-License-Identifier: Apache-2.0
#include "src/track/pose.h"

#include <string.h>

#include "src/base/mathx.h"

#define N_SAMPLE    4
#define SAMPLE_ITER 5
#define FINAL_ITER  10

// Residual of one match, with the bundle's code: one pose and the cameras.
static bool residual(const sv_pose_problem *p, const sv_pose *pose, const sv_pose_match *m, double r[2],
                     sv_bundle_jacobian *j) {
  sv_bundle b = {.pose = (sv_pose *)(uintptr_t)pose,
                 .motion = (double(*)[6])(uintptr_t)&p->motion,
                 .camera = (sv_bundle_camera *)(uintptr_t)p->cameras};
  sv_bundle_obs obs = {0, (int16_t)m->i_camera, {m->uv_px[0], m->uv_px[1]}, 1.0f, m->row_s};
  return sv_bundle_residual(&b, &obs, m->x, r, j);
}

// Solves the damped symmetric 6x6 system in place by Cholesky. False when it is singular.
static bool solve6(double a[36], double x[6]) {
  for (int i = 0; i < 6; i++) a[7 * i] += 1e-9 * a[7 * i] + 1e-12;
  for (int i = 0; i < 6; i++)
    for (int j = 0; j <= i; j++) {
      double s = a[6 * i + j];
      for (int k = 0; k < j; k++) s -= a[6 * i + k] * a[6 * j + k];
      if (i > j) a[6 * i + j] = s / a[7 * j];
      else if (s > 1e-14) a[7 * i] = sqrt(s);
      else return false;
    }
  for (int i = 0; i < 6; i++) {
    for (int k = 0; k < i; k++) x[i] -= a[6 * i + k] * x[k];
    x[i] /= a[7 * i];
  }
  for (int i = 5; i >= 0; i--) {
    for (int k = i + 1; k < 6; k++) x[i] -= a[6 * k + i] * x[k];
    x[i] /= a[7 * i];
  }
  return true;
}

typedef enum { USE_ALL, USE_SAMPLE, USE_INLIERS } which;

// Gauss-Newton with Huber's weights (beyond k standard deviations) on the matches chosen.
static bool refine(const sv_pose_problem *p, which use, const int sample[N_SAMPLE], double k, int n_iter,
                   sv_pose *pose) {
  for (int it = 0; it < n_iter; it++) {
    double a[36] = {0}, g[6] = {0}, size = 0;
    int n = use == USE_SAMPLE ? N_SAMPLE : p->n;
    for (int i = 0; i < n; i++) {
      const sv_pose_match *m = &p->matches[use == USE_SAMPLE ? sample[i] : i];
      double r[2];
      sv_bundle_jacobian jacobian;
      const double *j = jacobian.pose;
      if ((use == USE_INLIERS && !m->is_inlier) || !residual(p, pose, m, r, &jacobian)) continue;
      double s = (double)m->sigma_px, d = sqrt(r[0] * r[0] + r[1] * r[1]) / s;
      double w = (d > k ? k / d : 1) / (s * s);
      for (int u = 0; u < 6; u++) {
        g[u] -= w * (j[u] * r[0] + j[6 + u] * r[1]);
        for (int v = 0; v <= u; v++) a[6 * u + v] += w * (j[u] * j[v] + j[6 + u] * j[6 + v]);
      }
    }
    if (!solve6(a, g)) return false;
    sv_pose_twist(pose, g);
    for (int u = 0; u < 6; u++) size += g[u] * g[u];
    if (!(size < 1e6)) return false;
    if (size < 1e-18) break;
  }
  return true;
}

static int count(const sv_pose_problem *p, const sv_pose *pose, bool is_marking) {
  int n = 0;
  for (int i = 0; i < p->n; i++) {
    sv_pose_match *m = &p->matches[i];
    double r[2], limit = p->limit_px * (double)m->sigma_px;
    bool is_in = residual(p, pose, m, r, NULL) && r[0] * r[0] + r[1] * r[1] < limit * limit;
    if (is_marking) m->is_inlier = is_in;
    n += is_in;
  }
  return n;
}

static void consider(const sv_pose_problem *p, const sv_pose *pose, sv_pose *best, int *n_best) {
  int n = count(p, pose, false);
  if (n > *n_best) {
    *best = *pose;
    *n_best = n;
  }
}

static void draw(sv_pose_problem *p, int sample[N_SAMPLE]) {
  for (int i = 0; i < N_SAMPLE; i++) {
    bool is_new = false;
    while (!is_new) {
      sample[i] = (int)sv_rng_below(&p->rng, (uint32_t)p->n);
      is_new = true;
      for (int k = 0; k < i; k++) is_new &= sample[k] != sample[i];
    }
  }
}

int sv_pose_find(sv_pose_problem *p, sv_pose *rig_from_world) {
  const sv_pose start = *rig_from_world;
  sv_pose best = start, pose = start;
  int n_best = 0, sample[N_SAMPLE];
  if (p->n < N_SAMPLE) return 0;
  consider(p, &pose, &best, &n_best);
  if (refine(p, USE_ALL, NULL, 1.0, FINAL_ITER, &pose)) consider(p, &pose, &best, &n_best);
  if (p->solver && p->solver->absolute(p->solver->self, p->cameras, p->matches, p->n, p->limit_px, &pose))
    consider(p, &pose, &best, &n_best);
  for (int i = 0; i < p->n_samples && n_best < p->n; i++) {
    pose = start;
    draw(p, sample);
    if (refine(p, USE_SAMPLE, sample, 1e9, SAMPLE_ITER, &pose)) consider(p, &pose, &best, &n_best);
  }
  if (n_best < N_SAMPLE) return 0;
  for (int i = 0; i < 3; i++) { // the inliers change with the pose
    (void)count(p, &best, true);
    pose = best;
    if (!refine(p, USE_INLIERS, NULL, 1.5, FINAL_ITER, &pose)) break;
    best = pose;
  }
  n_best = count(p, &best, true);
  if (n_best < N_SAMPLE) return 0;
  *rig_from_world = best;
  return n_best;
}

// --- trajectories --------------------------------------------------------------------------------

// The rotation nearest to m (maximises trace(R^T m)): the largest eigenvector of Horn's 4x4 matrix
// (1987), by power iteration with a shift that makes all eigenvalues positive.
static void nearest_rotation(double r[9], const double m[9]) {
  double xx = m[0], xy = m[3], xz = m[6], yx = m[1], yy = m[4], yz = m[7], zx = m[2], zy = m[5], zz = m[8];
  // m = sum b a^T has m[3 i + j] = b_i a_j; Horn's S_xy = sum a_x b_y.
  double n[16] = {xx + yy + zz, yz - zy,      zx - xz,      xy - yx, //
                  yz - zy,      xx - yy - zz, xy + yx,      zx + xz, //
                  zx - xz,      xy + yx,      yy - xx - zz, yz + zy, //
                  xy - yx,      zx + xz,      yz + zy,      zz - xx - yy};
  double shift = 0, q[4];
  int best = 0;
  for (int i = 0; i < 9; i++) shift += fabs(m[i]);
  // A fixed start could be orthogonal to the eigenvector; the column of the largest term is not.
  for (int i = 1; i < 4; i++)
    if (n[5 * i] > n[5 * best]) best = i;
  for (int i = 0; i < 4; i++) q[i] = n[4 * i + best] + (i == best ? shift : 0);
  for (int it = 0; it < 2000; it++) {
    double v[4], len = 0, change = 0;
    for (int i = 0; i < 4; i++) {
      v[i] = shift * q[i];
      for (int j = 0; j < 4; j++) v[i] += n[4 * i + j] * q[j];
      len += v[i] * v[i];
    }
    len = sqrt(len);
    if (!(len > 0)) break;
    for (int i = 0; i < 4; i++) {
      double now = v[i] / len;
      change += (now - q[i]) * (now - q[i]);
      q[i] = now;
    }
    if (change < 1e-30) break;
  }
  sv_quat_to_mat(r, q);
}

sv_similarity sv_align_trajectories(const sv_pose *a, const sv_pose *b, int n, bool has_scale) {
  sv_similarity s = {.s = 1};
  double ma[3] = {0}, mb[3] = {0}, m[9] = {0}, ca[3], cb[3], aa = 0, ab = 0;
  for (int i = 0; i < n; i++) {
    sv_pose_centre(ca, &a[i]);
    sv_pose_centre(cb, &b[i]);
    for (int k = 0; k < 3; k++) {
      ma[k] += ca[k] / n;
      mb[k] += cb[k] / n;
    }
    for (int u = 0; u < 3; u++) // orientations: R_b^T R_a
      for (int v = 0; v < 3; v++)
        for (int k = 0; k < 3; k++) m[3 * u + v] += b[i].r[3 * k + u] * a[i].r[3 * k + v] / n;
  }
  nearest_rotation(s.r, m);
  for (int i = 0; i < n; i++) {
    double x[3], y[3];
    sv_pose_centre(ca, &a[i]);
    sv_pose_centre(cb, &b[i]);
    sv_sub3(x, ca, ma);
    sv_sub3(y, cb, mb);
    sv_apply33(x, s.r, x);
    aa += sv_dot3(x, x);
    ab += sv_dot3(x, y);
  }
  if (has_scale && aa > 0 && ab > 0) s.s = ab / aa;
  sv_apply33(s.t, s.r, ma);
  for (int k = 0; k < 3; k++) s.t[k] = mb[k] - s.s * s.t[k];
  return s;
}

sv_pose sv_similarity_apply(const sv_similarity *q, const sv_pose *rig_from_a) {
  double c[3], rt[9];
  sv_pose out;
  sv_pose_centre(c, rig_from_a);
  sv_apply33(c, q->r, c);
  for (int i = 0; i < 3; i++) c[i] = q->s * c[i] + q->t[i];
  for (int i = 0; i < 3; i++)
    for (int k = 0; k < 3; k++) rt[3 * i + k] = q->r[3 * k + i];
  sv_mul33(out.r, rig_from_a->r, rt);
  sv_apply33(out.t, out.r, c);
  for (int i = 0; i < 3; i++) out.t[i] = -out.t[i];
  return out;
}
