// SPDX-License-Identifier: Apache-2.0
#include <math.h>
#include <string.h>

#include "kernels/simd/s1_math.h"
#include "tests/kernels/splat_scene.h"

// of the rows, in use
static const int degrees[][2] = {{0, 0}, {1, 1}, {2, 2}, {3, 3}, {3, 0}, {2, 1}};
static const int counts[] = {1, 15, 16, 17, 31, 48, 61};
static const int sizes[][2] = {{1, 1}, {14, 12}, {320, 240}, {1000, 37}, {16384, 40}};
#define N_OF(a) ((int)(sizeof(a) / sizeof *(a)))

#define N_FLOATS 12 // of an sv_splat, before the integers
_Static_assert(offsetof(sv_splat, bx0) == 4 * N_FLOATS && sizeof(sv_splat) == 64,
               "sv_splat is 12 floats and 16 bytes");

static void compare_splats(ck *c, const sv_splat *a, const sv_splat *b, const sc_scene *s) {
  int n = 16 * s->n_blocks, n_other = 0;
  for (int i = 0; i < n; i++) {
    if (i >= s->project.n_gaussians)
      ck_true(c, b[i].n_intersections == 0, "Gaussian %d is past the end, but visible", i);
    if (c->is_exact) {
      ck_same(c, "splat", &a[i].u_px, &b[i].u_px, N_FLOATS, 0);
      ck_same_bytes(c, "bounds", &a[i].bx0, &b[i].bx0, 16);
      continue;
    }
    n_other += memcmp(&a[i].bx0, &b[i].bx0, 16) != 0; // on the other side of a rounding
    if (!a[i].n_intersections || !b[i].n_intersections) continue;
    ck_same_abs(c, "u v", &a[i].u_px, &b[i].u_px, 2, 1e-6 * s->project.view.width_px);
    ck_same(c, "quadratic form", &a[i].qa, &b[i].qa, 4, 2e-4);
    ck_same(c, "colour, z", a[i].rgb, b[i].rgb, 4, 1e-5);
    ck_same(c, "ellipse", &a[i].dy_right, &b[i].dy_right, 2, 2e-4);
  }
  ck_true(c, n_other <= 1 + n / 20, "%d of %d splats have other bounds", n_other, n);
}

static void project_case(ck *c, const sc_cfg *cfg) {
  ck_begin(c, "%s n %d SH %d/%d %dx%d aa %d dropout %d fisheye %d", sc_name(cfg->kind), cfg->n_gaussians,
           cfg->sh_used, cfg->sh_rows, cfg->width_px, cfg->height_px, cfg->is_antialiased, cfg->has_dropout,
           cfg->is_fisheye);
  sc_scene s;
  sc_init(c, &s, cfg);
  size_t n = 16 * (size_t)s.n_blocks;
  sv_project_args v = s.project;
  v.splat = ck_bytes(c, n * sizeof *v.splat);
  v.depth_key = ck_bytes(c, n * 4);
  const sv_project_counts all = c->ref.project(&s.project, 0, s.n_blocks, sc_scratch());
  const sv_project_counts last =
      c->var.project(&v, s.n_blocks / 2, s.n_blocks, sc_scratch()); // in two ranges
  const sv_project_counts first = c->var.project(&v, 0, s.n_blocks / 2, sc_scratch());
  if (c->is_exact)
    ck_true(c,
            first.n_visible + last.n_visible == all.n_visible &&
                first.n_intersections + last.n_intersections == all.n_intersections,
            "%u and %u visible ones, not %u; %u and %u intersections, not %u", first.n_visible,
            last.n_visible, all.n_visible, first.n_intersections, last.n_intersections, all.n_intersections);
  compare_splats(c, s.project.splat, v.splat, &s);
  for (size_t i = 0; i < n; i++)
    if (s.project.splat[i].n_intersections && v.splat[i].n_intersections && c->is_exact)
      ck_same_bytes(c, "depth key", s.project.depth_key + i, v.depth_key + i, 4);
  for (size_t i = 0; i < n; i++) { // what later stages rely on
    const sv_splat *p = v.splat + i;
    if (!p->n_intersections) continue;
    ck_true(c, !v.dropout_mask || !(v.dropout_mask[i / 16] >> i % 16 & 1),
            "splat %zu is left out, but visible", i);
    ck_true(c,
            p->z > 0.1f && p->bx0 <= p->bx1 && p->by0 <= p->by1 && 4 * p->bx1 < cfg->width_px &&
                4 * p->by1 < cfg->height_px && p->qa < 0 && p->qc < 0 && isfinite(p->u_px) &&
                isfinite(p->v_px),
            "splat %zu is visible, but z %g, blocks %d-%d %d-%d, form %g %g", i, p->z, p->bx0, p->bx1, p->by0,
            p->by1, p->qa, p->qc);
  }
}

static void check_project(ck *c) {
  for (int kind = 0; kind < SC_N_KINDS; kind++)
    for (int d = 0; d < N_OF(degrees); d++)
      for (int n = 0; n < N_OF(counts); n++)
        for (int z = 0; z < N_OF(sizes); z++) {
          if (!c->is_exact && kind != SC_TYPICAL) continue; // no bound without FMA
          sc_cfg cfg = {counts[n],   degrees[d][0], degrees[d][1],   sizes[z][0],
                        sizes[z][1], kind,          (n + z + d) & 1, (n + z) % 3 == 0};
          project_case(c, &cfg);
          cfg.is_fisheye = true;
          project_case(c, &cfg);
        }
}

// --- backward ----------------------------------------

// Slots as rasterization would leave them, but of any size; a third of the intersections has none.
static void make_igrads(ck *c, sc_scene *s, int fill, uint8_t **igrad) {
  for (int i = 0; i < 16 * s->n_blocks; i++) {
    s->project.splat[i].intersection_offset = s->n_intersections;
    if (s->project.splat[i].n_intersections > 40) s->project.splat[i].n_intersections = 40;
    s->n_intersections += s->project.splat[i].n_intersections;
  }
  size_t n = s->n_intersections;
  s->intersection = ck_bytes(c, n * sizeof *s->intersection);
  float *values = ck_floats(c, n * SV_IGRAD_VALUES);
  ck_fill(c, values, n * SV_IGRAD_VALUES, fill);
  *igrad = ck_bytes(c, n * SV_IGRAD_BYTES);
  for (uint32_t i = 0; i < 16 * (uint32_t)s->n_blocks; i++) {
    const sv_splat *p = s->project.splat + i;
    for (uint32_t r = p->intersection_offset; r < p->intersection_offset + p->n_intersections; r++)
      s->intersection[r].id = i;
  }
  for (size_t i = 0; i < n; i++) {
    s->intersection[i].mask = sv_rng_below(&c->rng, 3) ? 1 + sv_rng_u32(&c->rng) : 0;
    s1_store11(*igrad + i * SV_IGRAD_BYTES, values + i * SV_IGRAD_VALUES);
    if (!s->intersection[i].mask)
      memset(*igrad + i * SV_IGRAD_BYTES, 0xff, SV_IGRAD_BYTES); // NaN: must not be read
  }
}

static void compare_grads(ck *c, const sc_scene *s, const float *a, const float *b) {
  int n_used = SV_N_ROWS(s->project.sh_degree);
  for (int row = 0; row < n_used; row++)
    ck_same_abs(c, "grad", a + 16 * row, b + 16 * row, 16, 3e-3 * (1e-3 + sc_largest(a + 16 * row, 16)));
  float fresh;
  memset(&fresh, 0xff, 4);
  for (int i = 16 * n_used; i < 16 * s->n_rows; i++)
    ck_true(c, memcmp(b + i, &fresh, 4) == 0, "row %d is of a degree not in use, but written", i / 16);
}

static void bwd_case(ck *c, const sc_cfg *cfg, int fill) {
  ck_begin(c, "%s n %d SH %d/%d aa %d fisheye %d gradients %s", sc_name(cfg->kind), cfg->n_gaussians,
           cfg->sh_used, cfg->sh_rows, cfg->is_antialiased, cfg->is_fisheye, ck_fill_name(fill));
  sc_scene s;
  uint8_t *igrad;
  float *g[2], *err[2], *pose[2];
  sc_init(c, &s, cfg);
  sc_project(c, &s);
  make_igrads(c, &s, fill, &igrad);
  for (int i = 0; i < 2; i++) {
    g[i] = ck_floats(c, 16 * (size_t)s.n_rows);
    err[i] = ck_floats(c, 16);
    pose[i] = ck_floats(c, 6);
  }
  for (int b = 0; b < s.n_blocks; b++) {
    sv_project_bwd_args a = {&s.project, s.intersection, igrad, pose[0], 0.01f, 0.02f};
    for (int i = 0; i < 2; i++) memset(g[i], 0xff, 64 * (size_t)s.n_rows);
    uint32_t touched = c->ref.project_bwd(&a, b, g[0], err[0], sc_scratch());
    a.pose_grad = pose[1];
    ck_true(c, c->var.project_bwd(&a, b, g[1], err[1], sc_scratch()) == touched,
            "block %d: other lanes touched", b);
    compare_grads(c, &s, g[0], g[1]);
    ck_same_abs(c, "err", err[0], err[1], 16, 1e-5 * sc_largest(err[0], 16));
    ck_same_abs(c, "pose", pose[0], pose[1], 6, 3e-3 * sc_largest(pose[0], 6));
    for (int i = 0; i < 16; i++)
      for (int row = 0; row < SV_N_ROWS(cfg->sh_used) && !(touched >> i & 1); row++)
        ck_true(c, g[1][16 * row + i] == 0, "lane %d is not touched, row %d is not 0", i, row);
    a.pose_grad = NULL;
    memset(g[0], 0xff, 64 * (size_t)s.n_rows);
    (void)c->var.project_bwd(&a, b, g[0], err[0], sc_scratch());
    ck_same_bytes(c, "grad without pose", g[1], g[0], 64 * (size_t)s.n_rows);
  }
}

static void check_project_bwd(ck *c) {
  for (int kind = 0; kind < SC_N_KINDS; kind++)
    for (int fill = 0; fill < CK_N_FILLS; fill++)
      for (int d = 0; d < N_OF(degrees); d++)
        for (int n = 0; n < N_OF(counts); n++) {
          if (!c->is_exact && (kind != SC_TYPICAL || fill >= CK_DENORM)) continue;
          // Overflow to infinity makes the reference's products with zero coefficients NaN.
          if (kind == SC_HOSTILE && fill >= CK_HUGE) continue;
          sc_cfg cfg = {counts[n], degrees[d][0], degrees[d][1], 320, 240, kind, (n + d) & 1};
          bwd_case(c, &cfg, fill);
          cfg.is_fisheye = true;
          bwd_case(c, &cfg, fill);
        }
}

// --- bench ----------------------------------------

typedef struct {
  sc_scene s;
  sv_project_bwd_args bwd;
  float *grad, *err, *pose;
} project_job;

static void run_project(void *arg, const sv_kernels *k) {
  project_job *j = arg;
  k->project(&j->s.project, 0, j->s.n_blocks, sc_scratch());
}
static void run_bwd(void *arg, const sv_kernels *k) {
  project_job *j = arg;
  for (int b = 0; b < j->s.n_blocks; b++) (void)k->project_bwd(&j->bwd, b, j->grad, j->err, sc_scratch());
}

static project_job make_job(ck *c, int sh_degree, bool is_fisheye) {
  ck_begin(c, "bench");
  project_job j;
  sc_cfg cfg = {4096, sh_degree, sh_degree, 640, 480, SC_TYPICAL, true, false, is_fisheye};
  sc_init(c, &j.s, &cfg);
  return j;
}

static void bench_project(ck *c) {
  for (int degree = 0; degree < 4; degree += 3) {
    project_job j = make_job(c, degree, false);
    ck_time(c, degree ? "SH 3; per Gaussian" : "SH 0; per Gaussian", 4096, run_project, &j);
  }
  project_job j = make_job(c, 3, true);
  ck_time(c, "SH 3, fisheye; per Gaussian", 4096, run_project, &j);
}

static const char *const bwd_names[] = {"SH 0; per Gaussian", "SH 3; per Gaussian",
                                        "SH 3, fisheye; per Gaussian"};

static void bench_project_bwd(ck *c) {
  for (int i = 0; i < 3; i++) {
    project_job j = make_job(c, i ? 3 : 0, i == 2);
    uint8_t *igrad;
    sc_project(c, &j.s);
    make_igrads(c, &j.s, CK_SIGNED, &igrad);
    j.grad = ck_floats(c, 16 * SV_CAP_ROWS);
    j.err = ck_floats(c, 16);
    j.pose = ck_floats(c, 6);
    j.bwd = (sv_project_bwd_args){&j.s.project, j.s.intersection, igrad, j.pose, 0.01f, 0.02f};
    ck_time(c, bwd_names[i], 4096, run_bwd, &j);
  }
}

CK_REGISTER(project, check_project, bench_project)
CK_REGISTER(project_bwd, check_project_bwd, bench_project_bwd)
