// SPDX-License-Identifier: Apache-2.0
// Where the scene is, from the cameras alone; and starting points from a file.
#include <float.h>
#include <stdlib.h>
#include <string.h>

#include "src/format/ply.h"
#include "tools/dataset/dataset.h"

static int compare_floats(const void *a, const void *b) {
  float x = *(const float *)a, y = *(const float *)b;
  return (x > y) - (x < y);
}

static float median(float *v, int n) {
  qsort(v, (size_t)n, sizeof *v, compare_floats);
  return n & 1 ? v[n / 2] : 0.5f * (v[n / 2 - 1] + v[n / 2]);
}

// Solves the symmetric positive 3x3 system a x = b by Cramer's rule; false when it is singular.
static bool solve3(const double a[9], const double b[3], double x[3]) {
  double c0[3], c1[3], c2[3];
  sv_cross3(c0, a + 3, a + 6);
  sv_cross3(c1, a + 6, a);
  sv_cross3(c2, a, a + 3);
  double det = sv_dot3(a, c0);
  if (!(fabs(det) > 1e-30)) return false;
  for (int i = 0; i < 3; i++) x[i] = (b[0] * c0[i] + b[1] * c1[i] + b[2] * c2[i]) / det;
  return true;
}

// The point nearest to all optical axes: sum (I - d d^T)(x - c) = 0. One exposure's axes leave the
// distance open; a trace of pull to the origin, where datasets put their subject, decides it and
// nothing else.
static void nearest_to_axes(const lab_views *v, double x[3]) {
  double a[9] = {0}, b[3] = {0}, pull = 1e-6 * v->n;
  for (int i = 0; i < v->n; i++) {
    const sv_pose *p = &v->frames[i].f.cam_from_world;
    const double *d = p->r + 6;
    double c[3];
    sv_pose_centre(c, p);
    for (int k = 0; k < 9; k++) {
      double m = (k % 4 == 0 ? 1.0 : 0.0) - d[k / 3] * d[k % 3];
      a[k] += m;
      b[k / 3] += m * c[k % 3];
    }
  }
  for (int k = 0; k < 3; k++) a[4 * k] += pull;
  if (!solve3(a, b, x)) x[0] = x[1] = x[2] = 0;
}

// Whether most cameras look towards x.
static bool is_looked_at(const lab_views *v, const double x[3]) {
  int n = 0;
  for (int i = 0; i < v->n; i++) {
    double y[3];
    sv_pose_apply(y, &v->frames[i].f.cam_from_world, x);
    n += y[2] > 0;
  }
  return 10 * n >= 7 * v->n;
}

static float median_distance(const lab_views *v, const double x[3]) {
  float *d = malloc((size_t)v->n * sizeof *d), m = 1;
  for (int i = 0; d && i < v->n; i++) {
    double c[3];
    sv_pose_centre(c, &v->frames[i].f.cam_from_world);
    sv_sub3(c, c, x);
    d[i] = (float)sv_norm3(c);
  }
  if (d) m = median(d, v->n);
  free(d);
  return m;
}

lab_scene lab_scene_of(const lab_views *v) {
  lab_scene s = {.radius = 1, .distance = 1};
  double x[3], up[3] = {0};
  nearest_to_axes(v, x);
  bool is_inward = is_looked_at(v, x);
  if (!is_inward) { // cameras look outwards: the scene is around them
    x[0] = x[1] = x[2] = 0;
    for (int i = 0; i < v->n; i++) {
      double c[3];
      sv_pose_centre(c, &v->frames[i].f.cam_from_world);
      for (int k = 0; k < 3; k++) x[k] += c[k] / v->n;
    }
  }
  for (int i = 0; i < v->n; i++)
    for (int k = 0; k < 3; k++) up[k] -= v->frames[i].f.cam_from_world.r[3 + k];
  double n = sv_norm3(up);
  float d = median_distance(v, x);
  if (!(d > 1e-6f)) d = 1; // cameras of one place
  for (int k = 0; k < 3; k++) s.centre[k] = (float)x[k];
  for (int k = 0; k < 3; k++) s.up[k] = n > 1e-9 ? (float)(up[k] / n) : (k == 2);
  s.distance = d;
  // At the usual field of view (40 degrees) 0.34 of the distance just fills the image, and images
  // of objects have a margin: the tighter the sphere around the object, the less room one view
  // leaves for its depth. Outward cameras see several times further than they are apart.
  s.radius = is_inward ? 0.3f * d : 3.0f * d;
  return s;
}

static sv_status read_points(const char *path, sv_ply *ply, sv_point *p, sv_err *err) {
  for (uint32_t i = 0; i < ply->n; i++) {
    sv_status s = sv_ply_read_point(ply, i, p[i].mean, p[i].rgb, err);
    if (s != SV_OK) return s;
    for (int k = 0; k < 3; k++)
      if (!(fabsf(p[i].mean[k]) < 1e9f))
        return sv_fail(err, SV_E_RANGE, "%s: point %u has a coordinate of %g; expected magnitudes below 1e9",
                       path, i, (double)p[i].mean[k]);
  }
  return SV_OK;
}

static sv_status bounds(const sv_point *p, int n, float centre[3], float *radius, sv_err *err) {
  double c[3] = {0};
  float *d = malloc((size_t)n * sizeof *d);
  if (!d) return sv_fail(err, SV_E_NOMEM, "no memory for %d points", n);
  for (int i = 0; i < n; i++)
    for (int k = 0; k < 3; k++) c[k] += (double)p[i].mean[k] / n;
  for (int i = 0; i < n; i++) {
    double e[3];
    for (int k = 0; k < 3; k++) e[k] = (double)p[i].mean[k] - c[k];
    d[i] = (float)sv_norm3(e);
  }
  for (int k = 0; k < 3; k++) centre[k] = (float)c[k];
  *radius = 1.5f * median(d, n);
  if (!(*radius > 1e-6f)) *radius = 1e-6f;
  free(d);
  return SV_OK;
}

sv_status lab_points_read(const char *path, sv_point **points, int *n, float centre[3], float *radius,
                          sv_err *err) {
  void *data;
  size_t bytes;
  sv_ply ply;
  sv_status s = sv_file_read(path, &data, &bytes, err);
  if (s != SV_OK) return s;
  *points = NULL;
  s = sv_ply_open(&ply, path, data, bytes, err);
  if (s == SV_OK && (ply.n < 1 || ply.n > 50000000))
    s = sv_fail(err, SV_E_RANGE, "%s: %u points; expected 1 to 50000000", path, ply.n);
  if (s == SV_OK && !(*points = malloc(ply.n * sizeof **points)))
    s = sv_fail(err, SV_E_NOMEM, "%s: no memory for its %u points", path, ply.n);
  if (s == SV_OK) s = read_points(path, &ply, *points, err);
  if (s == SV_OK) s = bounds(*points, (int)ply.n, centre, radius, err);
  free(data);
  if (s != SV_OK) {
    free(*points);
    *points = NULL;
    return s;
  }
  *n = (int)ply.n;
  return SV_OK;
}

static bool is_same_place(const lab_frame *a, const lab_frame *b) {
  const sv_pose *p = &a->f.cam_from_world, *q = &b->f.cam_from_world;
  double far2 = 0;
  for (int i = 0; i < 9; i++) far2 += (p->r[i] - q->r[i]) * (p->r[i] - q->r[i]);
  for (int i = 0; i < 3; i++) far2 += (p->t[i] - q->t[i]) * (p->t[i] - q->t[i]);
  return far2 < 1e-8;
}

int lab_n_times(const lab_views *v) {
  int n = 0;
  for (int i = 0; i < v->n; i++) {
    int k = 0;
    while (k < i && v->frames[i].view.time != v->frames[k].view.time) k++;
    n += k == i;
  }
  return n;
}

int lab_n_places(const lab_views *v) {
  int n = 0;
  for (int i = 0; i < v->n; i++) {
    int k = 0;
    while (k < i && !is_same_place(&v->frames[i], &v->frames[k])) k++;
    n += k == i;
  }
  return n;
}
