// SPDX-License-Identifier: Apache-2.0
#include "src/train/stereo.h"

#include <math.h>

#include "src/base/mathx.h"

#define MIN_SHARE 16 // of the Gaussians: fewer points leave most of the scene empty
// neither covers what is behind a wrong depth nor is faded before it is tried
#define OPACITY 0.3f
// with half of the neighbours' distance, surfaces have holes (docs/notes/quality.md)
#define SCALE 0.8f

// Mean colour of the pixels that a map's pixel was reduced from; false where they are transparent
// or masked.
static bool colour(const sv_image_u8 *im, int k, int x, int y, float rgb[3]) {
  uint32_t sum[4] = {0};
  if (!sv_image_counts(im, k, x, y)) return false;
  for (int j = 0; j < k * k; j++) {
    const uint8_t *p = im->px + (size_t)(y * k + j / k) * (size_t)im->stride_bytes +
                       (size_t)((x * k + j % k) * im->n_channels);
    for (int c = 0; c < im->n_channels; c++) sum[c] += p[c];
  }
  for (int c = 0; c < 3; c++) rgb[c] = (float)sum[im->n_channels < 3 ? 0 : c] / (255.0f * (float)(k * k));
  return im->n_channels < 4 || sum[3] >= 128u * (uint32_t)(k * k);
}

static bool back_project(const sv_view *v, float x, float y, float z, float out[3]) {
  float ray[3], c[3];
  if (!sv_view_ray(v, x, y, ray)) return false;
  for (int i = 0; i < 3; i++) c[i] = ray[i] * z - v->t[i];
  for (int i = 0; i < 3; i++) out[i] = v->r[i] * c[0] + v->r[3 + i] * c[1] + v->r[6 + i] * c[2];
  return true;
}

bool sv_stereo_point(const sv_trainer *t, const sv_depth_map *m, int x, int y, sv_point *out, float *z) {
  *z = sv_sweep_depth(m, x, y);
  if (!(*z > 0) || !colour(&t->views[m->i_view].image, m->k, x, y, out->rgb)) return false;
  return back_project(&m->view, (float)x + 0.5f, (float)y + 0.5f, *z, out->mean);
}

#define SHELL_KEY 17 // of the hash

// Where the scene does not end and nothing was measured, it may be anywhere behind: shells by
// inverse distance.
static bool shell_point(const sv_trainer *t, const sv_depth_map *m, int x, int y, sv_point *out) {
  const uint32_t u = sv_hash3((uint32_t)(y * m->view.width_px + x), (uint32_t)m->i_view, SHELL_KEY) >> 8;
  const float w = m->w_reach * ((float)u + 1.0f) * 0x1p-24f;
  if (!colour(&t->views[m->i_view].image, m->k, x, y, out->rgb)) return false;
  return back_project(&m->view, (float)x + 0.5f, (float)y + 0.5f, sv_sweep_distance(m, w), out->mean);
}

typedef struct { // takes n of n_all, evenly over their order
  int64_t n_all, i_all;
  sv_point *point;
  float *const *depth; // of the cloud
  int n, n_out;
  bool is_open; // the scene does not end
} sampler;

#define DEPTH_TOLERANCE 0.1f // of another model's depth

static bool is_believed(float depth, float z) {
  return depth > 0 && fabsf(z - depth) <= DEPTH_TOLERANCE * depth;
}

// Of the middle of a map's pixel in the view's full size.
static size_t full_index(const sv_trainer *t, const sv_depth_map *m, int x, int y) {
  const int k = m->k, half = k / 2;
  return (size_t)(y * k + half) * (size_t)t->views[m->i_view].view.width_px + (size_t)(x * k + half);
}

static bool is_next_taken(sampler *s) {
  int64_t i = s->i_all++;
  return s->n_all <= s->n || (i + 1) * s->n / s->n_all > i * s->n / s->n_all;
}

// All pixels of a map with a depth: counted when there is no room, else into it.
static void sample(const sv_trainer *t, const sv_depth_map *m, sampler *s) {
  const float *depth = s->depth ? s->depth[m->i_view] : NULL;
  for (int y = 0; y < m->view.height_px; y++)
    for (int x = 0; x < m->view.width_px; x++) {
      sv_point here;
      float z;
      const bool is_measured = sv_stereo_point(t, m, x, y, &here, &z);
      if (!is_measured && !(s->is_open && !(z > 0) && shell_point(t, m, x, y, &here))) continue;
      if (is_measured && depth && !is_believed(depth[full_index(t, m, x, y)], z)) continue;
      if (!s->point) {
        s->n_all++;
        continue;
      }
      if (is_next_taken(s)) s->point[s->n_out++] = here;
    }
}

sv_status sv_stereo_points(const sv_trainer *t, const sv_bounds *bounds, sv_arena *scratch,
                           sv_stereo_cloud *out) {
  sv_sweep sweep;
  size_t mark = sv_arena_mark(scratch);
  sv_status s = sv_sweep_run(&sweep, t, bounds, SV_SWEEP_CAP_PX, scratch);
  sampler all = {.n = out->cap, .depth = out->depth, .is_open = sweep.is_open};
  for (int i = 0; s == SV_OK && i < sweep.n; i++) sample(t, &sweep.map[i], &all);
  if (s == SV_OK && all.n_all * MIN_SHARE < out->cap) s = SV_AGAIN;
  all.point = out->point;
  for (int i = 0; s == SV_OK && i < sweep.n; i++) sample(t, &sweep.map[i], &all);
  out->n = all.n_out;
  out->n_maps = sweep.n;
  sv_arena_reset(scratch, mark);
  return s;
}

sv_init_cfg sv_stereo_init(const sv_bounds *b, uint64_t seed) {
  return (sv_init_cfg){.kind = SV_INIT_POINTS,
                       .centre = {b->centre[0], b->centre[1], b->centre[2]},
                       .radius = b->radius,
                       .opacity = OPACITY,
                       .scale_factor = SCALE,
                       .seed = seed};
}
