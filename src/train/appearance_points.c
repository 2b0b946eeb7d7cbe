// SPDX-License-Identifier: Apache-2.0
#include "src/train/appearance_points.h"

#include "src/base/mathx.h"
#include "src/train/step.h"

#define DARK        16 // of 255; below, noise and black level count more than gains
#define BRIGHT      245
#define HALF_PX     1.0f  // half the side of the smallest square that is averaged
#define MAX_HALF_PX 16.0f // and of the largest
#define MIN_ALPHA   0.5f  // of a pixel that shows a surface
#define PLACE_ALPHA 0.9f  // and of one whose depth is taken
#define ENOUGH      256   // shared points, or that part of all:
#define ENOUGH_PART 8

// Of the depth: a point that near to what a view shows is what it shows. Depth maps of two views
// may be that uncertain; then more is allowed.
static const float depth_shares[] = {0.03f, 0.1f, 0.3f};

#define N_SHARES ((int)(sizeof depth_shares / sizeof *depth_shares))

size_t sv_appearance_points_bytes(const sv_train_cfg *c) {
  const size_t points = SV_APPEARANCE_CAP_POINTS,
               views = (size_t)sv_mini(c->cap_views, SV_APPEARANCE_CAP_VIEWS);
  return points * (views * sizeof(sv_appearance_seen) + 4 * sizeof(float)) + 4 * SV_ARENA_ALIGN;
}

static double linear_of(double v) { return v <= 0.04045 ? v / 12.92 : sv_pow((v + 0.055) / 1.055, 2.4); }

// Share of pixel i that lies within half a side of x.
static float inside(float x, float half, int i) {
  return sv_maxf(0, sv_minf(x + half, (float)i + 1) - sv_maxf(x - half, (float)i));
}

static bool is_usable(const sv_image_u8 *im, const uint8_t *px, int x, int y) {
  if ((im->n_channels == 4 && px[3] < 255) || !sv_image_counts(im, 1, x, y)) return false;
  for (int k = 0; k < 3; k++)
    if (px[k] < DARK || px[k] > BRIGHT) return false;
  return true;
}

static bool is_inside(const sv_view *v, const float uv[2], float half) {
  return uv[0] >= half && uv[1] >= half && (int)(uv[0] + half) < v->width_px &&
         (int)(uv[1] + half) < v->height_px;
}

// Logarithm of the light, mean over a square inside the picture about a place; false where one
// pixel is too dark or saturated.
static bool value_at(const sv_appearance_points *p, const sv_image_u8 *im, const float uv[2], float half,
                     float out[3]) {
  const int x0 = (int)(uv[0] - half), x1 = (int)(uv[0] + half), y0 = (int)(uv[1] - half),
            y1 = (int)(uv[1] + half);
  double sum[3] = {0};
  if (im->n_channels < 3) return false;
  for (int y = y0; y <= y1; y++)
    for (int x = x0; x <= x1; x++) {
      const uint8_t *px = im->px + (size_t)y * (size_t)im->stride_bytes + (size_t)(x * im->n_channels);
      const double w = (double)(inside(uv[0], half, x) * inside(uv[1], half, y));
      if (!is_usable(im, px, x, y)) return false;
      for (int k = 0; k < 3; k++) sum[k] += w * (double)p->light[px[k]];
    }
  for (int k = 0; k < 3; k++) out[k] = (float)sv_log(sum[k] / (double)(4 * half * half));
  return true;
}

static bool project(const sv_view *v, const float x_world[3], float uv[2], float *z) {
  float x[3];
  for (int i = 0; i < 3; i++)
    x[i] = v->r[3 * i] * x_world[0] + v->r[3 * i + 1] * x_world[1] + v->r[3 * i + 2] * x_world[2] + v->t[i];
  return sv_view_project(v, x, uv, z) && uv[0] >= 1 && uv[1] >= 1 && uv[0] < (float)v->width_px - 1 &&
         uv[1] < (float)v->height_px - 1;
}

// All views average over the same part of the surface, a pixel or two of the view that shows it
// smallest: a sharper view of a texture would else have a mean of another logarithm.
static float reach_of(const sv_appearance_points *p, const sv_trainer *t, const float x_world[3]) {
  float reach = 0, uv[2], z;
  for (int k = 0; k < p->n_views; k++) {
    const sv_view *v = &t->views[p->view[k]].view;
    if (project(v, x_world, uv, &z)) reach = sv_maxf(reach, HALF_PX * z / v->fx);
  }
  return reach;
}

// Whether the view that was rendered last shows one surface all over the square about a place.
// Pixels at a silhouette show some of what lies behind it, and silhouettes are not everywhere
// alike: about a thing in the middle of the picture they would look like a falloff.
static bool is_whole(const sv_renderer *r, const float uv[2], float half, float z, float share) {
  for (int y = (int)(uv[1] - half); y <= (int)(uv[1] + half); y++)
    for (int x = (int)(uv[0] - half); x <= (int)(uv[0] + half); x++) {
      const size_t at = (size_t)y * (size_t)r->rgb.stride + (size_t)x;
      const float alpha = 1 - r->trans[at];
      if (!(alpha > MIN_ALPHA && fabsf(r->depth[at] / alpha - z) < share * z)) return false;
    }
  return true;
}

// What the view that was rendered last shows of a point.
static sv_appearance_seen observe(const sv_appearance_points *p, const sv_trainer *t, int k, int i,
                                  float share) {
  const sv_train_view *tv = &t->views[p->view[k]];
  const sv_view *v = &tv->view;
  const sv_renderer *r = &t->render;
  sv_appearance_seen o = {.r2 = -1};
  float uv[2], z;
  if (!project(v, p->point[i], uv, &z)) return o;
  const float half = p->reach[i] * v->fx / z;
  if (half > MAX_HALF_PX || !is_inside(v, uv, half) || !is_whole(r, uv, half, z, share)) return o;
  if (!value_at(p, &tv->image, uv, half, o.log_value)) return o;
  const float far_x = sv_maxf(v->cx, (float)v->width_px - v->cx),
              far_y = sv_maxf(v->cy, (float)v->height_px - v->cy), dx = uv[0] - v->cx, dy = uv[1] - v->cy;
  o.r2 = (dx * dx + dy * dy) / (far_x * far_x + far_y * far_y);
  return o;
}

static void count_shared(sv_appearance_points *p) {
  p->n_shared = 0;
  for (int i = 0; i < p->n_points; i++) {
    int n_seen = 0;
    for (int k = 0; k < p->n_views; k++) n_seen += p->seen[i * p->n_views + k].r2 >= 0;
    p->n_shared += n_seen > 1;
  }
}

static sv_status look(sv_appearance_points *p, sv_trainer *t, float share) {
  const sv_render_options o = sv_train_render_options(t, 1.0f, true);
  for (int k = 0; k < p->n_views; k++) {
    const sv_train_view *tv = &t->views[p->view[k]];
    sv_train_set_time(t, tv->view.time);
    sv_status s = sv_render(&t->render, &t->g, &tv->view, &o);
    if (s < 0) return s;
    for (int i = 0; i < p->n_points; i++) p->seen[i * p->n_views + k] = observe(p, t, k, i, share);
  }
  count_shared(p);
  return SV_OK;
}

// Gaussians' means, which are on the surface at the start: all, or one of so many.
static void take_means(sv_appearance_points *p, const sv_trainer *t) {
  const int stride = (t->g.n + SV_APPEARANCE_CAP_POINTS - 1) / SV_APPEARANCE_CAP_POINTS;
  p->n_points = stride > 0 ? t->g.n / stride : 0;
  for (int i = 0; i < p->n_points; i++) {
    const float *mean = sv_gaussians_at(&t->g, i * stride, SV_ROW_MEAN);
    for (int k = 0; k < 3; k++) p->point[i][k] = mean[16 * k];
  }
}

static bool is_opaque(const sv_renderer *r, size_t at) { return r->trans[at] < 1 - PLACE_ALPHA; }

static void add_place(sv_appearance_points *p, const sv_renderer *r, const sv_view *v, int x, int y) {
  const size_t at = (size_t)y * (size_t)r->rgb.stride + (size_t)x;
  float ray[3], *out = p->point[p->n_points];
  if (!sv_view_ray(v, (float)x + 0.5f, (float)y + 0.5f, ray)) return;
  const float length = v->fisheye ? sqrtf(ray[0] * ray[0] + ray[1] * ray[1] + ray[2] * ray[2]) : ray[2],
              scale = r->depth[at] / ((1 - r->trans[at]) * length);
  for (int k = 0; k < 3; k++) ray[k] = ray[k] * scale - v->t[k];
  for (int k = 0; k < 3; k++) out[k] = v->r[k] * ray[0] + v->r[3 + k] * ray[1] + v->r[6 + k] * ray[2];
  p->n_points++;
}

// Adds up to n points that the view that was rendered last shows, evenly spread. (Gaussians' means
// would be no fair sample: they come to lie in the middle of bright and dark spots, of which views
// that see them a little beside their place then show less.)
static void add_places(sv_appearance_points *p, const sv_renderer *r, const sv_view *v, int n) {
  int n_opaque = 0, i = 0;
  for (int y = 0; y < v->height_px; y++)
    for (int x = 0; x < v->width_px; x++)
      n_opaque += is_opaque(r, (size_t)y * (size_t)r->rgb.stride + (size_t)x);
  const int every = n_opaque / n + 1;
  for (int y = 0; y < v->height_px; y++)
    for (int x = 0; x < v->width_px; x++)
      if (is_opaque(r, (size_t)y * (size_t)r->rgb.stride + (size_t)x) && i++ % every == 0)
        add_place(p, r, v, x, y);
}

static sv_status take_places(sv_appearance_points *p, sv_trainer *t, int cap) {
  const sv_render_options o = sv_train_render_options(t, 1.0f, true);
  p->n_points = 0;
  for (int k = 0; k < p->n_views; k++) {
    const sv_train_view *tv = &t->views[p->view[k]];
    sv_status s = sv_render(&t->render, &t->g, &tv->view, &o);
    if (s < 0) return s;
    add_places(p, &t->render, &tv->view, cap / p->n_views);
  }
  return SV_OK;
}

sv_status sv_appearance_points_find(sv_appearance_points *p, sv_trainer *t, sv_arena *scratch) {
  const int n = t->n_views, cap = SV_APPEARANCE_CAP_POINTS;
  *p = (sv_appearance_points){.n_views = sv_mini(n, SV_APPEARANCE_CAP_VIEWS)};
  p->point = (float(*)[3])(void *)SV_TAKE(scratch, float, (size_t)cap * 3);
  p->reach = SV_TAKE(scratch, float, cap);
  p->seen = SV_TAKE(scratch, sv_appearance_seen, (size_t)cap * (size_t)p->n_views);
  if (scratch->status < 0) return scratch->status;
  for (int i = 0; i < p->n_views; i++) p->view[i] = (int)((long)i * n / p->n_views);
  for (int i = 0; i < 256; i++) p->light[i] = (float)linear_of(i / 255.0);
  sv_status s = SV_OK;
  if (t->step > 0) s = take_places(p, t, cap);
  else take_means(p, t);
  if (s < 0) return s;
  for (int i = 0; i < p->n_points; i++) p->reach[i] = reach_of(p, t, p->point[i]);
  const int enough = sv_mini(ENOUGH, p->n_points / ENOUGH_PART);
  for (int i = 0; i < N_SHARES && s >= 0; i++) {
    s = look(p, t, depth_shares[i]);
    if (p->n_shared >= enough) break;
  }
  return s;
}
