// SPDX-License-Identifier: Apache-2.0
#include <math.h>
#include <stdio.h>
#include <string.h>

#include "tests/kernels/splat_scene.h"

typedef struct {
  double n_marked, n_needed;
} share;

// Whether a pixel of the block reaches alpha 1/255, in double; slack > 0 asks for a little more.
static bool is_needed(const sv_splat *s, const sv_kview *v, int bx, int by, double slack) {
  for (int k = 0; k < 16; k++) {
    int x = 4 * bx + k % 4, y = 4 * by + k / 4;
    if (x >= v->width_px || y >= v->height_px) continue;
    double dx = (double)s->u_px - (x + 0.5), dy = (double)s->v_px - (y + 0.5);
    double power =
        (double)s->qa * dx * dx + (double)s->qb * dx * dy + (double)s->qc * dy * dy + (double)s->lo;
    if (power >= (double)SV_POWER_MIN + slack) return true;
  }
  return false;
}

// Every block of the picture against brute force.
static void against_brute_force(ck *c, const sc_scene *s, uint32_t id, const sv_intersection *intersection,
                                double slack, share *sum) {
  const sv_splat *p = s->project.splat + id;
  const sv_kview *v = &s->project.view;
  int n_tx = (p->bx1 >> 3) - (p->bx0 >> 3) + 1;
  for (int by = 0; 4 * by < v->height_px; by++)
    for (int bx = 0; 4 * bx < v->width_px; bx++) {
      int tx = (bx >> 3) - (p->bx0 >> 3), ty = (by >> 3) - (p->by0 >> 3);
      bool is_in = tx >= 0 && ty >= 0 && tx < n_tx && by >> 3 <= p->by1 >> 3, is_marked = false;
      if (is_in)
        is_marked = intersection[p->intersection_offset + (uint32_t)(ty * n_tx + tx)].mask >>
                        (8 * (by & 7) + (bx & 7)) &
                    1;
      if (is_marked) {
        sum->n_marked++;
        sum->n_needed += is_needed(p, v, bx, by, 0);
      } else
        ck_true(c, !is_needed(p, v, bx, by, slack), "splat %u: block %d,%d is needed, but not marked", id, bx,
                by);
    }
}

static void check_fields(ck *c, const sc_scene *s, const sv_intersection *intersection) {
  for (uint32_t i = 0; i < s->n_visible; i++) {
    const sv_splat *p = s->project.splat + s->order[i];
    uint32_t r = p->intersection_offset;
    for (int ty = p->by0 >> 3; ty <= p->by1 >> 3; ty++)
      for (int tx = p->bx0 >> 3; tx <= p->bx1 >> 3; tx++, r++)
        ck_true(c,
                intersection[r].id == s->order[i] &&
                    intersection[r].tile == (uint32_t)(ty * s->n_tiles_x + tx),
                "intersection %u holds tile %u of %u", r, intersection[r].tile, intersection[r].id);
  }
}

static void bin_case(ck *c, const sc_cfg *cfg, share *sum) {
  ck_begin(c, "%s n %d %dx%d", sc_name(cfg->kind), cfg->n_gaussians, cfg->width_px, cfg->height_px);
  sc_scene s;
  sc_init(c, &s, cfg);
  sc_project(c, &s);
  sc_bin(c, &s);
  sv_intersection *intersection = ck_bytes(c, (s.n_intersections + SV_BIN_SLACK) * sizeof *intersection);
  for (uint32_t i = 0, n = 5; i < s.n_visible;
       i += n, n = 3 * n + 2) { // less than a vector, and more than one
    if (n > s.n_visible - i) n = s.n_visible - i;
    c->var.bin(s.project.splat, s.order + i, n, s.n_tiles_x, intersection);
  }
  if (c->is_exact)
    ck_same_bytes(c, "intersections", s.intersection, intersection, s.n_intersections * sizeof *intersection);
  check_fields(c, &s, intersection);
  // Where the form's terms are huge against their sum, float cannot place the border to 0.02 px.
  double slack = cfg->kind == SC_HOSTILE || cfg->kind == SC_EDGE ? 0.05 : 1e-3;
  for (uint32_t i = 0; i < s.n_visible && cfg->width_px <= 1000; i++)
    against_brute_force(c, &s, s.order[i], intersection, slack, sum);
}

static void check_bin(ck *c) {
  static const int sizes[][2] = {{1, 1},     {4, 4},    {14, 12},  {33, 31},   {70, 45},
                                 {320, 240}, {640, 20}, {20, 640}, {16384, 40}};
  for (int kind = 0; kind < SC_N_KINDS; kind++) {
    share sum = {0, 0};
    for (size_t z = 0; z < sizeof sizes / sizeof *sizes; z++)
      for (int n = 1; n < 300; n = 3 * n + 5) {
        sc_cfg cfg = {n, 0, 0, sizes[z][0], sizes[z][1], kind, (n & 1) != 0};
        bin_case(c, &cfg, &sum);
      }
    double waste = 1 - sum.n_needed / sum.n_marked;
    if (c->isa == SV_ISA_REF)
      printf("  bin %s: %.1f %% of the marked blocks are not needed\n", sc_name(kind), 100 * waste);
    ck_true(c, waste < 0.15, "%s: %.1f %% of the marked blocks are not needed", sc_name(kind), 100 * waste);
  }
}

static void run_bin(void *arg, const sv_kernels *k) {
  sc_scene *s = arg;
  k->bin(s->project.splat, s->order, s->n_visible, s->n_tiles_x, s->intersection);
}

static void bench_bin(ck *c) {
  ck_begin(c, "bench");
  sc_scene s;
  sc_cfg cfg = {10000, 0, 0, 640, 480, SC_TYPICAL, false};
  sc_init(c, &s, &cfg);
  sc_project(c, &s);
  sc_bin(c, &s);
  ck_time(c, "640x480; per splat", s.n_visible, run_bin, &s);
}

CK_REGISTER(bin, check_bin, bench_bin)
