// SPDX-License-Identifier: Apache-2.0
// The tree is implicit: a range [lo, hi) of the index array has its median at the middle, split
// along the axis stored for that position; no nodes, no recursion.
#include "src/splat/neighbours.h"

typedef struct {
  const float *xyz;
  int *index;
  uint8_t *axis; // split axis of the range whose median is here
} tree;

typedef struct {
  int lo, hi;
} range;

static float coord(const tree *t, int i, int axis) { return t->xyz[3 * t->index[i] + axis]; }

static int widest_axis(const tree *t, range r) {
  float best = -1;
  int axis = 0;
  for (int a = 0; a < 3; a++) {
    float lo = coord(t, r.lo, a), hi = lo;
    for (int i = r.lo + 1; i < r.hi; i++) {
      float x = coord(t, i, a);
      lo = x < lo ? x : lo;
      hi = x > hi ? x : hi;
    }
    if (hi - lo > best) {
      best = hi - lo;
      axis = a;
    }
  }
  return axis;
}

// Hoare's selection: afterwards everything left of k is <= index[k] <= everything right of it.
static void select_median(tree *t, range r, int k, int axis) {
  int lo = r.lo, hi = r.hi - 1;
  while (lo < hi) {
    float pivot = coord(t, lo + (hi - lo) / 2, axis);
    int i = lo, j = hi;
    while (i <= j) {
      while (coord(t, i, axis) < pivot) i++;
      while (coord(t, j, axis) > pivot) j--;
      if (i > j) break;
      int s = t->index[i];
      t->index[i++] = t->index[j];
      t->index[j--] = s;
    }
    if (k <= j) hi = j;
    else if (k >= i) lo = i;
    else return;
  }
}

#define CAP_STACK 64 // twice the depth of a balanced tree over 2^31 points

static void build(tree *t, int n) {
  range stack[CAP_STACK];
  int depth = 0;
  stack[depth++] = (range){0, n};
  while (depth) {
    range r = stack[--depth];
    if (r.hi - r.lo < 2) continue;
    int mid = r.lo + (r.hi - r.lo) / 2, axis = widest_axis(t, r);
    select_median(t, r, mid, axis);
    t->axis[mid] = (uint8_t)axis;
    stack[depth++] = (range){r.lo, mid};
    stack[depth++] = (range){mid + 1, r.hi};
  }
}

typedef struct {
  float d2[3]; // ascending
  int of[3];
  int n;
} best3;

static void offer(best3 *b, float d2, int of) {
  if (b->n == 3 && d2 >= b->d2[2]) return;
  int i = b->n < 3 ? b->n++ : 2;
  for (; i > 0 && b->d2[i - 1] > d2; i--) {
    b->d2[i] = b->d2[i - 1];
    b->of[i] = b->of[i - 1];
  }
  b->d2[i] = d2;
  b->of[i] = of;
}

static best3 query(const tree *t, int n, int self) {
  struct {
    range r;
    float d2; // squared distance from the point to the half-space that holds r
  } stack[CAP_STACK];
  best3 best = {{0, 0, 0}, {-1, -1, -1}, 0};
  const float *p = t->xyz + 3 * self;
  int depth = 0;
  stack[depth].r = (range){0, n};
  stack[depth++].d2 = 0;
  while (depth) {
    range r = stack[--depth].r;
    if (r.lo >= r.hi || (best.n == 3 && stack[depth].d2 >= best.d2[2])) continue;
    int mid = r.lo + (r.hi - r.lo) / 2;
    const float *q = t->xyz + 3 * t->index[mid];
    if (t->index[mid] != self) {
      float dx = p[0] - q[0], dy = p[1] - q[1], dz = p[2] - q[2];
      offer(&best, dx * dx + dy * dy + dz * dz, t->index[mid]);
    }
    if (r.hi - r.lo < 2) continue;
    float off = p[t->axis[mid]] - q[t->axis[mid]];
    range left = {r.lo, mid}, right = {mid + 1, r.hi};
    stack[depth].r = off < 0 ? right : left; // the far side waits below the near one
    stack[depth++].d2 = off * off;
    stack[depth].r = off < 0 ? left : right;
    stack[depth++].d2 = 0;
  }
  return best;
}

size_t sv_neighbours_bytes(int n) {
  sv_arena dry = sv_arena_dry();
  SV_TAKE(&dry, int, n);
  SV_TAKE(&dry, uint8_t, n);
  return dry.used_bytes;
}

sv_status sv_neighbours(const float *xyz, int n, float *dist2, sv_arena *scratch) {
  return sv_neighbours_find(xyz, n, dist2, NULL, scratch);
}

sv_status sv_neighbours_find(const float *xyz, int n, float *dist2, int32_t *nearest, sv_arena *scratch) {
  size_t mark = sv_arena_mark(scratch);
  tree t = {xyz, SV_TAKE(scratch, int, n), SV_TAKE(scratch, uint8_t, n)};
  if (scratch->status < 0) {
    sv_arena_reset(scratch, mark);
    return SV_E_NOMEM;
  }
  for (int i = 0; i < n; i++) t.index[i] = i;
  build(&t, n);
  for (int i = 0; i < n; i++) {
    best3 b = query(&t, n, i);
    dist2[i] = 0;
    for (int k = 0; k < b.n; k++) dist2[i] += b.d2[k] / (float)b.n;
    for (int k = 0; k < 3 && nearest; k++) nearest[3 * i + k] = b.of[k];
  }
  sv_arena_reset(scratch, mark);
  return SV_OK;
}
