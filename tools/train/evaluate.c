// SPDX-License-Identifier: Apache-2.0
#include "tools/train/evaluate.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "src/metric/metric.h"
#include "tools/train/align_view.h"
#include "tools/train/masks.h"
#include "tools/train/support_mask.h"
#include "tools/metric/lpips.h"

#define OPAQUE    250   // of 255: alpha of a pixel whose depth is compared
#define DEPTH_MIN 0.01f // scene units
#define ALPHA_MIN 1e-4f // rendered

sv_status lab_viewer_start(lab_viewer *v, const lab_session *s, sv_renderer_cfg c, sv_err *err) {
  const int w = c.cap_width_px, h = c.cap_height_px;
  c.n_threads = s->n_threads;
  size_t bytes = sv_renderer_bytes(&c) + SV_ARENA_ALIGN;
  memset(v, 0, sizeof *v);
  v->block = malloc(bytes);
  if (!v->block) return sv_fail(err, SV_E_NOMEM, "no memory: rendering %dx%d takes %zu bytes", w, h, bytes);
  sv_arena a = sv_arena_make(v->block, bytes);
  sv_status st = sv_renderer_init(&v->r, &c, (sv_compute){&s->k, &s->pool}, &a);
  if (st == SV_OK) return SV_OK;
  lab_viewer_stop(v);
  return sv_fail(err, st, "an image of %dx%d cannot be rendered", w, h);
}

void lab_viewer_stop(lab_viewer *v) {
  free(v->block);
  memset(v, 0, sizeof *v);
}

uint8_t lab_to_byte(float x) { return (uint8_t)(x <= 0 ? 0 : x >= 1 ? 255 : x * 255.0f + 0.5f); }

void lab_to_bytes(const sv_planes *p, uint8_t *rgb) {
  for (int y = 0; y < p->height_px; y++)
    for (int x = 0; x < p->width_px; x++)
      for (int c = 0; c < 3; c++) *rgb++ = lab_to_byte(p->c[c][(size_t)y * (size_t)p->stride + (size_t)x]);
}

// What one view needs; there are as many as threads, reused.
typedef struct {
  uint8_t *truth_u8;                 // as loaded
  float *truth, *image;              // [3][h][w]
  float *depth, *depth_true, *plane; // [h][w]; plane: padded, of the renderer
  uint8_t *mask;                     // [h][w] of depth
  uint8_t *seen[LAB_N_MASKS];        // [h][w] the co-visible pixels
  uint8_t *counted;                  // [h][w] of the view's mask, NULL: no view has one
  bool is_masked;                    // this view has one
  sv_view view;                      // as it is rendered
  double *ssim_scratch;
  sv_err err;
  double psnr, ssim, lpips;
  lab_masked_scores masked[LAB_N_MASKS];
  size_t n_seen[LAB_N_MASKS], n_counted; // pixels
  sv_depth_error depth_error;
} slot;

typedef struct {
  const lab_views *v;
  const lab_eval_job *job;
  lab_viewer viewer;
  lab_loader *loaders;
  sv_lpips *lpips; // NULL: not wanted
  // [0]: of the training views, then of other devices'; NULL: not wanted
  lab_masks *masks[1 + LAB_CAP_SHARED];
  lab_support_mask *support; // NULL: not wanted
  int n_masks;               // forms of scores over masks
  uint8_t *one_other;        // [h][w] the mask of one other device
  slot *slots;
  int n_slots, i0; // slots hold the views by_lens[i0] and on
} run;

static const lab_frame *frame_of(const run *r, int i_slot) {
  return &r->v->frames[r->v->by_lens[r->i0 + i_slot]];
}

static void slot_free(slot *s) {
  free(s->truth_u8);
  free(s->truth);
  free(s->image);
  free(s->depth);
  free(s->depth_true);
  free(s->plane);
  free(s->mask);
  for (int k = 0; k < LAB_N_MASKS; k++) free(s->seen[k]);
  free(s->counted);
  free(s->ssim_scratch);
}

static size_t most_pixels(const lab_views *v) {
  size_t n = 0;
  for (int i = 0; i < v->n; i++) {
    size_t k = (size_t)v->frames[i].view.width_px * (size_t)v->frames[i].view.height_px;
    if (k > n) n = k;
  }
  return n;
}

static bool slot_alloc(slot *s, const lab_views *v, bool has_depth, int n_masks) {
  const size_t n = most_pixels(v);
  s->truth_u8 = malloc(4 * n);
  s->truth = malloc(3 * n * sizeof(float));
  s->image = malloc(3 * n * sizeof(float));
  s->ssim_scratch = malloc(sv_ssim_scratch_doubles(v->cap_width_px) * sizeof(double));
  s->counted = v->n_masked ? malloc(n) : NULL;
  bool is_good = s->truth_u8 && s->truth && s->image && s->ssim_scratch && (s->counted || !v->n_masked);
  for (int k = 0; k < n_masks; k++) is_good &= (s->seen[k] = malloc(n)) != NULL;
  if (!has_depth) return is_good;
  s->depth = malloc(n * sizeof(float));
  s->depth_true = malloc(n * sizeof(float));
  s->plane = malloc(v->cap_floats * sizeof(float));
  s->mask = malloc(n);
  return is_good && s->depth && s->depth_true && s->plane && s->mask;
}

// Straight alpha over the background, exactly as training does it.
static void blend_over(const uint8_t *u8, int n_channels, size_t n, const float bg[3], float *out) {
  for (size_t i = 0; i < n; i++, u8 += n_channels)
    for (int c = 0; c < 3; c++) {
      float v = (float)u8[c] * (1.0f / 255.0f), a = n_channels == 4 ? (float)u8[3] * (1.0f / 255.0f) : 1.0f;
      out[(size_t)c * n + i] = v * a + (1.0f - a) * bg[c];
    }
}

// The view's mask, which lets at least one pixel count.
static sv_status load_mask(const run *r, slot *s, const lab_frame *f, lab_loader *l) {
  const size_t n = (size_t)f->view.width_px * (size_t)f->view.height_px;
  s->is_masked = f->is_masked;
  s->n_counted = n;
  if (!s->is_masked) return SV_OK;
  sv_status st = lab_mask_load(l, f, r->v->scale, s->counted, &s->err);
  s->n_counted = 0;
  for (size_t i = 0; st == SV_OK && i < n; i++) s->n_counted += s->counted[i];
  return st != SV_OK || s->n_counted
             ? st
             : sv_fail(&s->err, SV_E_RANGE, "%s: the mask leaves no pixel of the view to score",
                       *f->mask_path ? f->mask_path : f->path);
}

static void load_task(void *arg, int i_task, int i_thread) {
  run *r = arg;
  slot *s = &r->slots[i_task];
  const lab_frame *f = frame_of(r, i_task);
  lab_loader *l = &r->loaders[i_thread];
  s->err.status = lab_picture_load(l, f, r->v->scale, s->truth_u8, &s->err);
  if (s->err.status == SV_OK) s->err.status = load_mask(r, s, f, l);
  if (s->err.status == SV_OK && r->job->render.has_depth)
    s->err.status = lab_depth_load(l, f, r->v->scale, s->depth_true, &s->err);
  if (s->err.status == SV_OK)
    blend_over(s->truth_u8, f->n_channels, (size_t)f->view.width_px * (size_t)f->view.height_px,
               r->job->render.bg, s->truth);
}

static sv_status render_slot(run *r, slot *s, const lab_frame *f, sv_err *err) {
  const sv_planes *p = &r->viewer.r.rgb;
  const lab_align_job align = {&r->viewer, r->job->g, r->job->render, s->truth,
                               s->is_masked ? s->counted : NULL};
  sv_status st = lab_motion_at(&r->job->motion, r->job->session, r->job->g, f->view.time, err);
  s->view = f->view;
  if (st >= 0 && r->job->is_aligned) st = lab_align_view(&s->view, &align, err);
  if (st < 0) return st;
  st = sv_render(&r->viewer.r, r->job->g, &s->view, &r->job->render);
  if (st < 0) return sv_fail(err, st, "%s: the view cannot be rendered", f->path);
  size_t w = (size_t)f->view.width_px, h = (size_t)f->view.height_px;
  for (size_t c = 0; c < 3; c++)
    for (size_t y = 0; y < h; y++)
      for (size_t x = 0; x < w; x++) {
        float v = p->c[c][y * (size_t)p->stride + x];
        s->image[(c * h + y) * w + x] = v < 0 ? 0 : v > 1 ? 1 : v;
      }
  if (!r->job->render.has_depth) return SV_OK;
  sv_render_expected_depth(&r->viewer.r, ALPHA_MIN, s->plane);
  for (size_t y = 0; y < h; y++)
    memcpy(s->depth + y * w, s->plane + y * (size_t)p->stride, w * sizeof(float));
  return SV_OK;
}

static bool is_opaque(const uint8_t *u8, int n_channels, int w, int x, int y) {
  return n_channels != 4 || u8[((size_t)y * (size_t)w + (size_t)x) * 4 + 3] >= OPAQUE;
}

// The border counts as empty, as in an erosion that pads with zeros, where there is alpha at all.
static void depth_mask(const slot *s, const lab_frame *f) {
  int w = f->view.width_px, h = f->view.height_px;
  for (int y = 0; y < h; y++)
    for (int x = 0; x < w; x++) {
      const size_t at = (size_t)y * (size_t)w + (size_t)x;
      bool is_in = s->depth_true[at] > DEPTH_MIN && (!s->is_masked || s->counted[at]);
      for (int dy = -1; dy <= 1 && is_in; dy++)
        for (int dx = -1; dx <= 1 && is_in; dx++) {
          bool is_inside = x + dx >= 0 && x + dx < w && y + dy >= 0 && y + dy < h;
          is_in = is_inside ? is_opaque(s->truth_u8, f->n_channels, w, x + dx, y + dy) : f->n_channels != 4;
        }
      s->mask[at] = is_in;
    }
}

static void compare_task(void *arg, int i_task, int i_thread) {
  run *r = arg;
  slot *s = &r->slots[i_task];
  const lab_frame *f = frame_of(r, i_task);
  int w = f->view.width_px, h = f->view.height_px;
  sv_image_pair pair = {.a = s->image, .b = s->truth, .width = w, .height = h, .n_channels = 3};
  (void)i_thread;
  s->psnr = s->is_masked ? sv_psnr_masked(&pair, s->counted) : sv_psnr(&pair);
  s->err.status = s->is_masked ? sv_ssim_counted(&pair, s->counted, s->ssim_scratch, &s->ssim)
                               : sv_ssim(&pair, SV_SSIM_SAME, s->ssim_scratch, &s->ssim);
  for (int k = 0; k < r->n_masks && s->err.status == SV_OK; k++) {
    s->masked[k].psnr = sv_psnr_masked(&pair, s->seen[k]);
    s->err.status = sv_ssim_masked(&pair, s->seen[k], s->ssim_scratch, &s->masked[k].ssim);
  }
  if (s->err.status < 0)
    sv_fail(&s->err, s->err.status, "%s: SSIM cannot be computed (%dx%d)", f->path, w, h);
  if (!r->job->render.has_depth) return;
  depth_mask(s, f);
  s->depth_error = sv_depth_compare(s->depth, s->depth_true, s->mask, (size_t)w * (size_t)h);
}

// What uses all threads for one view: the mask, LPIPS.
static sv_status mask_slot(run *r, slot *s, const lab_frame *f, sv_err *err) {
  size_t n = (size_t)f->view.width_px * (size_t)f->view.height_px;
  lab_masked_view view = {
      .frame = f, .picture = s->truth_u8, .depth = r->job->render.has_depth ? s->depth_true : NULL};
  sv_status st = r->support ? lab_support_mask_make(r->support, &f->view, s->seen[LAB_MASK_OWN], err)
                            : lab_masks_make(r->masks[0], &view, s->seen[LAB_MASK_OWN], err);
  if (r->n_masks > 1) memcpy(s->seen[LAB_MASK_SHARED], s->seen[LAB_MASK_OWN], n);
  for (int k = 1; st == SV_OK && k <= r->job->n_shared; k++) {
    st = lab_masks_make(r->masks[k], &view, r->one_other, err);
    for (size_t i = 0; i < n; i++) s->seen[LAB_MASK_SHARED][i] &= r->one_other[i];
  }
  for (int k = 0; st == SV_OK && k < r->n_masks; k++) {
    s->n_seen[k] = 0;
    for (size_t i = 0; i < n; i++) {
      if (s->is_masked) s->seen[k][i] &= s->counted[i];
      s->n_seen[k] += s->seen[k][i];
    }
  }
  return st;
}

static sv_status lpips_slot(run *r, slot *s, const lab_frame *f, sv_err *err) {
  const sv_pool *pool = &r->job->session->pool;
  sv_image_pair pair = {s->image, s->truth, f->view.width_px, f->view.height_px, 3};
  sv_status st = s->is_masked ? sv_lpips_masked(r->lpips, &pair, s->counted, pool, &s->lpips, err)
                              : sv_lpips_compare(r->lpips, &pair, pool, &s->lpips, err);
  for (int k = 0; k < r->n_masks && st == SV_OK; k++)
    st = sv_lpips_masked(r->lpips, &pair, s->seen[k], pool, &s->masked[k].lpips, err);
  return st;
}

static sv_status write_panel(const run *r, const slot *s, int i_view, sv_err *err) {
  char path[SV_CAP_PATH], name[SV_CAP_PATH];
  const lab_frame *f = &r->v->frames[i_view];
  lab_view_name(r->v, i_view, name, sizeof name);
  if (snprintf(path, sizeof path, "%s/%s.png", r->job->panel_folder, name) >= (int)sizeof path)
    return sv_fail(err, SV_E_RANGE, "%s: the path is too long", f->path);
  size_t w = (size_t)f->view.width_px, h = (size_t)f->view.height_px, n = r->n_masks ? 3 : 2;
  uint8_t *px = malloc(n * w * h * 3);
  if (!px) return sv_fail(err, SV_E_NOMEM, "%s: no memory for the image", path);
  for (size_t y = 0; y < h; y++)
    for (size_t x = 0; x < w; x++)
      for (size_t c = 0; c < 3; c++) {
        float truth = s->truth[(c * h + y) * w + x];
        uint8_t *to = &px[(y * n * w + x) * 3 + c];
        to[0] = lab_to_byte(truth);
        to[w * 3] = lab_to_byte(s->image[(c * h + y) * w + x]);
        if (r->n_masks)
          to[2 * w * 3] =
              lab_to_byte(s->seen[LAB_MASK_OWN][y * w + x] ? truth : 0.25f * truth + (c == 0 ? 0.3f : 0));
      }
  sv_bitmap b = {.width_px = (int)(n * w), .height_px = (int)h, .n_channels = 3, .bits = 8, .u8 = px};
  sv_status st = sv_bitmap_write_png(path, &b, err);
  free(px);
  return st;
}

// Panel k of n is view floor((k + 0.5) views / n).
int lab_panel_of(int i, int n_views, int n_wanted) {
  int n = n_wanted < n_views ? n_wanted : n_views;
  for (int k = 0; k < n; k++)
    if ((2 * k + 1) * n_views / (2 * n) == i) return k;
  return -1;
}

static sv_status first_error(const run *r, int n, sv_err *err) {
  for (int i = 0; i < n; i++)
    if (r->slots[i].err.status < 0) {
      if (err) *err = r->slots[i].err;
      return r->slots[i].err.status;
    }
  return SV_OK;
}

static void add_scores(lab_scores *out, const slot *s, const lab_frame *f) {
  out->psnr += s->psnr;
  out->ssim += s->ssim;
  out->lpips += s->lpips;
  out->turned_deg += lab_view_turn_deg(&s->view, &f->view);
  out->shifted += lab_view_shift(&s->view, &f->view);
  out->counted += (double)s->n_counted / ((double)f->view.width_px * f->view.height_px);
  for (int k = 0; k < out->n_masks; k++) {
    lab_masked_scores *m = &out->masked[k];
    if (!s->n_seen[k]) continue;
    m->psnr += s->masked[k].psnr;
    m->ssim += s->masked[k].ssim;
    m->lpips += s->masked[k].lpips;
    m->coverage += (double)s->n_seen[k] / ((double)f->view.width_px * f->view.height_px);
    m->n++;
  }
  if (s->depth_error.n > 0) {
    out->abs_rel += s->depth_error.abs_rel;
    out->rmse += s->depth_error.rmse;
    out->n_depth++;
  }
}

static sv_status batch(run *r, int n, lab_scores *out, sv_err *err) {
  lab_session *se = r->job->session;
  double t0 = lab_seconds(se);
  sv_pool_run(&se->pool, load_task, r, n);
  sv_status s = first_error(r, n, err);
  double t1 = lab_seconds(se);
  for (int i = 0; s == SV_OK && i < n; i++) s = render_slot(r, &r->slots[i], frame_of(r, i), err);
  double t2 = lab_seconds(se);
  for (int i = 0; s == SV_OK && r->n_masks && i < n; i++) s = mask_slot(r, &r->slots[i], frame_of(r, i), err);
  if (s != SV_OK) return s;
  sv_pool_run(&se->pool, compare_task, r, n);
  s = first_error(r, n, err);
  for (int i = 0; s == SV_OK && r->lpips && i < n; i++) s = lpips_slot(r, &r->slots[i], frame_of(r, i), err);
  if (s != SV_OK) return s;
  out->load_s += t1 - t0;
  out->render_s += t2 - t1;
  out->compare_s += lab_seconds(se) - t2;
  for (int i = 0; i < n; i++) {
    const slot *sl = &r->slots[i];
    add_scores(out, sl, frame_of(r, i));
    int i_view = r->v->by_lens[r->i0 + i];
    if (r->job->on_view)
      r->job->on_view(r->job->of, &(lab_scored_view){i_view, sl->psnr, sl->ssim, sl->truth, sl->image});
    if (r->job->panel_folder && lab_panel_of(i_view, r->v->n, r->job->n_panels) >= 0 &&
        (s = write_panel(r, sl, i_view, err)) != SV_OK)
      return s;
  }
  return SV_OK;
}

static sv_status evaluate(run *r, lab_scores *out, sv_err *err) {
  lab_session *se = r->job->session;
  for (r->i0 = 0; r->i0 < r->v->n; r->i0 += r->n_slots) {
    int n = r->v->n - r->i0 < r->n_slots ? r->v->n - r->i0 : r->n_slots;
    if (se->console.is_stop_requested(se->console.self))
      return sv_fail(err, SV_E_INTERRUPTED, "evaluation stopped by request at view %d of %d", r->i0, r->v->n);
    sv_status s = batch(r, n, out, err);
    if (s != SV_OK) return s;
    char line[80];
    snprintf(line, sizeof line, "evaluated %d of %d views", r->i0 + n, r->v->n);
    se->console.log(se->console.self, SV_LOG_LIVE, line);
  }
  out->n = r->v->n;
  out->psnr /= out->n;
  out->ssim /= out->n;
  out->lpips /= out->n;
  out->counted /= out->n;
  out->turned_deg /= out->n;
  out->shifted /= out->n;
  for (int k = 0; k < out->n_masks; k++) {
    lab_masked_scores *m = &out->masked[k];
    m->coverage /= out->n;
    if (!m->n) continue;
    m->psnr /= m->n;
    m->ssim /= m->n;
    m->lpips /= m->n;
  }
  if (out->n_depth) {
    out->abs_rel /= out->n_depth;
    out->rmse /= out->n_depth;
  }
  return SV_OK;
}

static sv_status open_masks(run *r, lab_scores *out, sv_err *err) {
  const lab_eval_job *job = r->job;
  sv_status s = SV_OK;
  if (!job->mask_from) return SV_OK;
  if (job->is_by_support) {
    r->n_masks = out->n_masks = 1;
    out->is_by_support = true;
    out->covisible_by = "support";
    return lab_support_mask_open(&r->support, job, r->v, job->mask_from, err);
  }
  for (int k = 0; k <= job->n_shared && s == SV_OK; k++)
    s = lab_masks_open(&r->masks[k], job->session, r->v, k ? &job->shared_with[k - 1] : job->mask_from,
                       job->render.bg, err);
  if (s != SV_OK) return s;
  r->n_masks = out->n_masks = job->n_shared ? LAB_N_MASKS : 1;
  out->covisible_by = lab_masks_method(r->masks[0]);
  r->one_other = malloc(most_pixels(r->v));
  return r->one_other ? SV_OK : sv_fail(err, SV_E_NOMEM, "no memory for a mask");
}

sv_status lab_evaluate(const lab_views *v, const lab_eval_job *job, lab_scores *out, sv_err *err) {
  lab_session *se = job->session;
  run r = {.v = v, .job = job, .n_slots = se->n_threads};
  memset(out, 0, sizeof *out);
  sv_status s = lab_viewer_start(&r.viewer, se,
                                 (sv_renderer_cfg){.cap_gaussians = job->g->n,
                                                   .cap_width_px = v->cap_width_px,
                                                   .cap_height_px = v->cap_height_px,
                                                   .cap_pixels = v->cap_floats},
                                 err);
  if (s != SV_OK) return s;
  if (job->has_lpips) s = sv_lpips_open(&r.lpips, job->lpips_vgg, err);
  if (s == SV_OK) s = open_masks(&r, out, err);
  out->has_lpips = job->has_lpips;
  out->is_vgg = job->lpips_vgg != NULL;
  out->is_aligned = job->is_aligned;
  out->n_with_mask = v->n_masked;
  r.slots = calloc((size_t)r.n_slots, sizeof *r.slots);
  r.loaders = calloc((size_t)r.n_slots, sizeof *r.loaders);
  bool is_good = r.slots && r.loaders;
  for (int i = 0; is_good && i < r.n_slots; i++)
    is_good = slot_alloc(&r.slots[i], v, job->render.has_depth, r.n_masks);
  if (s == SV_OK && is_good && job->panel_folder) s = sv_path_make_folder(job->panel_folder, err);
  if (s == SV_OK && !is_good) s = sv_fail(err, SV_E_NOMEM, "no memory to evaluate %d views", v->n);
  if (s == SV_OK) s = evaluate(&r, out, err);
  for (int i = 0; r.slots && i < r.n_slots; i++) slot_free(&r.slots[i]);
  for (int i = 0; r.loaders && i < r.n_slots; i++) lab_loader_free(&r.loaders[i]);
  free(r.slots);
  free(r.loaders);
  sv_lpips_close(r.lpips);
  for (int k = 0; k <= LAB_CAP_SHARED; k++) lab_masks_close(r.masks[k]);
  lab_support_mask_close(r.support);
  free(r.one_other);
  lab_viewer_stop(&r.viewer);
  return s;
}
