// SPDX-License-Identifier: Apache-2.0
#include "tests/kernels/splat_scene.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "calib/fisheye.h"

static const char *const names[SC_N_KINDS] = {"typical", "opaque", "edge", "hostile"};
const char *sc_name(int kind) { return names[kind]; }

static float between(ck *c, float lo, float hi) { return lo + (hi - lo) * sv_rng_f(&c->rng); }

static float wild(ck *c, float ordinary) {
  static const float values[] = {0.0f, 1e-40f, -1e-38f, 1e-20f, -3e7f, 1e15f, -1e18f, 1e30f, 1.0f};
  uint32_t k = sv_rng_below(&c->rng, 24);
  return k < sizeof values / sizeof *values ? values[k] : ordinary;
}

static void hostile(ck *c, float *p, int n_rows) {
  for (int k = 0; k < 3; k++) p[16 * k] = sv_rng_below(&c->rng, 4) ? p[16 * k] : wild(c, p[16 * k]);
  float tiny = sv_rng_below(&c->rng, 3) ? 1.0f : sv_rng_below(&c->rng, 2) ? 1e-12f : 1e-25f;
  for (int k = SV_ROW_QUAT; k < SV_ROW_SCALE; k++) p[16 * k] = wild(c, p[16 * k] * tiny);
  for (int k = SV_ROW_SCALE; k < SV_ROW_LOGIT; k++) p[16 * k] = between(c, -20, 8);
  p[16 * SV_ROW_LOGIT] = between(c, -13.8f, 16.1f);
  for (int k = SV_ROW_SH; k < n_rows; k++) p[16 * k] = wild(c, p[16 * k]);
}

// Camera-space position -> world.
static void place(const sv_kview *v, float x, float y, float z, float *p) {
  float t[3] = {x - v->t[0], y - v->t[1], z - v->t[2]};
  for (int i = 0; i < 3; i++) p[16 * i] = v->r[i] * t[0] + v->r[3 + i] * t[1] + v->r[6 + i] * t[2];
}

static void edge(ck *c, const sv_kview *v, float *p) {
  static const float depths[] = {0.1f, 0.1000001f, 0.0999999f, 0.0f, -1.0f, 1e-6f, 0.2f, 2.0f};
  float z = depths[sv_rng_below(&c->rng, 8)], tan_x = 0.5f * (float)v->width_px / v->fx;
  if (sv_rng_below(&c->rng, 3) == 0) z = 2.0f;
  place(v, between(c, -3, 3) * tan_x * z, between(c, -3, 3) * tan_x * z, z, p);
  for (int k = SV_ROW_SCALE; k < SV_ROW_LOGIT; k++) p[16 * k] = between(c, -3, 0.5f);
}

static void fill(ck *c, const sv_kview *v, float *param, int n_blocks, int n_rows, int kind) {
  for (int i = 0; i < 16 * n_blocks; i++) {
    float *p = param + (long)(i / 16) * n_rows * 16 + i % 16;
    for (int k = 0; k < 3; k++) p[16 * k] = between(c, -1.1f, 1.1f);
    for (int k = SV_ROW_QUAT; k < SV_ROW_SCALE; k++) p[16 * k] = sv_rng_normal(&c->rng);
    float s = kind == SC_OPAQUE ? between(c, -2, -1) : -4.2f + 1.2f * sv_rng_f(&c->rng);
    for (int k = SV_ROW_SCALE; k < SV_ROW_LOGIT; k++) p[16 * k] = s + between(c, -0.7f, 0.7f);
    p[16 * SV_ROW_LOGIT] = kind == SC_OPAQUE ? between(c, 2, 9) : 3.0f * sv_rng_normal(&c->rng) - 1.0f;
    for (int k = SV_ROW_SH; k < n_rows; k++) p[16 * k] = 0.3f * sv_rng_normal(&c->rng);
    if (kind == SC_EDGE) edge(c, v, p);
    if (kind == SC_HOSTILE) hostile(c, p, n_rows);
  }
}

static sv_kview make_view(const sc_cfg *cfg) {
  float f = 1.0f * (float)(cfg->width_px > cfg->height_px ? cfg->width_px : cfg->height_px);
  sv_kview v = {.width_px = cfg->width_px,
                .height_px = cfg->height_px,
                .fx = f,
                .fy = 0.97f * f,
                .cx = 0.48f * (float)cfg->width_px,
                .cy = 0.55f * (float)cfg->height_px,
                .t = {0.1f, -0.05f, 2.6f},
                .near_z = 0.1f,
                .dilation_px2 = 0.3f,
                .is_antialiased = cfg->is_antialiased};
  double q[4] = {0.9, 0.2, -0.3, 0.15}, n = sqrt(0.81 + 0.04 + 0.09 + 0.0225), w = q[0] / n, x = q[1] / n,
         y = q[2] / n, z = q[3] / n;
  double r[9] = {1 - 2 * (y * y + z * z), 2 * (x * y - w * z),     2 * (x * z + w * y),
                 2 * (x * y + w * z),     1 - 2 * (x * x + z * z), 2 * (y * z - w * x),
                 2 * (x * z - w * y),     2 * (y * z + w * x),     1 - 2 * (x * x + y * y)};
  for (int i = 0; i < 9; i++) v.r[i] = (float)r[i];
  for (int i = 0; i < 3; i++) v.centre[i] = -(v.r[i] * v.t[0] + v.r[3 + i] * v.t[1] + v.r[6 + i] * v.t[2]);
  sv_kview_set_limits(&v);
  if (!cfg->is_fisheye) return v;
  static sv_fisheye fisheye;
  const double half_px =
      0.5 * sqrt((double)cfg->width_px * cfg->width_px + (double)cfg->height_px * cfg->height_px);
  const double focal = half_px / 1.5;
  const sv_camera_model m = {
      SV_MODEL_KB4,
      cfg->width_px,
      cfg->height_px,
      {focal, 0.97 * focal, 0.48 * cfg->width_px, 0.55 * cfg->height_px, 0.01, -0.01, 0.002, -0.0002}};
  if (!sv_fisheye_make(&fisheye, &m)) abort();
  v.fx = (float)m.p[0];
  v.fy = (float)m.p[1];
  v.t[2] = 0.6f; // among the Gaussians
  for (int i = 0; i < 3; i++) v.centre[i] = -(v.r[i] * v.t[0] + v.r[3 + i] * v.t[1] + v.r[6 + i] * v.t[2]);
  v.fisheye = &fisheye;
  return v;
}

void sc_init(ck *c, sc_scene *s, const sc_cfg *cfg) {
  memset(s, 0, sizeof *s);
  s->n_blocks = (cfg->n_gaussians + 15) / 16;
  s->n_rows = SV_N_ROWS(cfg->sh_rows);
  s->n_tiles_x = (cfg->width_px + 31) / 32;
  s->n_tiles = s->n_tiles_x * ((cfg->height_px + 31) / 32);
  sv_kview v = make_view(cfg);
  size_t n = 16 * (size_t)s->n_blocks;
  float *param = ck_floats(c, n * (size_t)s->n_rows);
  fill(c, &v, param, s->n_blocks, s->n_rows, cfg->kind);
  s->project = (sv_project_args){.param = param,
                                 .n_rows = s->n_rows,
                                 .sh_degree = cfg->sh_used,
                                 .n_gaussians = cfg->n_gaussians,
                                 .view = v,
                                 .splat = ck_bytes(c, n * sizeof(sv_splat)),
                                 .depth_key = ck_bytes(c, n * 4)};
  if (!cfg->has_dropout) return;
  uint16_t *dropout_mask = ck_bytes(c, (size_t)s->n_blocks * sizeof *dropout_mask);
  for (int b = 0; b < s->n_blocks; b++)
    dropout_mask[b] = (uint16_t)(sv_rng_u32(&c->rng) & sv_rng_u32(&c->rng));
  s->project.dropout_mask = dropout_mask;
  s->project.log2_compensation = between(c, 0.0f, 2.0f);
}

float *sc_scratch(void) {
  static _Alignas(64) float scratch[SV_PROJECT_SCRATCH_FLOATS];
  return scratch;
}

void sc_project(ck *c, sc_scene *s) { c->ref.project(&s->project, 0, s->n_blocks, sc_scratch()); }

static void sort_by_depth(ck *c, sc_scene *s) {
  size_t n = 16 * (size_t)s->n_blocks;
  s->order = ck_bytes(c, n * 4);
  sv_sort_args a = {.pair = ck_bytes(c, n * sizeof(sv_pair)),
                    .tmp = ck_bytes(c, n * sizeof(sv_pair)),
                    .hist = ck_bytes(c, SV_SORT_CAP_BUCKETS * sizeof(uint32_t)),
                    .order = s->order};
  for (uint32_t i = 0; i < n; i++)
    if (s->project.splat[i].n_intersections) a.pair[a.n++] = (sv_pair){s->project.depth_key[i], i};
  s->n_visible = a.n;
  c->ref.sort(&a);
}

void sc_bin(ck *c, sc_scene *s) {
  sort_by_depth(c, s);
  for (uint32_t i = 0; i < s->n_visible; i++) {
    sv_splat *p = s->project.splat + s->order[i];
    p->intersection_offset = s->n_intersections;
    s->n_intersections += p->n_intersections;
  }
  s->intersection = ck_bytes(c, (s->n_intersections + SV_BIN_SLACK) * sizeof *s->intersection);
  c->ref.bin(s->project.splat, s->order, s->n_visible, s->n_tiles_x, s->intersection);
  s->list = ck_bytes(c, (size_t)s->n_intersections * 4);
  s->tile_begin = ck_bytes(c, ((size_t)s->n_tiles + 1) * 4);
  for (uint32_t t = 0; t < (uint32_t)s->n_tiles; t++) {
    s->tile_begin[t] = s->n_listed;
    for (uint32_t i = 0; i < s->n_intersections; i++)
      if (s->intersection[i].tile == t && s->intersection[i].mask) s->list[s->n_listed++] = i;
  }
  s->tile_begin[s->n_tiles] = s->n_listed;
}

void *sc_copy(ck *c, const void *p, size_t n) {
  void *q = ck_bytes(c, n);
  memcpy(q, p, n);
  return q;
}

double sc_largest(const float *p, size_t n) {
  double m = 0;
  for (size_t i = 0; i < n; i++)
    if (isfinite(p[i])) m = fmax(m, fabs((double)p[i]));
  return m;
}
