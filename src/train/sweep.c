// SPDX-License-Identifier: Apache-2.0
#include "src/train/sweep.h"

#include <math.h>
#include <string.h>

#include "src/base/mathx.h"
#include "src/train/sweep_gaps.h"
#include "src/train/sweep_half.h"
#include "src/train/sweep_views.h"
#include "src/train/transfer.h"

#define CAP_K        64
#define CAP_TOTAL_PX 384000 // of all maps
// Lens images share their sensor's pixels: each map is coarse enough as it is.
#define CAP_LENSES_PX 819200
#define RADIUS        SV_SWEEP_RADIUS
#define BAND          SV_SWEEP_BAND
#define ROWS          SV_SWEEP_ROWS
// of the pixel: beside an edge, an even ground would be put at the edge's depth
#define MIN_SLOPE2 4.0f
#define MIN_CORR2  0.49f // squared correlation
// Lens images that a model told apart show its floaters, too, and these agree with each other.
#define MIN_CORR2_LENSES 0.8f
#define MIN_AGREE_LENSES 3    // other maps that must have the same surface
#define LEFT             32   // columns before a row
#define AGREE            1.5f // planes that two maps may differ by

// --- sizes ---------------------------------------------------------------------------------------

static int n_maps(int n_views) { return sv_mini(n_views, SV_SWEEP_CAP_VIEWS); }

// Of all maps.
static int total_px(const sv_train_cfg *c) { return c->has_lens_views ? CAP_LENSES_PX : CAP_TOTAL_PX; }

static int reduction(int w, int h, int cap_px) {
  int k = 1;
  while (k < CAP_K && (w / k) * (h / k) > cap_px) k++;
  return k;
}

// Scales all images to similar focal lengths, within a factor of two.
static void choose_sizes(sv_sweep *s, const sv_trainer *t, int cap_px) {
  float least = 0;
  for (int i = 0; i < s->n; i++) {
    const sv_view *v = &t->views[s->map[i].i_view].view;
    s->map[i].k = reduction(v->width_px, v->height_px, sv_mini(cap_px, total_px(&t->cfg) / s->n));
    float f = v->fx / (float)s->map[i].k;
    if (i == 0 || f < least) least = f;
  }
  for (int i = 0; i < s->n; i++) {
    sv_depth_map *m = &s->map[i];
    const sv_view *v = &t->views[m->i_view].view;
    while (m->k < CAP_K && v->fx > 2.0f * least * (float)m->k) m->k++;
    m->view = sv_view_scaled(v, m->k);
  }
}

// --- geometry ------------------------------------------------------------------------------------

// Planes at equal steps of inverse depth, about a pixel apart in the view that shifts most, from
// far behind the bounds to their near side.
static void choose_planes(sv_sweep *s, int i, const sv_bounds *b) {
  sv_depth_map *m = &s->map[i];
  const sv_view *v = &m->view;
  float zc = v->fisheye ? sv_view_distance(v, b->centre)
                        : v->r[6] * b->centre[0] + v->r[7] * b->centre[1] + v->r[8] * b->centre[2] + v->t[2];
  float near = sv_maxf(0.4f * zc, 0.1f * b->radius), far = sv_maxf(zc, 0) + 8 * b->radius, most = 1;
  m->w_reach = m->w0 = 1 / far;
  m->w_near = 1 / near;
  float span = m->w_near - m->w0;
  for (int k = 0; k < m->n_sources; k++) {
    sv_transfer q = sv_transfer_make(&s->map[m->source[k]].view, v);
    float x = 0.5f * (float)v->width_px, y = 0.5f * (float)v->height_px, from[3], to[3];
    // shift a unit of w, where the scene is
    float at = zc > near ? 1 / zc : 1 / near, d = 0.01f * span;
    if (!sv_transfer_see(&q, x, y, at, from) || !sv_transfer_see(&q, x, y, at + d, to)) continue;
    most = sv_maxf(most, 100 * (float)sqrt((double)(to[0] - from[0]) * (to[0] - from[0]) +
                                           (double)(to[1] - from[1]) * (to[1] - from[1])));
  }
  m->n_planes = sv_clampi((int)(most + 1.5f), 16, SV_SWEEP_CAP_PLANES);
  m->dw = span / (float)(m->n_planes - 1);
}

// The planes behind those alone. The first is a neighbor of that at infinity.
static void choose_far_planes(sv_depth_map *m) {
  m->n_planes = (int)(m->w_reach / m->dw) + 3;
  m->w0 = -m->dw;
}

// Both.
static void choose_all_planes(sv_depth_map *m) {
  m->n_planes = sv_mini(m->n_planes + (int)(m->w_reach / m->dw) + 2, SV_SWEEP_CAP_PLANES);
  m->dw = m->w_near / (float)(m->n_planes - 2);
  m->w0 = -m->dw;
}

// --- pictures ------------------------------------------------------------------------------------

static uint32_t luma(const uint8_t *p, int n_channels) {
  uint32_t y = n_channels < 3 ? 256u * p[0] : 77u * p[0] + 150u * p[1] + 29u * p[2];
  return n_channels == 4 ? y * p[3] / 255u : y;
}

static void load_grey(const sv_trainer *t, sv_depth_map *m) {
  const sv_image_u8 *im = &t->views[m->i_view].image;
  const int k = m->k, w = m->view.width_px;
  for (int y = 0; y < m->view.height_px; y++)
    for (int x = 0; x < w; x++) {
      uint32_t sum = 0; // that of a masked pixel: without structure
      for (int i = 0; i < k * k && sv_image_counts(im, k, x, y); i++)
        sum += luma(im->px + (size_t)(y * k + i / k) * (size_t)im->stride_bytes +
                        (size_t)((x * k + i % k) * im->n_channels),
                    im->n_channels);
      m->grey[(size_t)y * (size_t)w + (size_t)x] = (uint16_t)(sum / (uint32_t)(k * k));
    }
}

// --- the sweep of one band -----------------------------------------------------------------------

// Planes of floats in rows of `stride`, those of pictures with RADIUS rows above and below and LEFT
// columns before.
typedef struct {
  float *ray[3]; // points of depth 1 in the camera's frame, where a fisheye takes part
  float *ref, *warped[SV_SWEEP_CAP_SOURCES], *is_in[SV_SWEEP_CAP_SOURCES];
  float *mean, *norm, *last, *best, *before, *after, *plane;
  int *first_plane, *last_plane; // [columns / 16] the planes that each sixteen columns look at
  int n_structured, n_matched;   // pixels that a depth was looked for, and that have one
} lane;

typedef struct {
  const sv_trainer *t;
  sv_sweep *s;
  const sv_depth_map *half; // [s->n] at half the size, with codes; NULL: all planes are looked at
  lane *lanes;
  int cap_stride, bands_of_map;
  int band_step; // one band of so many is looked at
} job;

typedef struct { // what one task does
  const sv_kernels *k;
  const sv_sweep *s;
  const sv_depth_map *m;
  lane *l;
  float min_corr2;
  int y0, stride;
  int x0, x1; // columns at work, multiples of 16: those with structure, then a part of them
} band;

static int stride_of(int width_px) { return (width_px + 15) / 16 * 16 + 2 * LEFT; }

static void carve_lane(lane *l, int stride, sv_arena *a) {
  l->n_structured = l->n_matched = 0;
  float **low[] = {&l->mean, &l->norm, &l->last, &l->best, &l->before, &l->after, &l->plane};
  for (int i = 0; i < 3; i++) l->ray[i] = SV_TAKE(a, float, ROWS *stride);
  l->ref = SV_TAKE(a, float, ROWS *stride);
  for (int i = 0; i < SV_SWEEP_CAP_SOURCES; i++) {
    l->warped[i] = SV_TAKE(a, float, ROWS *stride);
    l->is_in[i] = SV_TAKE(a, float, BAND *stride);
  }
  for (size_t i = 0; i < sizeof low / sizeof *low; i++) *low[i] = SV_TAKE(a, float, BAND *stride);
  l->first_plane = SV_TAKE(a, int, stride / 16);
  l->last_plane = SV_TAKE(a, int, stride / 16);
}

// The map's picture; the outermost pixels are repeated.
static void load_rows(const band *b) {
  const sv_depth_map *m = b->m;
  const int w = m->view.width_px;
  for (int r = 0; r < ROWS; r++) {
    const uint16_t *row =
        m->grey + (size_t)sv_clampi(b->y0 - RADIUS + r, 0, m->view.height_px - 1) * (size_t)w;
    for (int x = -LEFT; x < b->stride - LEFT; x++)
      b->l->ref[r * b->stride + LEFT + x] = (float)row[sv_clampi(x, 0, w - 1)] * (1.0f / 256.0f) - 128.0f;
  }
}

static void load_rays(const band *b) {
  for (int r = 0; r < ROWS; r++) {
    float *ray[3];
    for (int k = 0; k < 3; k++) ray[k] = b->l->ray[k] + r * b->stride;
    sv_transfer_rays(&b->m->view, -LEFT, b->y0 - RADIUS + r, b->stride, ray);
  }
}

// Source k through lenses, sixteen pixels; at: place in the band's rows.
static void warp16_wide(const band *b, int k, const sv_transfer *q, float w, int at) {
  const sv_depth_map *src = &b->s->map[b->m->source[k]];
  const float *ray[3] = {b->l->ray[0] + at, b->l->ray[1] + at, b->l->ray[2] + at};
  const int row = at / b->stride - RADIUS, inner = at - RADIUS * b->stride;
  float u[16], v[16], is_in[16];
  sv_transfer_see16(q, ray, w, u, v, is_in);
  for (int i = 0; i < 16; i++)
    b->l->warped[k][at + i] = sv_sweep_bilinear(src->grey, src->view.width_px, u[i], v[i]);
  for (int i = 0; row >= 0 && row < BAND && i < 16; i++) b->l->is_in[k][inner + i] = is_in[i];
}

// Source k as the map sees it on the plane at inverse depth w.
static void warp(const band *b, int k, const sv_transfer *q, float w) {
  for (int r = 0; r < ROWS && q->is_wide; r++)
    for (int x = b->x0 - RADIUS; x < b->x1 + RADIUS; x += 16)
      warp16_wide(b, k, q, w, r * b->stride + LEFT + x);
  if (q->is_wide) return;
  const sv_depth_map *src = &b->s->map[b->m->source[k]];
  sv_sweep_warp_args a = {.src = src->grey,
                          .width_px = src->view.width_px,
                          .height_px = src->view.height_px,
                          .x0 = b->x0 - RADIUS,
                          .x1 = b->x1 - RADIUS + 16,
                          .y0 = b->y0 - RADIUS,
                          .stride = b->stride,
                          .warped = b->l->warped[k] + LEFT,
                          .is_in = b->l->is_in[k] + LEFT};
  memcpy(a.h, q->h, sizeof a.h);
  for (int i = 0; i < 3; i++) a.e[i] = w * q->e[i];
  b->k->sweep_warp(&a);
}

// Mean and 1 / (sum of squared deviations) of the windows of the map's own picture, 0 without
// structure; and the columns that have some.
static void describe(band *b) {
  lane *l = b->l;
  const int n = b->m->view.width_px;
  int first = n, last = -1;
  b->x0 = 0;
  b->x1 = (n + 15) / 16 * 16;
  for (int i = 0; i < BAND; i++)
    for (int x = 0; x < b->x1; x++) {
      int at = i * b->stride + LEFT + x;
      float s[3];
      sv_sweep_sum_window(l->ref + at - RADIUS, l->ref + at - RADIUS, b->stride, s);
      float dev = s[1] - s[0] * s[0] * (1 / SV_SWEEP_WINDOW);
      const float *c = l->ref + at + RADIUS * b->stride;
      float dx = c[1] - c[-1], dy = c[b->stride] - c[-b->stride];
      bool is_used = x < n && b->y0 + i < b->m->view.height_px && dev > SV_SWEEP_MIN_DEV &&
                     dx * dx + dy * dy > MIN_SLOPE2;
      l->mean[at] = s[0] * (1 / SV_SWEEP_WINDOW);
      l->norm[at] = is_used ? 1 / dev : 0;
      l->n_structured += is_used;
      if (is_used) {
        first = sv_mini(first, x);
        last = sv_maxi(last, x);
      }
    }
  b->x0 = last < 0 ? 0 : first / 16 * 16;
  b->x1 = (last + 16) / 16 * 16;
}

// How well the warped pictures match the map's own, into the best so far.
static void match(const band *b, int plane) {
  const lane *l = b->l;
  sv_sweep_match_args a = {.n_sources = b->m->n_sources,
                           .ref = l->ref + LEFT,
                           .mean = l->mean + LEFT,
                           .norm = l->norm + LEFT,
                           .best = l->best + LEFT,
                           .before = l->before + LEFT,
                           .after = l->after + LEFT,
                           .last = l->last + LEFT,
                           .plane = l->plane + LEFT,
                           .i_plane = plane,
                           .x0 = b->x0,
                           .x1 = b->x1,
                           .stride = b->stride};
  for (int k = 0; k < a.n_sources; k++) {
    a.warped[k] = l->warped[k] + LEFT;
    a.is_in[k] = l->is_in[k] + LEFT;
  }
  b->k->sweep_match(&a);
}

static void write_codes(const band *b, const sv_image_u8 *im) {
  const sv_depth_map *m = b->m;
  lane *l = b->l;
  const int w = m->view.width_px;
  for (int i = 0; i < BAND && b->y0 + i < m->view.height_px; i++) {
    uint16_t *out = m->code + (size_t)(b->y0 + i) * (size_t)w;
    for (int x = 0; x < w; x++) out[x] = 0;
    for (int x = b->x0; x < sv_mini(b->x1, w); x++) {
      int at = i * b->stride + LEFT + x;
      float p = l->plane[at], before = l->before[at], best = l->best[at], after = l->after[at];
      float curvature = 2 * best - before - after;
      if (!(l->norm[at] > 0) || best < b->min_corr2 || p < 1 || p > (float)(m->n_planes - 2)) continue;
      if (!sv_image_counts(im, m->k, x, b->y0 + i)) continue;
      if (curvature > 1e-6f) p += sv_clampf(0.5f * (after - before) / curvature, -0.5f, 0.5f);
      out[x] = (uint16_t)(1.5f + 256 * p);
      l->n_matched++;
    }
  }
}

static void fill(float *p, int n, float value) {
  for (int i = 0; i < n; i++) p[i] = value;
}

static void choose_block_planes(const job *j, const band *b, int i_map) {
  for (int x = b->x0; x < b->x1; x += 16) {
    int *first = &b->l->first_plane[x / 16], *last = &b->l->last_plane[x / 16];
    *first = 0;
    *last = b->m->n_planes - 1;
    if (j->half) sv_sweep_half_planes(&j->half[i_map], b->m->n_planes, x, b->y0, first, last);
  }
}

// Moves on to the next columns up to `end` that look at a plane; false: there are none.
static bool next_columns(band *b, int plane, int end) {
  const lane *l = b->l;
  int x = b->x1;
  while (x < end && (plane < l->first_plane[x / 16] || plane > l->last_plane[x / 16])) x += 16;
  b->x0 = x;
  while (x < end && plane >= l->first_plane[x / 16] && plane <= l->last_plane[x / 16]) x += 16;
  b->x1 = x;
  return b->x1 > b->x0;
}

static void sweep_task(void *arg, int i_task, int i_thread) {
  job *j = arg;
  const sv_depth_map *m = &j->s->map[i_task / j->bands_of_map];
  lane *l = &j->lanes[i_thread];
  band b = {.k = j->t->compute.k,
            .s = j->s,
            .m = m,
            .l = l,
            .min_corr2 = j->t->cfg.has_lens_views ? MIN_CORR2_LENSES : MIN_CORR2,
            .y0 = i_task % j->bands_of_map * j->band_step * BAND,
            .stride = stride_of(m->view.width_px)};
  sv_transfer q[SV_SWEEP_CAP_SOURCES];
  const int n = BAND * b.stride;
  if (b.y0 >= m->view.height_px || m->n_planes == 0) return;
  bool is_wide = false;
  for (int k = 0; k < m->n_sources; k++) {
    q[k] = sv_transfer_make(&j->s->map[m->source[k]].view, &m->view);
    is_wide |= q[k].is_wide;
  }
  load_rows(&b);
  if (is_wide) load_rays(&b);
  describe(&b);
  fill(l->best, n, SV_SWEEP_NOT_SEEN);
  fill(l->last, n, SV_SWEEP_NOT_SEEN);
  fill(l->before, n, SV_SWEEP_NOT_SEEN);
  fill(l->after, n, SV_SWEEP_NOT_SEEN);
  fill(l->plane, n, -2);
  const int x0 = b.x0, x1 = b.x1;
  choose_block_planes(j, &b, i_task / j->bands_of_map);
  for (int p = 0; p < m->n_planes; p++)
    for (b.x0 = x0, b.x1 = x0; next_columns(&b, p, x1);) {
      for (int k = 0; k < m->n_sources; k++) warp(&b, k, &q[k], m->w0 + (float)p * m->dw);
      match(&b, p);
    }
  b.x0 = x0;
  b.x1 = x1;
  write_codes(&b, &j->t->views[m->i_view].image);
}

// --- the other side ------------------------------------------------------------------------------

static inline float inverse_depth(const sv_depth_map *m, uint16_t code) {
  return m->w0 + m->dw * ((float)(code - 1) * (1.0f / 256.0f));
}

// Other maps that have the same surface there, by their codes as measured (`keep` comes later).
static int n_agreeing(const sv_sweep *s, const sv_depth_map *m, const sv_transfer *q, int x, int y, float w) {
  int n = 0;
  for (int k = 0; k < m->n_sources; k++) {
    const sv_depth_map *o = &s->map[m->source[k]];
    float p[3];
    if (!sv_transfer_see(&q[k], (float)x + 0.5f, (float)y + 0.5f, w, p)) continue;
    if (!(p[0] >= 0 && p[0] < (float)o->view.width_px && p[1] >= 0 && p[1] < (float)o->view.height_px))
      continue;
    uint16_t code = o->code[(size_t)(int)p[1] * (size_t)o->view.width_px + (size_t)(int)p[0]];
    n += code && fabsf(inverse_depth(o, code) - w / p[2]) <= AGREE * o->dw;
  }
  return n;
}

// The pictures are done with: what is confirmed takes their place.
static void confirm_task(void *arg, int i_task, int i_thread) {
  job *j = arg;
  sv_depth_map *m = &j->s->map[i_task];
  sv_transfer q[SV_SWEEP_CAP_SOURCES];
  const int n_needed = j->t->cfg.has_lens_views ? sv_mini(MIN_AGREE_LENSES, m->n_sources) : 1;
  (void)i_thread;
  for (int k = 0; k < m->n_sources; k++) q[k] = sv_transfer_make(&j->s->map[m->source[k]].view, &m->view);
  for (int y = 0; y < m->view.height_px; y++)
    for (int x = 0; x < m->view.width_px; x++) {
      size_t at = (size_t)y * (size_t)m->view.width_px + (size_t)x;
      uint16_t c = m->code[at];
      bool is_kept = c && n_agreeing(j->s, m, q, x, y, inverse_depth(m, c)) >= n_needed;
      m->grey[at] = is_kept ? c : 0;
      m->n_measured += is_kept;
    }
}

// --- between -------------------------------------------------------------------------------------

static void fill_task(void *arg, int i_task, int i_thread) {
  (void)i_thread;
  sv_sweep_fill_gaps(&((job *)arg)->s->map[i_task]);
}

float sv_sweep_distance(const sv_depth_map *m, float inverse) {
  return 1.0f / (m->w0 < 0 ? sv_maxf(inverse, m->dw) : inverse);
}

float sv_sweep_depth(const sv_depth_map *m, int x, int y) {
  uint16_t c = m->code[(size_t)y * (size_t)m->view.width_px + (size_t)x];
  return c ? sv_sweep_distance(m, inverse_depth(m, c)) : 0.0f;
}

// --- scenes that do not end ----------------------------------------------------------------------

#define PROBE_STEP 4     // one band of so many is probed
#define OPEN_SHARE 0.25f // of what has structure there, matches on far planes alone

// Whether much of what the views see is farther than the planes of a scene that ends.
static bool is_open(job *j) {
  const sv_trainer *t = j->t;
  const int bands_of_map = j->bands_of_map;
  int n_structured = 0, n_matched = 0;
  for (int i = 0; i < j->s->n; i++) choose_far_planes(&j->s->map[i]);
  j->band_step = PROBE_STEP;
  j->bands_of_map = (bands_of_map + PROBE_STEP - 1) / PROBE_STEP;
  sv_pool_run(t->compute.pool, sweep_task, j, j->s->n * j->bands_of_map);
  j->band_step = 1;
  j->bands_of_map = bands_of_map;
  for (int i = 0; i < t->cfg.n_threads; i++) {
    n_structured += j->lanes[i].n_structured;
    n_matched += j->lanes[i].n_matched;
  }
  return (float)n_matched > OPEN_SHARE * (float)n_structured;
}

// --- all of it -----------------------------------------------------------------------------------

static size_t cap_total_px(const sv_train_cfg *c, int n) {
  size_t each = sv_mini(SV_SWEEP_CAP_PX, total_px(c) / n),
         all = (size_t)c->cap_width_px * (size_t)c->cap_height_px;
  return (size_t)n * (all < each ? all : each);
}

size_t sv_sweep_bytes(const sv_train_cfg *cfg) {
  sv_arena dry = sv_arena_dry();
  int n = n_maps(cfg->cap_views);
  lane l;
  if (n < 2) return 0;
  SV_TAKE(&dry, sv_depth_map, SV_SWEEP_CAP_VIEWS);
  SV_TAKE(&dry, uint16_t, cap_total_px(cfg, n));
  SV_TAKE(&dry, uint16_t, cap_total_px(cfg, n));
  SV_TAKE(&dry, sv_depth_map, SV_SWEEP_CAP_VIEWS);
  SV_TAKE(&dry, uint16_t, cap_total_px(cfg, n) / 4); // at half the size
  SV_TAKE(&dry, uint16_t, cap_total_px(cfg, n) / 4);
  SV_TAKE(&dry, lane, cfg->n_threads);
  for (int i = 0; i < cfg->n_threads; i++) carve_lane(&l, stride_of(cfg->cap_width_px), &dry);
  return dry.used_bytes;
}

// Sweeps all maps at half the size, so that the full ones look at fewer planes.
static sv_status sweep_half(job *j, sv_arena *scratch) {
  sv_sweep half = {.map = SV_TAKE(scratch, sv_depth_map, SV_SWEEP_CAP_VIEWS), .n = j->s->n};
  size_t at = 0, n = 0;
  for (int i = 0; i < half.n; i++) n += sv_sweep_half_px(&j->s->map[i]);
  uint16_t *grey = SV_TAKE(scratch, uint16_t, n), *code = SV_TAKE(scratch, uint16_t, n);
  if (scratch->status < 0) return scratch->status;
  for (int i = 0; i < half.n; i++) {
    half.map[i].grey = grey + at;
    half.map[i].code = code + at;
    at += sv_sweep_half_px(&j->s->map[i]);
    sv_sweep_half(&j->s->map[i], &half.map[i]);
  }
  job of_half = *j;
  of_half.s = &half;
  of_half.bands_of_map = (j->bands_of_map + 1) / 2;
  sv_pool_run(j->t->compute.pool, sweep_task, &of_half, half.n * of_half.bands_of_map);
  j->half = half.map;
  return SV_OK;
}

sv_status sv_sweep_run(sv_sweep *s, const sv_trainer *t, const sv_bounds *bounds, int cap_px,
                       sv_arena *scratch) {
  job j = {.t = t, .s = s};
  *s = (sv_sweep){0};
  if (t->n_views < 2) return SV_AGAIN;
  s->map = SV_TAKE(scratch, sv_depth_map, SV_SWEEP_CAP_VIEWS);
  size_t used = 0, cap = cap_total_px(&t->cfg, n_maps(t->cfg.cap_views));
  uint16_t *grey = SV_TAKE(scratch, uint16_t, cap), *code = SV_TAKE(scratch, uint16_t, cap);
  j.lanes = SV_TAKE(scratch, lane, t->cfg.n_threads);
  if (scratch->status < 0) return scratch->status;
  sv_sweep_choose_views(s, t, bounds);
  choose_sizes(s, t, cap_px);
  for (int i = 0; i < s->n; i++) {
    sv_depth_map *m = &s->map[i];
    const float *x = m->view.r;
    double z = m->view.fisheye ? (double)sv_view_distance(&m->view, bounds->centre)
                               : (double)x[6] * bounds->centre[0] + (double)x[7] * bounds->centre[1] +
                                     (double)x[8] * bounds->centre[2] + m->view.t[2];
    size_t px = (size_t)m->view.width_px * (size_t)m->view.height_px;
    if (px > cap - used || m->view.width_px < 16 || m->view.height_px < 16) return SV_AGAIN;
    m->grey = grey + used;
    m->code = code + used;
    used += px;
    load_grey(t, m);
    sv_sweep_choose_sources(s, i, sv_maxf((float)z, bounds->radius));
    choose_planes(s, i, bounds);
    j.cap_stride = sv_maxi(j.cap_stride, stride_of(m->view.width_px));
    j.bands_of_map = sv_maxi(j.bands_of_map, (m->view.height_px + BAND - 1) / BAND);
  }
  for (int i = 0; i < t->cfg.n_threads; i++) carve_lane(&j.lanes[i], j.cap_stride, scratch);
  if (scratch->status < 0) return scratch->status;
  sv_status st;
  s->is_open = is_open(&j);
  for (int i = 0; i < s->n; i++) {
    choose_planes(s, i, bounds);
    if (s->is_open) choose_all_planes(&s->map[i]);
  }
  if ((st = sweep_half(&j, scratch)) < 0) return st;
  sv_pool_run(t->compute.pool, sweep_task, &j, s->n * j.bands_of_map);
  sv_pool_run(t->compute.pool, confirm_task, &j, s->n);
  sv_pool_run(t->compute.pool, fill_task, &j, s->n);
  int n = 0;
  for (int i = 0; i < s->n; i++) n += s->map[i].n_measured;
  return n > 0 ? SV_OK : SV_AGAIN;
}
