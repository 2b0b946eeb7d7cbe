// SPDX-License-Identifier: Apache-2.0
// The deformation field's kernels: planes, planes_bwd, planes_add, linear, linear_bwd.
#include <string.h>

#include "tests/kernels/check.h"

// vectors, levels, points along x y z t
static const int shapes[][6] = {
    {1, 1, 5, 4, 3, 2}, {1, 2, 8, 8, 8, 7}, {2, 3, 4, 6, 5, 3}, {2, 1, 2, 2, 2, 2}};
static const int layers[][3] = {
    {16, 64, 0}, {64, 64, 1}, {64, 10, 1}, {32, 1, 1}, {128, 3, 1}}; // in, out, relu
#define N_SHAPES ((int)(sizeof shapes / sizeof *shapes))
#define N_LAYERS ((int)(sizeof layers / sizeof *layers))

typedef struct {
  sv_planes_args a;
  float *c, *d, *part, *grad;
  size_t n_feature, n_part, n_plane;
} planes_job;

static const int axes[6][2] = {{0, 1}, {0, 2}, {0, 3}, {1, 2}, {1, 3}, {2, 3}};

static planes_job make_planes(ck *c, const int s[6], int fill) {
  planes_job j = {.a = {.n_vec = s[0], .n_levels = s[1]}};
  j.n_feature = (size_t)(256 * s[0] * s[1]);
  j.n_part = 6 * j.n_feature;
  for (int l = 0; l < s[1]; l++) {
    for (int i = 0; i < 4; i++) j.a.res[l][i] = s[2 + i] * (i < 3 ? 1 + l : 1);
    for (int p = 0; p < SV_FIELD_PLANES; p++) {
      size_t n = (size_t)(16 * s[0] * j.a.res[l][axes[p][0]] * j.a.res[l][axes[p][1]]);
      float *f = ck_floats(c, n);
      ck_fill(c, f, n, CK_SIGNED);
      j.a.plane[l][p] = f;
      if (l == s[1] - 1 && p == 4) j.n_plane = n;
    }
  }
  j.c = ck_floats(c, 64);
  j.d = ck_floats(c, j.n_feature);
  ck_fill(c, j.c, 64, CK_UNIT);
  ck_fill(c, j.d, j.n_feature, fill);
  for (int i = 0; i < 64; i += 7) j.c[i] = (float)(i % 3) - 0.5f; // beyond the border, and on it
  j.c[1] = 0.0f;
  j.c[18] = 1.0f;
  j.c[35] = 1.0f;
  return j;
}

static void check_planes(ck *c) {
  for (int s = 0; s < N_SHAPES; s++) {
    ck_begin(c, "shape %d", s);
    planes_job j = make_planes(c, shapes[s], CK_SIGNED);
    float *a = ck_floats(c, j.n_feature), *b = ck_floats(c, j.n_feature);
    c->ref.planes(&j.a, j.c, a);
    c->var.planes(&j.a, j.c, b);
    ck_same(c, "feature", a, b, j.n_feature, 1e-5);
  }
}

static void check_planes_bwd(ck *c) {
  for (int s = 0; s < N_SHAPES; s++)
    for (int fill = 0; fill < CK_DENORM; fill++) {
      ck_begin(c, "shape %d %s", s, ck_fill_name(fill));
      planes_job j = make_planes(c, shapes[s], fill);
      float *a = ck_floats(c, j.n_part), *b = ck_floats(c, j.n_part), *da = ck_floats(c, 48),
            *db = ck_floats(c, 48);
      c->ref.planes_bwd(&j.a, j.c, j.d, a, da);
      c->var.planes_bwd(&j.a, j.c, j.d, b, db);
      ck_same(c, "part", a, b, j.n_part, 1e-5);
      ck_same(c, "dc", da, db, 48, 1e-3);
    }
}

static void check_planes_add(ck *c) {
  static const uint32_t masks[] = {0xffff, 0, 1, 0x8000, 0x5a5a};
  for (int s = 0; s < N_SHAPES; s++)
    for (int m = 0; m < 5; m++) {
      ck_begin(c, "shape %d mask %04x", s, masks[m]);
      planes_job j = make_planes(c, shapes[s], CK_SIGNED);
      float *part = ck_floats(c, j.n_part), *a = ck_floats(c, j.n_plane), *b = ck_floats(c, j.n_plane);
      ck_fill(c, part, j.n_part, CK_SIGNED);
      ck_fill(c, a, j.n_plane, CK_SIGNED);
      memcpy(b, a, j.n_plane * sizeof *a);
      c->ref.planes_add(&j.a, j.a.n_levels - 1, 4, &(sv_planes_block){j.c, part, masks[m]}, a);
      c->var.planes_add(&j.a, j.a.n_levels - 1, 4, &(sv_planes_block){j.c, part, masks[m]}, b);
      ck_same(c, "gradient", a, b, j.n_plane, 1e-5);
    }
}

typedef struct {
  sv_linear_args a;
  float *x, *y, *dx, *dw, *db;
} linear_job;

static linear_job make_linear(ck *c, const int s[3], int fill) {
  size_t in = (size_t)s[0], out = (size_t)s[1];
  float *w = ck_floats(c, in * out), *b = ck_floats(c, out);
  linear_job j = {.a = {.w = w, .b = b, .n_in = s[0], .n_out = s[1], .is_relu = s[2]},
                  .x = ck_floats(c, 16 * in),
                  .y = ck_floats(c, 16 * out),
                  .dx = ck_floats(c, 16 * in),
                  .dw = ck_floats(c, in * out),
                  .db = ck_floats(c, out)};
  ck_fill(c, w, in * out, CK_SIGNED);
  ck_fill(c, b, out, CK_SIGNED);
  ck_fill(c, j.x, 16 * in, fill);
  ck_fill(c, j.y, 16 * out, fill);
  ck_fill(c, j.dw, in * out, CK_SIGNED);
  ck_fill(c, j.db, out, CK_SIGNED);
  return j;
}

static void check_linear(ck *c) {
  for (int s = 0; s < N_LAYERS; s++)
    for (int fill = 0; fill < CK_DENORM; fill++) {
      ck_begin(c, "layer %d %s", s, ck_fill_name(fill));
      linear_job j = make_linear(c, layers[s], fill);
      float *y = ck_floats(c, 16 * (size_t)j.a.n_out);
      c->ref.linear(&j.a, j.x, j.y);
      c->var.linear(&j.a, j.x, y);
      ck_same(c, "y", j.y, y, 16 * (size_t)j.a.n_out, 1e-4);
    }
}

static void check_linear_bwd(ck *c) {
  for (int s = 0; s < N_LAYERS; s++)
    for (int fill = 0; fill < CK_DENORM; fill++) {
      ck_begin(c, "layer %d %s", s, ck_fill_name(fill));
      linear_job j = make_linear(c, layers[s], fill);
      size_t in = (size_t)j.a.n_in, out = (size_t)j.a.n_out;
      float *dx = ck_floats(c, 16 * in), *dw = ck_floats(c, in * out), *db = ck_floats(c, out);
      memcpy(dw, j.dw, in * out * sizeof *dw);
      memcpy(db, j.db, out * sizeof *db);
      c->ref.linear_bwd(&j.a, j.x, j.y, j.dx, j.dw, j.db);
      c->var.linear_bwd(&j.a, j.x, j.y, dx, dw, db);
      ck_same(c, "dx", j.dx, dx, 16 * in, 1e-4);
      ck_same(c, "dw", j.dw, dw, in * out, 1e-5);
      ck_same(c, "db", j.db, db, out, 1e-5);
    }
}

static void run_planes(void *arg, const sv_kernels *k) {
  planes_job *j = arg;
  k->planes(&j->a, j->c, j->d);
}
static void run_planes_bwd(void *arg, const sv_kernels *k) {
  planes_job *j = arg;
  float dc[48];
  k->planes_bwd(&j->a, j->c, j->d, j->part, dc);
}
static void run_planes_add(void *arg, const sv_kernels *k) {
  planes_job *j = arg;
  k->planes_add(&j->a, 0, 4, &(sv_planes_block){j->c, j->part, 0xffff}, j->grad);
}
static void run_linear(void *arg, const sv_kernels *k) {
  linear_job *j = arg;
  k->linear(&j->a, j->x, j->y);
}
static void run_linear_bwd(void *arg, const sv_kernels *k) {
  linear_job *j = arg;
  k->linear_bwd(&j->a, j->x, j->y, j->dx, j->dw, j->db);
}

static planes_job bench_planes_job(ck *c) {
  static const int s[6] = {1, 1, 48, 48, 48, 48};
  ck_begin(c, "bench");
  planes_job j = make_planes(c, s, CK_SIGNED);
  j.part = ck_floats(c, j.n_part);
  j.grad = ck_floats(c, j.n_plane);
  ck_fill(c, j.part, j.n_part, CK_SIGNED);
  ck_fill(c, j.grad, j.n_plane, CK_SIGNED);
  return j;
}
static void bench_planes(ck *c) {
  planes_job j = bench_planes_job(c);
  ck_time(c, "48 points, 16 channels; per Gaussian", 16, run_planes, &j);
}
static void bench_planes_bwd(ck *c) {
  planes_job j = bench_planes_job(c);
  ck_time(c, "48 points, 16 channels; per Gaussian", 16, run_planes_bwd, &j);
}
static void bench_planes_add(ck *c) {
  planes_job j = bench_planes_job(c);
  ck_time(c, "48 points, 16 channels; per Gaussian", 16, run_planes_add, &j);
}
static void bench_linear(ck *c) {
  ck_begin(c, "bench");
  linear_job j = make_linear(c, layers[1], CK_SIGNED);
  ck_time(c, "64 to 64; per Gaussian", 16, run_linear, &j);
}
static void bench_linear_bwd(ck *c) {
  ck_begin(c, "bench");
  linear_job j = make_linear(c, layers[1], CK_SIGNED);
  ck_time(c, "64 to 64; per Gaussian", 16, run_linear_bwd, &j);
}

CK_REGISTER(planes, check_planes, bench_planes)
CK_REGISTER(planes_bwd, check_planes_bwd, bench_planes_bwd)
CK_REGISTER(planes_add, check_planes_add, bench_planes_add)
CK_REGISTER(linear, check_linear, bench_linear)
CK_REGISTER(linear_bwd, check_linear_bwd, bench_linear_bwd)
