// SPDX-License-Identifier: Apache-2.0
// Falloff and relative gains from pictures of an evenly lit white surface. The light of a picture
// is, channel by channel, linear in what is unknown:
//   y = g (1 + k1 q + k2 q^2 + k3 q^3) + a x + b y,   q = x^2 + y^2
// x and y are 1 at the corner; a and b are the tilt of the light, which no lens has.
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "src/base/cholesky.h"
#include "src/base/mathx.h"
#include "tools/calibrate/photometry.h"

#define N         6
#define N_ROUNDS  3
#define OUTLIER   0.1  // of the light: pixels farther off are no part of the surface
#define SATURATED 0.01 // of the pixels
#define USABLE    0.5

typedef struct {
  double gain[3], k[3], rms;
} fit;

double cal_linear_of(double v) { return v <= 0.04045 ? v / 12.92 : pow((v + 0.055) / 1.055, 2.4); }

sv_status cal_picture_read(const char *path, sv_bitmap *out, sv_err *err) {
  sv_status s = sv_bitmap_read(path, out, err);
  if (s == SV_OK) s = sv_bitmap_to_8(out, err);
  if (s == SV_OK) s = sv_bitmap_to_channels(out, 3, err);
  return s;
}

const char *cal_picture_of(const cal_boards *b, int c, int f) {
  for (int i = 0; i < b->cameras[c].n_pictures; i++)
    if (b->cameras[c].pictures[i].i_frame == f) return b->cameras[c].pictures[i].path;
  return NULL;
}

static void row_of(const sv_photometry *p, const sv_camera_model *m, int x, int y, double h[N]) {
  const double u = (x + 0.5 - m->p[2]) / (m->p[0] * p->corner),
               v = (y + 0.5 - m->p[3]) / (m->p[1] * p->corner), q = u * u + v * v;
  const double all[N] = {1, q, q * q, q * q * q, u, v};
  memcpy(h, all, sizeof all);
}

static const uint8_t *pixel(const sv_bitmap *b, const sv_sub_view *v, int x, int y) {
  return b->u8 +
         3 * ((size_t)(y + v->footprint.y0_px) * (size_t)b->width_px + (size_t)(x + v->footprint.x0_px));
}

static bool is_usable(const uint8_t *px) {
  for (int k = 0; k < 3; k++)
    if (px[k] < CAL_DARK || px[k] > CAL_BRIGHT) return false;
  return true;
}

static sv_status check_exposure(const sv_bitmap *b, const sv_sub_view *v, const char *path, sv_err *err) {
  const double n = (double)v->model.width_px * v->model.height_px;
  double saturated = 0, usable = 0;
  for (int y = 0; y < v->model.height_px; y++)
    for (int x = 0; x < v->model.width_px; x++) {
      const uint8_t *px = pixel(b, v, x, y);
      saturated += px[0] > CAL_BRIGHT || px[1] > CAL_BRIGHT || px[2] > CAL_BRIGHT;
      usable += is_usable(px);
    }
  if (saturated > SATURATED * n)
    return sv_fail(err, SV_E_RANGE,
                   "%s: %.0f %% of its pixels are saturated; expected a shorter exposure, without any", path,
                   100 * saturated / n);
  if (usable < USABLE * n)
    return sv_fail(err, SV_E_RANGE, "%s: %.0f %% of its pixels are too dark; expected a longer exposure",
                   path, 100 * (1 - usable / n));
  return SV_OK;
}

static double model_of(const double *x, const double *h) {
  double y = 0;
  for (int i = 0; i < N; i++) y += x[i] * h[i];
  return y;
}

// One channel; false when its pixels do not tell. rms: as a share of the gain.
static bool solve_channel(const sv_bitmap *b, const sv_sub_view *v, const sv_photometry *p, int k,
                          double x[N], double *rms) {
  double linear[256];
  for (int i = 0; i < 256; i++) linear[i] = cal_linear_of(i / 255.0);
  for (int round = 0; round < N_ROUNDS; round++) {
    double a[N * N] = {0}, rhs[N] = {0}, sum2 = 0, n = 0;
    for (int j = 0; j < v->model.height_px; j++)
      for (int i = 0; i < v->model.width_px; i++) {
        const uint8_t *px = pixel(b, v, i, j);
        double h[N];
        if (!is_usable(px)) continue;
        row_of(p, &v->model, i, j, h);
        if (round > 0) {
          const double e = linear[px[k]] - model_of(x, h);
          if (!(fabs(e) < OUTLIER * x[0])) continue;
          sum2 += e * e;
        }
        n++;
        for (int r = 0; r < N; r++) {
          rhs[r] += h[r] * linear[px[k]];
          for (int c = 0; c <= r; c++) a[r * N + c] += h[r] * h[c];
        }
      }
    if (!(n > 10 * N) || !sv_cholesky(a, N)) return false;
    sv_cholesky_solve(a, N, rhs);
    memcpy(x, rhs, sizeof rhs);
    if (!(x[0] > 0)) return false;
    *rms = sqrt(sum2 / n) / x[0];
  }
  return true;
}

static sv_status fit_picture(const char *path, const sv_sub_view *v, const sv_photometry *p, fit *out,
                             sv_err *err) {
  sv_bitmap b = {0};
  *out = (fit){0};
  sv_status s = cal_picture_read(path, &b, err);
  const int w = v->footprint.x0_px + v->model.width_px, h = v->footprint.y0_px + v->model.height_px;
  if (s == SV_OK &&
      (v->footprint.width_px ? b.width_px < w || b.height_px < h : b.width_px != w || b.height_px != h))
    s = sv_fail(err, SV_E_RANGE, "%s: %dx%d pixels, but the rig's %s is for %dx%d", path, b.width_px,
                b.height_px, v->name, w, h);
  if (s == SV_OK) s = check_exposure(&b, v, path, err);
  for (int k = 0; k < 3 && s == SV_OK; k++) {
    double x[N], rms = 0;
    if (!solve_channel(&b, v, p, k, x, &rms))
      s = sv_fail(err, SV_E_RANGE, "%s: no evenly lit white surface", path);
    out->gain[k] = x[0];
    for (int i = 0; i < 3; i++) out->k[i] += x[1 + i]; // weighted by the gains
    out->rms = sv_maxd(out->rms, rms);
  }
  for (int i = 0; i < 3; i++) out->k[i] /= out->gain[0] + out->gain[1] + out->gain[2];
  sv_bitmap_free(&b);
  return s;
}

static bool is_complete(const cal_boards *b, int f) {
  for (int c = 0; c < b->n_cameras; c++)
    if (!cal_picture_of(b, c, f)) return false;
  return true;
}

typedef struct {
  double n, sum, sum2;
} statistic;

static void add(statistic *s, double v) {
  s->n++;
  s->sum += v;
  s->sum2 += v * v;
}

static double mean_of(const statistic *s) { return s->sum / s->n; }
// Of the mean; from one value alone, what its fit left.
static double sigma_of(const statistic *s, double rms) {
  const double mean = mean_of(s);
  return s->n > 1 ? sqrt(sv_maxd(s->sum2 / s->n - mean * mean, 0) / (s->n - 1)) : rms;
}

// fits: [n_sub_views][n_frames] of the frames that are complete.
static sv_status join(const sv_rig *rig, const fit *fits, int n_frames, cal_photometry *out, sv_err *err) {
  for (int i = 0; i < rig->n_sub_views; i++) {
    statistic gain[3] = {{0}}, k[3] = {{0}}, corner = {0};
    cal_photometry *o = &out[i];
    *o = (cal_photometry){.found = sv_photometry_none(&rig->sub_views[i].model), .n_pictures = n_frames};
    for (int f = 0; f < n_frames; f++) {
      const fit *x = &fits[i * n_frames + f], *reference = &fits[f];
      for (int c = 0; c < 3; c++) add(&gain[c], x->gain[c] / reference->gain[c]);
      for (int c = 0; c < 3; c++) add(&k[c], x->k[c]);
      add(&corner, 1 + x->k[0] + x->k[1] + x->k[2]);
      o->rms = sv_maxd(o->rms, x->rms);
    }
    for (int c = 0; c < 3; c++) {
      o->found.falloff[c] = mean_of(&k[c]);
      if (i == 0) continue; // the reference
      o->found.color[4 * c] = mean_of(&gain[c]);
      o->found.color_sigma[c] = sigma_of(&gain[c], o->rms) / mean_of(&gain[c]);
    }
    o->found.falloff_sigma = sigma_of(&corner, o->rms);
    if (!sv_photometry_has_light(&o->found))
      return sv_fail(err, SV_E_RANGE,
                     "%s: its pictures are not of an evenly lit white surface: the light at its corner would "
                     "be %.0f %% of that at its center",
                     rig->sub_views[i].name, 100 * mean_of(&corner));
  }
  return SV_OK;
}

sv_status cal_white_solve(const sv_rig *rig, const cal_boards *b, cal_photometry *out, sv_err *err) {
  fit *fits = calloc((size_t)rig->n_sub_views * (size_t)b->n_frames + 1, sizeof *fits);
  if (!fits) return sv_fail(err, SV_E_NOMEM, "no memory for %d pictures", b->n_frames);
  int n = 0, i_fit = 0;
  for (int f = 0; f < b->n_frames; f++) n += is_complete(b, f);
  sv_status s =
      n ? SV_OK
        : sv_fail(err, SV_E_NOT_FOUND, "no picture of all cameras: names must match where the wildcards are");
  for (int f = 0; f < b->n_frames && s == SV_OK; f++) {
    if (!is_complete(b, f)) continue;
    for (int i = 0; i < rig->n_sub_views && s == SV_OK; i++) {
      const sv_sub_view *v = &rig->sub_views[i];
      const sv_photometry p = sv_photometry_none(&v->model);
      s = fit_picture(cal_picture_of(b, v->i_camera, f), v, &p, &fits[i * n + i_fit], err);
    }
    i_fit++;
  }
  if (s == SV_OK) s = join(rig, fits, n, out, err);
  free(fits);
  return s;
}
