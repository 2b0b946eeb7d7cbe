// SPDX-License-Identifier: Apache-2.0
#include <string.h>

#include "tests/kernels/check.h"

static int cells(int n) { return (n + SV_CORNER_CELL - 1) / SV_CORNER_CELL; }

static sv_corner_args make_args(ck *c, const float *src, int w, int h, int stride, int margin) {
  sv_corner_args a = {
      .src = src, .width_px = w, .height_px = h, .stride = stride, .margin_px = margin, .cell1 = cells(h)};
  a.out = ck_bytes(c, sizeof(sv_corner) * (size_t)(cells(w) * cells(h)));
  a.scratch = ck_floats(c, (size_t)SV_CORNER_SCRATCH_FLOATS(stride));
  return a;
}

static void one_case(ck *c, int w, int h, int margin, int fill) {
  ck_begin(c, "%dx%d margin %d %s", w, h, margin, ck_fill_name(fill));
  int stride = (w + 31) / 32 * 32, n = cells(w) * cells(h);
  float *src = ck_bytes_at_end(c, sizeof(float) * (size_t)(stride * h)); // the padding stays NaN
  for (int r = 0; r < h; r++) ck_fill(c, src + r * stride, (size_t)w, fill);
  sv_corner_args a = make_args(c, src, w, h, stride, margin), b = make_args(c, src, w, h, stride, margin);
  c->ref.corner(&a);
  b.cell1 = cells(h) / 2;
  c->var.corner(&b);
  b.cell0 = cells(h) / 2;
  b.cell1 = cells(h);
  c->var.corner(&b);
  ck_same_bytes(c, "out", a.out, b.out, sizeof(sv_corner) * (size_t)n);
}

// The corner of a bright square is found where it is, and a straight edge is none.
static void square_case(ck *c) {
  ck_begin(c, "a square");
  float *src = ck_floats(c, 64 * 48);
  memset(src, 0, sizeof(float) * 64 * 48);
  for (int y = 20; y < 48; y++)
    for (int x = 24; x < 64; x++) src[y * 64 + x] = 1.0f;
  sv_corner_args a = make_args(c, src, 64, 48, 64, 3);
  c->var.corner(&a);
  const sv_corner *k = &a.out[1 * 4 + 1], *edge = &a.out[1 * 4 + 2];
  ck_true(c, k->score > 1.0f && k->x >= 23 && k->x <= 25 && k->y >= 19 && k->y <= 21,
          "corner (24, 20) found at (%d, %d) with score %g", k->x, k->y, (double)k->score);
  ck_true(c, edge->score == 0.0f && edge->x == -1, "an edge counts as a corner: %g", (double)edge->score);
}

static void check_corner(ck *c) {
  static const int sizes[][2] = {{1, 1}, {6, 9}, {7, 7}, {16, 16}, {17, 33}, {31, 20}, {65, 50}, {70, 18}};
  square_case(c);
  for (size_t s = 0; s < sizeof sizes / sizeof *sizes; s++)
    for (int fill = 0; fill < CK_N_FILLS; fill++)
      for (int margin = 3; margin < 12; margin += 4) one_case(c, sizes[s][0], sizes[s][1], margin, fill);
}

static void run(void *arg, const sv_kernels *k) { k->corner(arg); }
static void bench_corner(ck *c) {
  ck_begin(c, "bench");
  float *src = ck_floats(c, 640 * 480);
  ck_fill(c, src, 640 * 480, CK_UNIT);
  sv_corner_args a = make_args(c, src, 640, 480, 640, 8);
  ck_time(c, "640x480", 640 * 480, run, &a);
}
CK_REGISTER(corner, check_corner, bench_corner)
