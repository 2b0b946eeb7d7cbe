// SPDX-License-Identifier: Apache-2.0
#include <dlfcn.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "tools/common/imageio.h"
#include "tools/import/refine.h"

#define N_FEATURES   2000
#define N_NEIGHBOURS 8
#define N_SEEN       3
#define CAP_SIDE_PX  1600 // larger pictures are reduced
#define MIN_PARALLEL 3e-6 // squared sine of a tenth of a degree

#define MODULE "subview-matches.so"

typedef int (*matcher)(const sv_structure_view *views, int n_views, const sv_structure_options *o,
                       sv_array_observation **observations, int *n_points);

// sv_structure_tracks of the module; it stays open. NULL: it is not there, or does not load.
static matcher find_matcher(void) {
  static const char *const below[] = {"", "../lib/subview/"};
  char folder[512], path[640];
  ssize_t n = readlink("/proc/self/exe", folder, sizeof folder - 1);
  while (n > 0 && folder[n - 1] != '/') n--;
  for (size_t i = 0; n > 0 && i < sizeof below / sizeof *below; i++) {
    snprintf(path, sizeof path, "%.*s%s%s", (int)n, folder, below[i], MODULE);
    void *module = access(path, R_OK) == 0 ? dlopen(path, RTLD_NOW | RTLD_LOCAL) : NULL;
    matcher out = NULL;
    void *symbol = module ? dlsym(module, "sv_structure_tracks") : NULL;
    memcpy(&out, &symbol, sizeof out); // C has no cast from objects to functions
    if (out) return out;
  }
  return NULL;
}

bool lab_has_matcher(void) { return find_matcher() != NULL; }

void lab_matches_free(lab_matches *m) {
  free(m->obs);
  free(m->first);
  memset(m, 0, sizeof *m);
}

// The view's picture in grey, reduced to *k-th size.
static sv_status load_grey(const lab_import_view *v, sv_structure_view *out, int *k, sv_err *err) {
  sv_bitmap b = {0};
  sv_status s = sv_bitmap_read(v->source, &b, err);
  if (s == SV_OK) s = sv_bitmap_to_8(&b, err);
  if (s == SV_OK) s = sv_bitmap_to_channels(&b, 1, err);
  if (s != SV_OK) {
    sv_bitmap_free(&b);
    return s;
  }
  const int w = v->crop.width_px ? v->crop.width_px : b.width_px;
  const int h = v->crop.width_px ? v->crop.height_px : b.height_px;
  const int side = w > h ? w : h;
  uint8_t *grey = malloc((size_t)w * (size_t)h);
  if (w != v->model.width_px || h != v->model.height_px || v->crop.x0_px + w > b.width_px ||
      v->crop.y0_px + h > b.height_px)
    s = sv_fail(err, SV_E_FORMAT, "%s: an image of %dx%d; its camera has %dx%d", v->source, b.width_px,
                b.height_px, v->model.width_px, v->model.height_px);
  if (s == SV_OK && !grey) s = sv_fail(err, SV_E_NOMEM, "%s: no memory for the image", v->source);
  *k = (side + CAP_SIDE_PX - 1) / CAP_SIDE_PX;
  if (s == SV_OK) {
    for (int y = 0; y < h; y++)
      memcpy(grey + (size_t)y * (size_t)w,
             b.u8 + (size_t)(y + v->crop.y0_px) * (size_t)b.width_px + v->crop.x0_px, (size_t)w);
    if (*k > 1) lab_reduce(grey, w, h, 1, *k, grey);
    out->grey = grey;
    out->width_px = w / *k;
    out->height_px = h / *k;
  } else {
    free(grey);
  }
  sv_bitmap_free(&b);
  return s;
}

// How far the cameras are from what they look at: the median distance between each and the point
// nearest to all optical axes. 1 when that is not known.
static double scene_distance(const lab_import *im) {
  double a[9] = {0}, b[3] = {0}, c[3], x[3];
  for (int i = 0; i < im->n; i++) {
    const double *d = im->views[i].cam_from_world.r + 6;
    sv_pose_centre(c, &im->views[i].cam_from_world);
    for (int r = 0; r < 3; r++)
      for (int k = 0; k < 3; k++) {
        double m = (r == k) - d[r] * d[k];
        a[3 * r + k] += m;
        b[r] += m * c[k];
      }
  }
  double c0[3], c1[3], c2[3];
  sv_cross3(c0, a + 3, a + 6);
  sv_cross3(c1, a + 6, a);
  sv_cross3(c2, a, a + 3);
  double det = sv_dot3(a, c0), sum = 0;
  if (!(det > 1e-6 * pow(im->n, 3))) return 1;
  for (int k = 0; k < 3; k++) x[k] = (c0[k] * b[0] + c1[k] * b[1] + c2[k] * b[2]) / det;
  for (int i = 0; i < im->n; i++) {
    sv_pose_centre(c, &im->views[i].cam_from_world);
    sv_sub3(c, c, x);
    sum += sv_norm3(c);
  }
  return sum > 0 ? sum / im->n : 1;
}

static bool may_run(void *session) { return !lab_is_stopped(session); }

static sv_status take(lab_matches *m, const int *k, sv_err *err) {
  m->first = calloc((size_t)m->n_points + 1, sizeof *m->first);
  if (!m->first) return sv_fail(err, SV_E_NOMEM, "no memory for %d points", m->n_points);
  for (int i = 0; i < m->n_obs; i++) {
    for (int a = 0; a < 2; a++) m->obs[i].uv_px[a] *= k[m->obs[i].view];
    m->first[m->obs[i].point + 1] = i + 1;
  }
  return SV_OK;
}

sv_status lab_matches_find(lab_matches *m, const lab_import *im, lab_session *se, sv_err *err) {
  memset(m, 0, sizeof *m);
  const matcher match_views = find_matcher();
  if (!match_views)
    return sv_fail(err, SV_E_UNSUPPORTED,
                   "matching pictures needs " MODULE " and the libraries of OpenCV that it loads; install "
                   "libopencv-calib3d and libopencv-features2d, or build with libopencv-dev");
  sv_structure_view *views = calloc((size_t)im->n, sizeof *views);
  int *k = calloc((size_t)im->n, sizeof *k);
  sv_status s = views && k ? SV_OK : sv_fail(err, SV_E_NOMEM, "no memory for %d images", im->n);
  const double distance = scene_distance(im);
  for (int i = 0; s == SV_OK && i < im->n; i++) {
    if (lab_is_stopped(se)) s = SV_E_INTERRUPTED;
    else s = load_grey(&im->views[i], &views[i], &k[i], err);
    double c[3];
    sv_pose_centre(c, &im->views[i].cam_from_world);
    for (int a = 0; a < 3; a++) {
      views[i].place[a] = c[a] / distance;
      views[i].place[3 + a] = im->views[i].cam_from_world.r[6 + a];
    }
  }
  const sv_structure_options o = {.n_features = N_FEATURES,
                                  .n_neighbours = N_NEIGHBOURS,
                                  .n_seen = N_SEEN,
                                  .keeps_unaligned = true,
                                  .may_run = may_run,
                                  .self = se};
  if (s == SV_OK) {
    m->n_obs = match_views(views, im->n, &o, &m->obs, &m->n_points);
    if (m->n_obs < 0)
      s = lab_is_stopped(se) ? SV_E_INTERRUPTED
                             : sv_fail(err, SV_E_NOMEM, "no memory to match %d images", im->n);
  }
  if (s == SV_OK) s = take(m, k, err);
  for (int i = 0; views && i < im->n; i++) free((void *)(uintptr_t)views[i].grey);
  free(views);
  free(k);
  if (s != SV_OK) lab_matches_free(m);
  return s;
}

// --- triangulation -------------------------------------------------------------------------------

bool lab_triangulate(const lab_ray *rays, int n, double x[3]) {
  double a[9] = {0}, b[3] = {0}, c[3], first[3], parallel = 0, weight = 1;
  for (int round = 0; round < 3; round++) {
    memset(a, 0, sizeof a);
    memset(b, 0, sizeof b);
    for (int i = 0; i < n; i++) {
      const double *r = rays[i].cam_from_world.r, in_cam[3] = {rays[i].ray[0], rays[i].ray[1], 1};
      double d[3], side[3], length = sv_norm3(in_cam);
      for (int k = 0; k < 3; k++) d[k] = (r[k] * in_cam[0] + r[3 + k] * in_cam[1] + r[6 + k]) / length;
      sv_pose_centre(c, &rays[i].cam_from_world);
      if (i == 0) memcpy(first, d, sizeof first);
      sv_cross3(side, first, d);
      if (sv_dot3(side, side) > parallel) parallel = sv_dot3(side, side);
      if (round) {
        double to[3];
        sv_sub3(to, x, c);
        weight = 1 / fmax(sv_dot3(to, to), 1e-18);
      }
      for (int j = 0; j < 3; j++)
        for (int k = 0; k < 3; k++) {
          double m = weight * ((j == k) - d[j] * d[k]);
          a[3 * j + k] += m;
          b[j] += m * c[k];
        }
    }
    if (parallel < MIN_PARALLEL) return false;
    double c0[3], c1[3], c2[3];
    sv_cross3(c0, a + 3, a + 6);
    sv_cross3(c1, a + 6, a);
    sv_cross3(c2, a, a + 3);
    double det = sv_dot3(a, c0);
    if (!(det > 0)) return false;
    for (int k = 0; k < 3; k++) x[k] = (c0[k] * b[0] + c1[k] * b[1] + c2[k] * b[2]) / det;
  }
  for (int i = 0; i < n; i++) {
    sv_pose_apply(c, &rays[i].cam_from_world, x);
    if (!(c[2] > 0)) return false;
  }
  return true;
}
