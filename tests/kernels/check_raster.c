// SPDX-License-Identifier: Apache-2.0
#include <math.h>
#include <string.h>

#include "kernels/simd/s1_math.h"
#include "tests/kernels/splat_scene.h"

// Masks: as binned, or of any kind, not agreeing with what the splats reach.
enum { BINNED, ALL_BLOCKS, ONE_BLOCK, RANDOM_BLOCKS, SOME_EMPTY, N_MASKS };
static const char *const mask_names[N_MASKS] = {"binned", "all", "one", "random", "some empty"};

typedef struct {
  sc_scene s;
  size_t n_px; // of one padded plane
  sv_raster_args args;
  sv_raster_bwd_args bwd;
  float *scratch;
} raster_job;

static void set_masks(ck *c, sc_scene *s, int kind) {
  for (uint32_t i = 0; i < s->n_intersections; i++) {
    uint64_t r = (uint64_t)sv_rng_u32(&c->rng) << 32 | sv_rng_u32(&c->rng);
    if (kind == ALL_BLOCKS) s->intersection[i].mask = ~0ull;
    if (kind == ONE_BLOCK) s->intersection[i].mask = 1ull << (r & 63);
    if (kind == RANDOM_BLOCKS) s->intersection[i].mask = r;
    if (kind == SOME_EMPTY) s->intersection[i].mask &= r & 1 ? 0 : ~0ull;
  }
}

static float *plane(ck *c, const raster_job *j, int fill, float scale) {
  float *p = ck_floats(c, j->n_px);
  ck_fill(c, p, j->n_px, fill);
  for (size_t i = 0; i < j->n_px; i++) p[i] *= scale;
  return p;
}

// Outputs of its own, intersections of its own.
static void set_forward(ck *c, raster_job *j, const sv_intersection *intersection, bool has_depth) {
  j->args =
      (sv_raster_args){.splat = j->s.project.splat,
                       .intersection = sc_copy(c, intersection, j->s.n_intersections * sizeof *intersection),
                       .n_tiles_x = j->s.n_tiles_x,
                       .stride = 32 * j->s.n_tiles_x,
                       .bg = {0.2f, 0.7f, 0.4f}};
  for (int i = 0; i < 3; i++) j->args.rgb[i] = ck_floats(c, j->n_px);
  j->args.depth = has_depth ? ck_floats(c, j->n_px) : NULL;
  j->args.trans = has_depth ? ck_floats(c, j->n_px) : NULL;
  j->scratch = ck_floats(c, SV_RASTER_SCRATCH_FLOATS);
}

static void run_tiles(void *arg, const sv_kernels *k) {
  raster_job *j = arg;
  const uint32_t *begin = j->s.tile_begin;
  for (int t = 0; t < j->s.n_tiles; t++)
    k->raster(&j->args, (uint32_t)t, j->s.list + begin[t], begin[t + 1] - begin[t], j->scratch);
}

static void run_tiles_bwd(void *arg, const sv_kernels *k) {
  raster_job *j = arg;
  const uint32_t *begin = j->s.tile_begin;
  for (int t = 0; t < j->s.n_tiles; t++)
    k->raster_bwd(&j->bwd, (uint32_t)t, j->s.list + begin[t], begin[t + 1] - begin[t], j->scratch);
}

static void make_scene(ck *c, raster_job *j, const sc_cfg *cfg, int masks) {
  sc_init(c, &j->s, cfg);
  sc_project(c, &j->s);
  sc_bin(c, &j->s);
  set_masks(c, &j->s, masks);
  j->n_px = 1024 * (size_t)j->s.n_tiles;
}

// Without FMA a contribution at a cut-off may fall on the other side: few pixels, and of a bounded
// size.
static void compare_plane(ck *c, const char *name, const float *a, const float *b, size_t n, double scale) {
  if (c->is_exact) {
    ck_same(c, name, a, b, n, 0);
    return;
  }
  size_t n_far = 0;
  for (size_t i = 0; i < n; i++) n_far += !(fabs((double)a[i] - (double)b[i]) <= 2e-5 * scale);
  ck_true(c, n_far <= 2 + n / 200, "%s: %zu of %zu pixels are far off", name, n_far, n);
  ck_same_abs(c, name, a, b, n, 0.03 * scale);
}

static void compare_forward(ck *c, const raster_job *a, const raster_job *b) {
  for (int i = 0; i < 3; i++) compare_plane(c, "rgb", a->args.rgb[i], b->args.rgb[i], a->n_px, 3);
  if (a->args.depth) {
    compare_plane(c, "depth", a->args.depth, b->args.depth, a->n_px, 4);
    compare_plane(c, "trans", a->args.trans, b->args.trans, a->n_px, 1);
  }
  if (c->is_exact)
    ck_same_bytes(c, "intersections", a->args.intersection, b->args.intersection,
                  a->s.n_intersections * sizeof *a->args.intersection);
}

static const int tile_counts[][2] = {{1, 1}, {3, 1}, {1, 2}, {2, 2}};

// flags: 1 depth, and with it only 2 dL/ddepth, 4 dL/dtrans; 8 err.
static void raster_case(ck *c, int kind, int n, int size, int masks, int flags, int fill, bool has_bwd) {
  sc_cfg cfg = {n, 0, 0, 32 * tile_counts[size][0] - 5, 32 * tile_counts[size][1] - 3, kind, (n & 1) != 0};
  ck_begin(c, "%s n %d %dx%d masks %s planes %d gradients %s", sc_name(kind), n, cfg.width_px, cfg.height_px,
           mask_names[masks], flags, ck_fill_name(fill));
  raster_job a, b;
  make_scene(c, &a, &cfg, masks);
  b = a;
  set_forward(c, &a, a.s.intersection, flags & 1);
  set_forward(c, &b, a.s.intersection, flags & 1);
  run_tiles(&a, &c->ref);
  if (!has_bwd) {
    run_tiles(&b, &c->var);
    compare_forward(c, &a, &b);
    return;
  }
  a.bwd = (sv_raster_bwd_args){.fwd = &a.args,
                               .g_depth = flags & 2 && flags & 1 ? plane(c, &a, fill, 1) : NULL,
                               .g_trans = flags & 4 && flags & 1 ? plane(c, &a, fill, 1) : NULL,
                               .err = flags & 8 ? plane(c, &a, CK_UNIT, 1) : NULL};
  for (int i = 0; i < 3; i++) a.bwd.g_rgb[i] = plane(c, &a, fill, 1);
  b.bwd = a.bwd;
  size_t n_igrads = a.s.n_intersections;
  a.bwd.igrad = ck_bytes(c, n_igrads * SV_IGRAD_BYTES);
  b.bwd.igrad = ck_bytes(c, n_igrads * SV_IGRAD_BYTES);
  run_tiles_bwd(&a, &c->ref);
  run_tiles_bwd(&b, &c->var); // on what the reference's forward pass left
  float *sums[2] = {ck_floats(c, n_igrads * SV_IGRAD_VALUES), ck_floats(c, n_igrads * SV_IGRAD_VALUES)};
  float *errs[2] = {ck_floats(c, n_igrads), ck_floats(c, n_igrads)};
  for (int k = 0; k < 2; k++)
    for (size_t i = 0; i < n_igrads; i++) {
      float *to = sums[k] + i * SV_IGRAD_VALUES;
      s1_load11((k ? b : a).bwd.igrad + i * SV_IGRAD_BYTES, to);
      errs[k][i] = to[SV_IGRAD_ERR];
      to[SV_IGRAD_ERR] = 0;
    }
  double tol = c->is_exact ? 0 : 2e-3 * sc_largest(sums[0], n_igrads * SV_IGRAD_VALUES);
  ck_same_abs(c, "igrads", sums[0], sums[1], n_igrads * SV_IGRAD_VALUES, tol);
  ck_same_abs(c, "errors", errs[0], errs[1], n_igrads, CK_HIGH_TOL * sc_largest(errs[0], n_igrads));
}

static void all_cases(ck *c, bool has_bwd) {
  static const int counts[] = {1, 5, 16, 60, 200};
  for (int kind = 0; kind < SC_N_KINDS; kind++)
    for (int n = 0; n < 5; n++)
      for (int size = 0; size < 4; size++)
        for (int masks = 0; masks < N_MASKS; masks++)
          for (int flags = 0; flags < 16; flags++) {
            int fill = has_bwd ? (n + size + masks + flags) % CK_DENORM : CK_UNIT;
            if (has_bwd && flags == 7) fill = CK_DENORM;
            // backward: every set of planes on a few splats, fewer on many
            if (has_bwd ? (flags + n + size + masks) % (n < 2 ? 3 : 11) : flags > 1) continue;
            // no bound without FMA
            if (!c->is_exact && (kind == SC_HOSTILE || kind == SC_EDGE)) continue;
            raster_case(c, kind, counts[n], size, masks, flags, fill, has_bwd);
          }
}

static void check_raster(ck *c) { all_cases(c, false); }
static void check_raster_bwd(ck *c) { all_cases(c, true); }

// --- surface -------------------------------------------------------------------------------------

static void compare_near(ck *c, const float *a, const float *b, size_t n) {
  size_t n_far = 0;
  for (size_t i = 0; i < n; i++)
    n_far += !(fabs((double)a[i] - (double)b[i]) <= 1e-3 * (fabs((double)a[i]) + 1));
  ck_true(c, n_far <= 2 + n / 200, "depth: %zu of %zu pixels are far off", n_far, n);
}

typedef struct {
  raster_job r;
  sv_surface_args args;
} surface_job;

static void run_surface(void *arg, const sv_kernels *k) {
  surface_job *j = arg;
  const uint32_t *begin = j->r.s.tile_begin;
  for (int t = 0; t < j->r.s.n_tiles; t++)
    k->surface(&j->args, (uint32_t)t, j->r.s.list + begin[t], begin[t + 1] - begin[t], j->r.scratch);
}

static void make_surface(ck *c, surface_job *j, const sc_cfg *cfg, int masks) {
  make_scene(c, &j->r, cfg, masks);
  j->r.scratch = ck_floats(c, SV_SURFACE_SCRATCH_FLOATS);
  j->args = (sv_surface_args){.splat = j->r.s.project.splat,
                              .intersection = j->r.s.intersection,
                              .n_tiles_x = j->r.s.n_tiles_x,
                              .stride = 32 * j->r.s.n_tiles_x,
                              .depth = ck_floats(c, j->r.n_px)};
}

static void surface_case(ck *c, int kind, int n, int size, int masks) {
  static const float slab[][3] = {{0.75f, 0.6f, 0.02f}, {1, 0.5f, 0}, {0.6f, 0.02f, 0.1f}};
  const sc_cfg cfg = {n, 0, 0, 32 * tile_counts[size][0] - 5, 32 * tile_counts[size][1] - 3, kind, false};
  for (int i = 0; i < 3; i++) {
    ck_begin(c, "%s n %d %dx%d masks %s slab %d", sc_name(kind), n, cfg.width_px, cfg.height_px,
             mask_names[masks], i);
    surface_job a, b;
    make_surface(c, &a, &cfg, masks);
    a.args.from = slab[i][0];
    a.args.to = slab[i][1];
    a.args.near = slab[i][2];
    b = a;
    b.args.depth = ck_floats(c, a.r.n_px);
    b.r.scratch = ck_floats(c, SV_SURFACE_SCRATCH_FLOATS);
    run_surface(&a, &c->ref);
    run_surface(&b, &c->var);
    // Without FMA a pixel may just miss the slab's end.
    if (c->is_exact) ck_same(c, "depth", a.args.depth, b.args.depth, a.r.n_px, 0);
    else compare_near(c, a.args.depth, b.args.depth, a.r.n_px);
  }
}

static void check_surface(ck *c) {
  static const int counts[] = {1, 16, 200};
  for (int kind = 0; kind < SC_N_KINDS; kind++)
    for (int n = 0; n < 3; n++)
      for (int size = 0; size < 4; size++)
        for (int masks = 0; masks < N_MASKS; masks++)
          if (c->is_exact || (kind != SC_HOSTILE && kind != SC_EDGE))
            surface_case(c, kind, counts[n], size, masks);
}

// --- bench: splats as at the end of training (4 to 15 px) and at its start (20 to 60 px) ---------

static double make_bench(ck *c, raster_job *j, int n, int kind) {
  ck_begin(c, "bench");
  sc_cfg cfg = {n, 0, 0, 320, 240, kind, false};
  make_scene(c, j, &cfg, BINNED);
  set_forward(c, j, j->s.intersection, true);
  run_tiles(j, &c->ref); // narrows the masks: afterwards they stay
  j->bwd = (sv_raster_bwd_args){.fwd = &j->args,
                                .igrad = ck_bytes(c, (size_t)j->s.n_intersections * SV_IGRAD_BYTES)};
  for (int i = 0; i < 3; i++) j->bwd.g_rgb[i] = plane(c, j, CK_SIGNED, 1e-3f);
  j->bwd.g_depth = plane(c, j, CK_SIGNED, 1e-4f);
  j->bwd.err = plane(c, j, CK_UNIT, 1);
  double n_pairs = 0;
  for (uint32_t i = 0; i < j->s.n_listed; i++)
    n_pairs += 16 * __builtin_popcountll(j->args.intersection[j->s.list[i]].mask);
  return n_pairs;
}

static void bench_raster(ck *c) {
  raster_job j;
  double n = make_bench(c, &j, 10000, SC_TYPICAL);
  ck_time(c, "320x240 small splats; per pair", n, run_tiles, &j);
  n = make_bench(c, &j, 400, SC_OPAQUE);
  ck_time(c, "320x240 large splats; per pair", n, run_tiles, &j);
}

static void bench_raster_bwd(ck *c) {
  raster_job j;
  double n = make_bench(c, &j, 10000, SC_TYPICAL);
  ck_time(c, "320x240 small splats; per pair", n, run_tiles_bwd, &j);
  j.bwd.g_depth = NULL;
  ck_time(c, "320x240 small splats without depth; per pair", n, run_tiles_bwd, &j);
  n = make_bench(c, &j, 400, SC_OPAQUE);
  ck_time(c, "320x240 large splats; per pair", n, run_tiles_bwd, &j);
}

static void bench_surface(ck *c) {
  static const sc_cfg cfg = {10000, 0, 0, 320, 240, SC_TYPICAL, false};
  surface_job j;
  ck_begin(c, "bench");
  make_surface(c, &j, &cfg, BINNED);
  j.args.from = 0.75f;
  j.args.to = 0.6f;
  j.args.near = 0.02f;
  ck_time(c, "320x240 small splats; per intersection", j.r.s.n_listed, run_surface, &j);
}

CK_REGISTER(raster, check_raster, bench_raster)
CK_REGISTER(raster_bwd, check_raster_bwd, bench_raster_bwd)
CK_REGISTER(surface, check_surface, bench_surface)
