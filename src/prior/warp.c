// SPDX-License-Identifier: Apache-2.0
#include <string.h>

#include "src/base/mathx.h"
#include "src/base/str.h"
#include "src/prior/align.h"
#include "src/prior/methods.h"
#include "src/prior/views.h"
#include "src/splat/constants.h"
#include "src/train/novel.h"
#include "src/train/sweep.h"

#define ROUNDS     10    // of aligning maps to the model, in a run
#define LAST_ROUND 0.85f // progress until which it is done
#define MIN_PIXELS 64    // for a fit of two numbers
// relative step of depth to the next pixel: between two surfaces there is nothing
#define EDGE 0.05f
#define SAME 0.02f // relative: the first of two that fall on a pixel stays

static const char *const names[] = {"none", "fsgs", "sparsegs"};

const char *sv_prior_method_name(sv_prior_method m) { return names[m]; }

int sv_prior_method_by_name(const char *name) {
  for (int i = 0; i < 3; i++)
    if (sv_str_eq(name, names[i])) return i;
  return -1;
}

// --- depth of the source -------------------------------------------------------------------------

typedef struct {
  double a, b; // what the rendering has = a map + b
  bool is_inverse, is_good;
} fit;

static float value_at(const sv_prior_depth *d, int x, int y) {
  return d->map[(size_t)y * (size_t)d->width_px + (size_t)x];
}

// Least squares over the pixels that both know.
static fit align(const sv_prior *prior, const sv_prior_depth *d) {
  const sv_planes *size = &prior->t->render.rgb;
  double n = 0, mm = 0, mr = 0, vm = 0, c = 0;
  fit f = {.a = 1, .is_inverse = d->kind == SV_PRIOR_INVERSE || d->kind == SV_PRIOR_ALIGNED};
  f.is_good = d->kind == SV_PRIOR_METRIC || d->kind == SV_PRIOR_ALIGNED;
  if (f.is_good) return f;
  for (int pass = 0; pass < 2; pass++) {
    for (int y = 0; y < size->height_px; y++)
      for (int x = 0; x < size->width_px; x++) {
        const float e = prior->expected[(size_t)y * (size_t)size->stride + (size_t)x], v = value_at(d, x, y);
        if (!(e > 0.0f) || v < 0.0f) continue;
        const double r = f.is_inverse ? 1.0 / (double)e : (double)e, m = (double)v;
        if (pass == 0) {
          n++;
          mm += m;
          mr += r;
        } else {
          vm += (m - mm) * (m - mm);
          c += (m - mm) * (r - mr);
        }
      }
    if (pass == 0 && n > 0) {
      mm /= n;
      mr /= n;
    }
  }
  if (n < MIN_PIXELS || !(vm > 0) || !(c > 0)) return f;
  f.a = c / vm;
  f.b = mr - f.a * mm;
  f.is_good = true;
  return f;
}

// Depth of the source's pixels in place of the rendering's, 0 where it is not known.
static void bring_to_scale(sv_prior *prior, const sv_prior_depth *d) {
  const sv_planes *size = &prior->t->render.rgb;
  const fit f = align(prior, d);
  for (int y = 0; y < size->height_px && f.is_good; y++)
    for (int x = 0; x < size->width_px; x++) {
      float *e = &prior->expected[(size_t)y * (size_t)size->stride + (size_t)x];
      const float v = value_at(d, x, y);
      const double z = f.a * (double)v + f.b;
      *e = v < 0.0f || !(z > 0) ? 0.0f : (float)(f.is_inverse ? 1 / z : z);
    }
}

// --- splatting -----------------------------------------------------------------------------------

typedef struct {
  const sv_view *from, *to;
  float *z;      // [height][width] of `to`, -1: nothing there
  uint8_t *rgba; // the same
} splat_job;

static void put(const splat_job *j, int x, int y, float z, const uint8_t *rgb) {
  if (x < 0 || y < 0 || x >= j->to->width_px || y >= j->to->height_px) return;
  const size_t at = (size_t)y * (size_t)j->to->width_px + (size_t)x;
  if (j->z[at] > 0.0f && z > j->z[at] * (1.0f - SAME)) return;
  j->z[at] = z;
  memcpy(j->rgba + 4 * at, rgb, 3);
  j->rgba[4 * at + 3] = 255;
}

// One pixel of the source goes to where it falls; in a second round also to the two by two pixels
// around, for what is still empty there or farther away: no holes at small turns.
static void carry(const splat_job *j, int x, int y, float z, const uint8_t *rgb, bool is_around) {
  const sv_view *a = j->from, *b = j->to;
  float ray[3], c[3], w[3], p[3], uv[2], depth;
  if (!sv_view_ray(a, (float)x + 0.5f, (float)y + 0.5f, ray)) return;
  for (int k = 0; k < 3; k++) c[k] = ray[k] * z - a->t[k];
  for (int k = 0; k < 3; k++) w[k] = a->r[k] * c[0] + a->r[3 + k] * c[1] + a->r[6 + k] * c[2];
  for (int k = 0; k < 3; k++)
    p[k] = b->r[3 * k] * w[0] + b->r[3 * k + 1] * w[1] + b->r[3 * k + 2] * w[2] + b->t[k];
  if (!sv_view_project(b, p, uv, &depth) || !(depth > 0.1f * z)) return;
  const float u = uv[0] - 0.5f, v = uv[1] - 0.5f;
  if (!(u > -2.0f && v > -2.0f && u < (float)b->width_px + 1.0f && v < (float)b->height_px + 1.0f)) return;
  if (!is_around) {
    put(j, (int)floorf(u + 0.5f), (int)floorf(v + 0.5f), depth, rgb);
    return;
  }
  const int iu = (int)floorf(u), iv = (int)floorf(v);
  for (int k = 0; k < 4; k++) put(j, iu + (k & 1), iv + (k >> 1), depth, rgb);
}

static bool is_edge(const float *e, long step) {
  return fabsf(e[step] - e[0]) > EDGE * e[0] || fabsf(e[-step] - e[0]) > EDGE * e[0];
}

static void splat_all(const sv_prior *prior, const splat_job *j, const sv_image_u8 *im, bool is_around) {
  const long stride = prior->t->render.rgb.stride;
  for (int y = 1; y < im->height_px - 1; y++)
    for (int x = 1; x < im->width_px - 1; x++) {
      const float *e = prior->expected + (long)y * stride + x;
      const uint8_t *px = im->px + (size_t)y * (size_t)im->stride_bytes + (size_t)(x * im->n_channels);
      if (!(e[0] > 0.0f) || is_edge(e, 1) || is_edge(e, stride)) continue;
      if ((im->n_channels == 4 && px[3] < 128) || !sv_image_counts(im, 1, x, y)) continue;
      carry(j, x, y, e[0], px, is_around);
    }
}

static float ramp(const sv_prior_cfg *c, float progress) {
  return sv_clampf((progress - c->warp_from) / c->warp_ramp, 0.0f, 1.0f);
}

sv_status sv_prior_warp(sv_prior *prior, float progress) {
  const int i = (int)sv_rng_below(&prior->rng, (uint32_t)prior->t->n_views);
  const sv_train_view *from = &prior->t->views[i];
  const sv_view to = sv_train_turned_view(prior->t, &from->view, prior->t->cfg.novel_rad, &prior->rng);
  const size_t n = (size_t)to.width_px * (size_t)to.height_px;
  const float up = ramp(&prior->cfg, progress);
  const splat_job j = {.from = &from->view, .to = &to, .z = prior->g_expected, .rgba = prior->warped};
  const sv_image_u8 out = {prior->warped, to.width_px, to.height_px, 4, 4 * to.width_px};
  int id;
  const sv_prior_depth *d = sv_prior_depth_of(prior, i, &from->view);
  // a model learns nothing from its own depth
  if (!d && !(prior->cfg.warp_colour > 0.0f)) return SV_OK;
  sv_status s = sv_prior_render(prior, &from->view, progress);
  if (s < 0) return s;
  if (d) bring_to_scale(prior, d);
  for (size_t k = 0; k < n; k++) j.z[k] = -1.0f;
  memset(prior->warped, 0, 4 * n);
  for (int k = 0; k < 2; k++) splat_all(prior, &j, &from->image, k == 1);
  s = sv_prior_submit_view(prior, &to, &out, up * prior->cfg.warp_colour, 2.0f, &id);
  if (s >= 0 && prior->cfg.warp_depth > 0.0f)
    s = sv_prior_submit_depth(
        prior, id,
        &(sv_prior_map){j.z, to.width_px, to.height_px, SV_PRIOR_RELATIVE, up * prior->cfg.warp_depth});
  prior->n_warped++;
  return s;
}

// --- depth maps of the views themselves ----------------------------------------------------------

sv_status sv_prior_measure(sv_prior *prior, const sv_bounds *bounds, sv_arena *scratch, int *n_maps) {
  sv_sweep sweep;
  const size_t mark = sv_arena_mark(scratch);
  sv_status s = sv_sweep_run(&sweep, prior->t, bounds, SV_SWEEP_CAP_PX, scratch);
  *n_maps = 0;
  for (int i = 0; s == SV_OK && i < sweep.n; i++) {
    const sv_depth_map *m = &sweep.map[i];
    const sv_view *v = &prior->t->views[m->i_view].view;
    float *map = prior->g_expected;
    if (m->n_measured < MIN_PIXELS) continue;
    for (int y = 0; y < v->height_px; y++)
      for (int x = 0; x < v->width_px; x++) {
        const float z = x / m->k < m->view.width_px && y / m->k < m->view.height_px
                            ? sv_sweep_depth(m, x / m->k, y / m->k)
                            : 0.0f;
        map[(size_t)y * (size_t)v->width_px + (size_t)x] = z > 0.0f ? z : -1.0f;
      }
    sv_prior_depth *given = sv_prior_find_depth(prior, m->i_view, v);
    *n_maps += 1;
    if (given) (void)sv_prior_align_to_depth(prior, given, map);
  }
  sv_arena_reset(scratch, mark);
  return s == SV_AGAIN ? SV_OK : s;
}

// --- when ----------------------------------------------------------------------------------------

// Without a second opinion about depth, what looks like a floater may be a surface.
static bool has_maps(const sv_prior *prior) {
  for (int i = 0; i < prior->cfg.cap_depths; i++)
    if (prior->depths[i].id >= 0 && prior->depths[i].id < prior->t->n_views) return true;
  return false;
}

sv_status sv_prior_update(sv_prior *prior, float progress) {
  const float before = prior->updated_until;
  const sv_prior_cfg *c = &prior->cfg;
  const uint32_t every = (uint32_t)sv_maxi(prior->t->cfg.relocate_every, 1);
  uint32_t n_pruned;
  int n_solved;
  sv_status s = SV_OK;
  prior->updated_until = progress;
  if ((int)(before * ROUNDS) < (int)(progress * ROUNDS) && progress < LAST_ROUND)
    s = sv_prior_realign(prior, progress, &n_solved);
  if (s < 0) return s;
  if (!c->method || prior->t->n_views < 1) return SV_OK;
  for (int i = 0; i < 2 && s >= 0 && has_maps(prior); i++)
    if (before < c->prune_at[i] && progress >= c->prune_at[i]) s = sv_prior_prune(prior, &n_pruned);
  if (!prior->is_covered && progress >= c->unpool_from &&
      progress < sv_minf(c->unpool_until, prior->t->cfg.relocate_until) && prior->t->step % every == 0)
    (void)sv_prior_unpool(prior); // before relocation takes the dead Gaussians
  const bool is_warped = c->warp_every > 0 && progress > c->warp_from && progress <= c->warp_until;
  if (s >= 0 && is_warped && prior->t->step % (uint32_t)c->warp_every == 0)
    s = sv_prior_warp(prior, progress);
  return s;
}
