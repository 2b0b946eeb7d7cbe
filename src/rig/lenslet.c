// SPDX-License-Identifier: Apache-2.0
// Lattice geometry, vignetting and sub-views of a lenslet sensor. The lattice is found in
// lenslet_find.c.
#include "src/rig/lenslet.h"

#include <math.h>
#include <string.h>

#include "src/base/mathx.h"
#include "src/base/str.h"

#define ROW_STEP 0.86602540378443864676 // sqrt(3)/2: rows of a hexagonal array

// --- lattice -------------------------------------------------------------------------------------

sv_lenslet_grid sv_lenslet_grid_make(double pitch, double rotation_rad, const double offset[2],
                                     bool is_hexagonal) {
  double c = sv_cos(rotation_rad), s = sv_sin(rotation_rad), rows = is_hexagonal ? ROW_STEP * pitch : pitch;
  return (sv_lenslet_grid){.pitch_px = pitch,
                           .rotation_rad = rotation_rad,
                           .offset_px = {offset[0], offset[1]},
                           .col_px = {pitch * c, pitch * s},
                           .row_px = {-rows * s, rows * c},
                           .is_hexagonal = is_hexagonal};
}

void sv_lenslet_centre(const sv_lenslet_grid *g, int i, int j, double xy[2]) {
  double p = i + (g->is_hexagonal && (j & 1) ? 0.5 : 0.0);
  for (int k = 0; k < 2; k++) xy[k] = g->offset_px[k] + p * g->col_px[k] + j * g->row_px[k];
}

// Lattice coordinates of a place on the sensor: p in steps of col (unshifted), j in rows.
static void to_lattice(const sv_lenslet_grid *g, double x, double y, double *p, double *j) {
  double det = g->col_px[0] * g->row_px[1] - g->col_px[1] * g->row_px[0];
  double dx = x - g->offset_px[0], dy = y - g->offset_px[1];
  *p = (dx * g->row_px[1] - dy * g->row_px[0]) / det;
  *j = (dy * g->col_px[0] - dx * g->col_px[1]) / det;
}

void sv_lenslet_grid_settle(sv_lenslet_grid *g, double x, double y) {
  double rows = g->is_hexagonal ? ROW_STEP : 1, p, j, best[2] = {0, 0}, nearest = 1e300;
  double det = g->col_px[0] * g->row_px[1] - g->col_px[1] * g->row_px[0];
  g->pitch_px = sqrt(fabs(det) / rows);
  // Sum of both step directions, the second rotated back by a right angle, weighted as in the fit.
  g->rotation_rad = sv_atan2(g->col_px[1] - g->row_px[0], g->col_px[0] + g->row_px[1]);
  to_lattice(g, x, y, &p, &j);
  for (int jj = (int)floor(j); jj <= (int)floor(j) + 1; jj++)
    for (int ii = (int)floor(p) - 1; ii <= (int)floor(p) + 1; ii++) {
      double at[2];
      sv_lenslet_centre(g, ii, jj, at);
      double d = (at[0] - x) * (at[0] - x) + (at[1] - y) * (at[1] - y);
      if (d < nearest) {
        nearest = d;
        best[0] = at[0];
        best[1] = at[1];
      }
    }
  // Rows keep their parity: an odd row is shifted against an even one by half a step.
  g->offset_px[0] = best[0];
  g->offset_px[1] = best[1];
}

// --- plan ----------------------------------------------------------------------------------------

static sv_status check_cfg(const sv_lenslet_plan *p, sv_err *err) {
  const sv_lenslet_cfg *c = &p->cfg;
  double reach = 0.5 * (c->keep - 1) * c->step_px;
  if (c->keep < 1 || c->keep > 16 || !(c->step_px > 0) || !(c->floor > 0 && c->floor < 1) ||
      !(c->black >= 0 && c->black < 1))
    return sv_fail(err, SV_E_ARG,
                   "lenslets: keep %d, step %g px, floor %g, black %g; 1 to 16, above 0, 0 to 1 and 0 to 1 "
                   "were expected",
                   c->keep, c->step_px, c->floor, c->black);
  if (reach > 0.5 * p->grid.pitch_px)
    return sv_fail(err, SV_E_RANGE,
                   "lenslets of %.2f px: %d samples %g px apart reach into the neighbours; at most %d fit",
                   p->grid.pitch_px, c->keep, c->step_px, (int)floor(p->grid.pitch_px / c->step_px) + 1);
  return SV_OK;
}

// The rectangle |p| <= n, |j| <= m of the lattice with its corners on a sensor of half sides wx,
// wy.
static bool inscribe(const sv_lenslet_grid *g, double wx, double wy, double *n, double *m) {
  double a = fabs(g->col_px[0]), b = fabs(g->row_px[0]), c = fabs(g->col_px[1]), d = fabs(g->row_px[1]);
  double det = a * d - b * c;
  *n = (wx * d - wy * b) / det;
  *m = (wy * a - wx * c) / det;
  return det > 0 && *n >= 1 && *m >= 1;
}

sv_status sv_lenslet_plan_make(sv_lenslet_plan *p, const sv_lenslet_grid *g, const sv_lenslet_cfg *cfg, int w,
                               int h, sv_err *err) {
  *p = (sv_lenslet_plan){.grid = *g, .cfg = *cfg, .sensor_width_px = w, .sensor_height_px = h};
  if (p->cfg.step_px == 0) p->cfg.step_px = 1;
  if (p->cfg.floor == 0) p->cfg.floor = 0.1;
  sv_status s = check_cfg(p, err);
  if (s != SV_OK) return s;
  double col = sqrt(g->col_px[0] * g->col_px[0] + g->col_px[1] * g->col_px[1]), n, m, pc, jc;
  double row = sqrt(g->row_px[0] * g->row_px[0] + g->row_px[1] * g->row_px[1]);
  // Samples around a centre, and two pixels beside each for the interpolation.
  double edge = 0.5 * (p->cfg.keep - 1) * p->cfg.step_px * 1.2 + 2.5;
  if (!inscribe(g, 0.5 * w - edge, 0.5 * h - edge, &n, &m))
    return sv_fail(err, SV_E_RANGE,
                   "lenslets of %.2f px: a sensor of %dx%d pixels holds no whole image of them", g->pitch_px,
                   w, h);
  to_lattice(g, 0.5 * w, 0.5 * h, &pc, &jc);
  p->j0 = (int)ceil(jc - m);
  p->height_px = (int)floor(jc + m) - p->j0 + 1;
  p->dq = 1;
  if (g->is_hexagonal) {
    n -= 2.5; // half a step of shift, and two lenslets beside each for the interpolation
    p->dq = row / col;
    p->width_px = n > 0 ? (int)floor(2 * n / p->dq) + 1 : 0;
    p->q0 = pc - 0.5 * (p->width_px - 1) * p->dq;
    p->i0 = (int)floor(p->q0 - 0.5) - 1;
    p->n_columns = (int)floor(p->q0 + (p->width_px - 1) * p->dq) + 3 - p->i0;
  } else {
    p->q0 = p->i0 = (int)ceil(pc - n);
    p->width_px = p->n_columns = (int)floor(pc + n) - p->i0 + 1;
  }
  if (p->width_px < 2 || p->height_px < 2)
    return sv_fail(err, SV_E_RANGE, "lenslets of %.2f px: only %dx%d of them on a sensor of %dx%d pixels",
                   g->pitch_px, p->width_px, p->height_px, w, h);
  for (int k = 0; k < 2; k++) {
    p->axis_u[k] = g->col_px[k] / col * p->cfg.step_px;
    p->axis_v[k] = g->row_px[k] / row * p->cfg.step_px;
  }
  p->cx_px = (pc - p->q0) / p->dq + 0.5;
  p->cy_px = jc - p->j0 + 0.5;
  return SV_OK;
}

// --- vignetting ----------------------------------------------------------------------------------

// The value below which `share` of the samples of channel 0 lie, by two histograms of 256 bins: the
// second divides the bin of the first.
static float percentile(const sv_raw *raw, double share) {
  uint32_t bins[256];
  float lo = 0, span = 1;
  double rank = share * raw->width_px * raw->height_px;
  for (int level = 0; level < 2; level++) {
    memset(bins, 0, sizeof bins);
    for (int y = 0; y < raw->height_px; y++)
      for (int x = 0; x < raw->width_px; x++) {
        float b = (sv_raw_at(raw, x, y, 0) - lo) / span * 256;
        if (b >= 0 && b < 256) bins[(int)b]++;
        else if (b >= 256 && lo + span >= 1) bins[255]++;
      }
    int i = 0;
    for (; i < 255 && rank > bins[i]; i++) rank -= bins[i];
    lo += span * (float)i / 256;
    span /= 256;
  }
  return lo + 0.5f * span;
}

sv_status sv_lenslet_gain(const sv_lenslet_plan *p, const char *name, const sv_raw *white, float *gain,
                          sv_err *err) {
  if (white->width_px != p->sensor_width_px || white->height_px != p->sensor_height_px)
    return sv_fail(err, SV_E_FORMAT, "%s: %dx%d pixels, the sensor has %dx%d", name, white->width_px,
                   white->height_px, p->sensor_width_px, p->sensor_height_px);
  float black = (float)p->cfg.black, level = percentile(white, 0.99) - black;
  float cap = (float)(1 / p->cfg.floor);
  if (!(level > 1e-3f)) return sv_fail(err, SV_E_FORMAT, "%s: it is black; a white image was expected", name);
  for (int y = 0; y < white->height_px; y++)
    for (int x = 0; x < white->width_px; x++) {
      float w = sv_raw_at(white, x, y, 0) - black;
      *gain++ = w * cap > level ? level / w : cap;
    }
  return SV_OK;
}

// --- decoding ------------------------------------------------------------------------------------

// Catmull-Rom: weights of the four neighbours of a place t in [0, 1) between the middle two.
static void cubic(float t, float w[4]) {
  w[0] = ((-0.5f * t + 1) * t - 0.5f) * t;
  w[1] = (1.5f * t - 2.5f) * t * t + 1;
  w[2] = ((-1.5f * t + 2) * t + 0.5f) * t;
  w[3] = (0.5f * t - 0.5f) * t * t;
}

typedef struct {
  const sv_raw *raw;
  const float *gain;
  int channel;
  float black, cap;
} reader;

static float corrected(const reader *r, int x, int y, float *gain) {
  *gain = r->gain[(size_t)y * (size_t)r->raw->width_px + (size_t)x];
  float v = (sv_raw_at(r->raw, x, y, r->channel) - r->black) * *gain;
  return v > 0 ? v : 0;
}

// Near a lenslet's rim: bilinear over the lit ones of the four pixels around, or over all four when
// none is lit.
static float at_rim(const reader *r, int x, int y, float fx, float fy) {
  float sum = 0, weight = 0, any = 0, gain;
  for (int k = 0; k < 4; k++) {
    float w = (k & 1 ? fx : 1 - fx) * (k & 2 ? fy : 1 - fy);
    float v = corrected(r, x + 1 + (k & 1), y + 1 + (k >> 1), &gain);
    any += w * v;
    if (gain < r->cap) {
      sum += w * v;
      weight += w;
    }
  }
  return weight > 1e-3f ? sum / weight : any;
}

static float sample(const reader *r, const double at[2]) {
  double px = at[0] - 0.5, py = at[1] - 0.5, ix = floor(px), iy = floor(py);
  int x = sv_clampi((int)ix - 1, 0, r->raw->width_px - 4),
      y = sv_clampi((int)iy - 1, 0, r->raw->height_px - 4);
  float fx = (float)(px - ix), fy = (float)(py - iy), wx[4], wy[4], sum = 0, gain;
  cubic(fx, wx);
  cubic(fy, wy);
  for (int b = 0; b < 4; b++) {
    float line = 0;
    for (int a = 0; a < 4; a++) {
      line += wx[a] * corrected(r, x + a, y + b, &gain);
      if (!(gain < r->cap)) return at_rim(r, x, y, fx, fy);
    }
    sum += wy[b] * line;
  }
  return sum > 0 ? sum : 0;
}

// Lenslets i0 .. i0 + n_columns of one row, resampled to the sub-view's square pixels.
static void spread(const sv_lenslet_plan *p, int j, const float *row, float *out) {
  for (int s = 0; s < p->width_px; s++) {
    double q = p->q0 + s * p->dq - (j & 1 ? 0.5 : 0.0) - p->i0, i = floor(q);
    float w[4], sum = 0;
    cubic((float)(q - i), w);
    for (int k = 0; k < 4; k++) sum += w[k] * row[sv_clampi((int)i - 1 + k, 0, p->n_columns - 1)];
    out[s] = sum > 0 ? sum : 0;
  }
}

void sv_lenslet_decode(const sv_lenslet_plan *p, const sv_lenslet_image *image, int c, int r, float *row,
                       float *out) {
  reader rd = {image->raw, image->gain, image->channel, (float)p->cfg.black, (float)(1 / p->cfg.floor)};
  double u = c - 0.5 * (p->cfg.keep - 1), v = r - 0.5 * (p->cfg.keep - 1);
  for (int t = 0; t < p->height_px; t++, out += p->width_px) {
    float *to = p->grid.is_hexagonal ? row : out;
    for (int i = 0; i < p->n_columns; i++) {
      double at[2];
      sv_lenslet_centre(&p->grid, p->i0 + i, p->j0 + t, at);
      for (int k = 0; k < 2; k++) at[k] += u * p->axis_u[k] + v * p->axis_v[k];
      to[i] = sample(&rd, at);
    }
    if (p->grid.is_hexagonal) spread(p, p->j0 + t, row, out);
  }
}

// --- rig -----------------------------------------------------------------------------------------

sv_status sv_lenslet_rig(sv_rig *rig, const sv_lenslet_plan *p, const sv_lenslet_optics *o) {
  int keep = p->cfg.keep;
  const sv_lenslet_grid *g = &p->grid;
  if (rig->cap_sub_views < keep * keep) return SV_E_FULL;
  double wide = p->dq * sqrt(g->col_px[0] * g->col_px[0] + g->col_px[1] * g->col_px[1]);
  double high = sqrt(g->row_px[0] * g->row_px[0] + g->row_px[1] * g->row_px[1]);
  double fx = o->focal_px, fy = fx * wide / high, shift = o->focus_m > 0 ? o->baseline_m / o->focus_m : 0;
  sv_copy(rig->name, sizeof rig->name, "lenslets");
  rig->forward = SV_FORWARD_LIGHT_FIELD;
  rig->n_sub_views = keep * keep;
  for (int i = 0; i < keep * keep; i++) {
    sv_sub_view *s = &rig->sub_views[i];
    double u = i % keep - 0.5 * (keep - 1), v = i / keep - 0.5 * (keep - 1);
    memset(s, 0, sizeof *s);
    sv_fmt(s->name, sizeof s->name, "r%dc%d", i / keep, i % keep);
    s->i_camera = i;
    s->model = (sv_camera_model){.kind = SV_MODEL_PINHOLE,
                                 .width_px = p->width_px,
                                 .height_px = p->height_px,
                                 .p = {fx, fy, p->cx_px + fx * shift * u, p->cy_px + fy * shift * v}};
    s->cam_from_rig = sv_pose_identity();
    s->cam_from_rig.t[0] = -u * o->baseline_m;
    s->cam_from_rig.t[1] = -v * o->baseline_m;
  }
  return SV_OK;
}
