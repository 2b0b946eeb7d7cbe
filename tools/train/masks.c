// SPDX-License-Identifier: Apache-2.0
#include "tools/train/masks.h"

#include <stdlib.h>
#include <string.h>

#include "src/base/str.h"
#include "tools/metric/covisible.h"
#include "tools/metric/flow.h"

#define WORK_SIDE_PX 640 // larger images are compared at 1/k
// depth images that tell what stands in front; more of them are thinned out
#define CAP_SOURCES 96
#define CLEAR       127 // of 255: alpha of a pixel that one looks through

// A training view.
typedef struct {
  sv_view view; // at working size
  sv_zbuffer zb;
  sv_flow_pyramid pyramid;
  sv_err err;
} support;

// What one thread needs.
typedef struct {
  lab_loader loader;
  sv_flow_work flow;
  float *fw, *bw;  // [2][working height][width] of the largest image
  uint8_t *seen;   // [height][width] of the largest masked view
  uint16_t *count; // the same
  sv_err err;
} worker;

struct lab_masks {
  lab_session *se;
  const lab_views *v;
  lab_views train;
  float bg[3];
  bool is_by_depth;
  lab_scene scene;
  support *supports; // [train.n]
  worker *workers;   // [n_threads]
  size_t cap_px;     // of v, full size
  size_t cap_work;   // of all, working size
  uint8_t *sky;      // [cap_px]
  float *grey;       // [cap_work]
  // the view at work
  const lab_masked_view *now;
  sv_view now_view; // working size
  sv_flow_pyramid now_pyramid;
  int now_k;
};

const char *lab_masks_method(const lab_masks *m) { return m->is_by_depth ? "depth" : "flow"; }

static int reduction(const sv_view *v) {
  int side = v->width_px > v->height_px ? v->width_px : v->height_px;
  return (side + WORK_SIDE_PX - 1) / WORK_SIDE_PX;
}
static size_t pixels(const sv_view *v) { return (size_t)v->width_px * (size_t)v->height_px; }

// --- depth: what stands in front of the training cameras -----------------------------------------

typedef struct {
  const lab_frame *frame;
  int scale; // of its split
  sv_view view;
  float *depth; // at working size
  sv_err err;
} depth_source;

typedef struct {
  lab_masks *m;
  depth_source sources[CAP_SOURCES];
  int n;
} depth_job;

static void source_task(void *arg, int i_task, int i_thread) {
  depth_job *j = arg;
  depth_source *d = &j->sources[i_task];
  const sv_view *full = &d->frame->view;
  int k = reduction(full), w = full->width_px;
  d->view = sv_view_scaled(full, k);
  float *depth = malloc(pixels(full) * sizeof *depth);
  d->depth = depth;
  if (!depth) {
    d->err.status = sv_fail(&d->err, SV_E_NOMEM, "%s: no memory for its depth", d->frame->path);
    return;
  }
  d->err.status = lab_depth_load(&j->m->workers[i_thread].loader, d->frame, d->scale, depth, &d->err);
  if (k == 1 || d->err.status != SV_OK) return;
  // the middle sample: depths of two surfaces are not mixed
  for (int y = 0; y < d->view.height_px; y++)
    for (int x = 0; x < d->view.width_px; x++)
      depth[(size_t)y * (size_t)d->view.width_px + (size_t)x] =
          depth[(size_t)(y * k + k / 2) * (size_t)w + (size_t)(x * k + k / 2)];
}

static void zbuffer_task(void *arg, int i_task, int i_thread) {
  depth_job *j = arg;
  support *s = &j->m->supports[i_task];
  (void)i_thread;
  s->zb.view = s->view;
  s->zb.z = calloc(pixels(&s->view), sizeof(float));
  if (!s->zb.z) {
    s->err.status = sv_fail(&s->err, SV_E_NOMEM, "no memory for what stands before a training view");
    return;
  }
  for (int i = 0; i < j->n; i++) sv_zbuffer_add(&s->zb, &j->sources[i].view, j->sources[i].depth);
}

// The frames with depth of several splits, thinned out evenly.
static void gather(depth_job *j, const lab_views *const *splits, int n_splits) {
  int n = 0, k = 0;
  for (int s = 0; s < n_splits; s++)
    for (int i = 0; i < splits[s]->n; i++) n += splits[s]->frames[i].f.depth_kind != SV_DEPTH_NONE;
  for (int s = 0; s < n_splits; s++)
    for (int i = 0; i < splits[s]->n; i++) {
      const lab_frame *f = &splits[s]->frames[i];
      if (f->f.depth_kind == SV_DEPTH_NONE) continue;
      if (n <= CAP_SOURCES || (long)(k + 1) * CAP_SOURCES / n > (long)k * CAP_SOURCES / n)
        j->sources[j->n++] = (depth_source){.frame = f, .scale = splits[s]->scale};
      k++;
    }
}

static sv_status fill_zbuffers(lab_masks *m, depth_job *j, sv_err *err) {
  sv_pool_run(&m->se->pool, source_task, j, j->n);
  for (int i = 0; i < j->n; i++)
    if (j->sources[i].err.status != SV_OK) {
      if (err) *err = j->sources[i].err;
      return j->sources[i].err.status;
    }
  sv_pool_run(&m->se->pool, zbuffer_task, j, m->train.n);
  return SV_OK;
}

// One file may serve several splits; a smaller one adds nothing.
static bool has_views_of(const lab_views *const *splits, int n, const lab_views *other) {
  for (int i = 0; i < n; i++)
    if (sv_str_eq(splits[i]->transforms, other->transforms) && splits[i]->n >= other->n) return true;
  return false;
}

static sv_status open_depth(lab_masks *m, const lab_source *train, sv_err *err) {
  static const char *const names[] = {"test", "test_near"};
  lab_views other[2] = {{0}};
  const lab_views *splits[4] = {m->v, &m->train};
  int n = 2;
  sv_status s = SV_OK;
  for (int i = 0; i < 2 && s == SV_OK; i++) {
    lab_source src = *train;
    src.split = names[i];
    src.n_exposures = 0;
    s = lab_views_open(&other[i], &src, &m->se->pool, err);
    if (s == SV_E_NOT_FOUND) s = SV_OK; // no such split
    else if (s == SV_OK && !has_views_of(splits, n, &other[i])) splits[n++] = &other[i];
  }
  depth_job *j = s == SV_OK ? calloc(1, sizeof *j) : NULL;
  if (s == SV_OK && !j) s = sv_fail(err, SV_E_NOMEM, "no memory for the depth of the views");
  if (s == SV_OK) {
    j->m = m;
    gather(j, splits, n);
    s = fill_zbuffers(m, j, err);
  }
  for (int i = 0; j && i < j->n; i++) free(j->sources[i].depth);
  free(j);
  for (int i = 0; i < 2; i++) lab_views_free(&other[i]);
  return s;
}

// --- flow: the training images in gray ----------------------------------------------------------

// Luma of an image over the background at 1/k, 0..255.
static void grey_of_u8(const uint8_t *u8, const lab_frame *f, const float bg[3], int k, float *out) {
  static const float luma[3] = {0.299f, 0.587f, 0.114f};
  size_t w = (size_t)f->view.width_px, nc = (size_t)f->n_channels, ww = w / (size_t)k;
  size_t hh = (size_t)(f->view.height_px / k);
  for (size_t y = 0; y < hh; y++)
    for (size_t x = 0; x < ww; x++) {
      float sum = 0;
      for (size_t i = 0; i < (size_t)(k * k); i++) {
        const uint8_t *p = u8 + ((y * (size_t)k + i / (size_t)k) * w + x * (size_t)k + i % (size_t)k) * nc;
        float a = nc == 4 ? (float)p[3] / 255.0f : 1.0f;
        for (size_t c = 0; c < 3; c++) sum += luma[c] * ((float)p[c] * a + 255.0f * (1 - a) * bg[c]);
      }
      *out++ = sum / (float)(k * k);
    }
}

static void pyramid_task(void *arg, int i_task, int i_thread) {
  lab_masks *m = arg;
  support *s = &m->supports[i_task];
  const lab_frame *f = &m->train.frames[i_task];
  uint8_t *u8 = malloc(lab_frame_bytes(f));
  float *grey = malloc(pixels(&s->view) * sizeof *grey);
  s->err.status = u8 && grey ? lab_picture_load(&m->workers[i_thread].loader, f, m->train.scale, u8, &s->err)
                             : sv_fail(&s->err, SV_E_NOMEM, "%s: no memory for the image", f->path);
  if (s->err.status == SV_OK) {
    grey_of_u8(u8, f, m->bg, reduction(&f->view), grey);
    s->err.status = sv_flow_pyramid_make(&s->pyramid, grey, s->view.width_px, s->view.height_px);
    if (s->err.status != SV_OK)
      sv_fail(&s->err, s->err.status, "%s: an image of %dx%d pixels cannot be used for flow", f->path,
              s->view.width_px, s->view.height_px);
  }
  free(u8);
  free(grey);
}

// Where camera a's pixels are in camera b if everything lay in the plane that faces a at the
// scene's center.
static void start_homography(const sv_view *a, const sv_view *b, const float centre[3], double h[9]) {
  double r[9], t[3], depth = (double)a->t[2];
  for (int i = 0; i < 3; i++) depth += (double)a->r[6 + i] * (double)centre[i];
  for (int i = 0; i < 3; i++) {
    for (int j = 0; j < 3; j++) {
      r[3 * i + j] = 0;
      for (int k = 0; k < 3; k++) r[3 * i + j] += (double)b->r[3 * i + k] * (double)a->r[3 * j + k];
    }
    t[i] = (double)b->t[i];
    for (int k = 0; k < 3; k++) t[i] -= r[3 * i + k] * (double)a->t[k];
    if (depth > 1e-6) r[3 * i + 2] += t[i] / depth;
  }
  double rows[9];
  for (int i = 0; i < 3; i++) { // K_b r
    rows[i] = (double)b->fx * r[i] + (double)b->cx * r[6 + i];
    rows[3 + i] = (double)b->fy * r[3 + i] + (double)b->cy * r[6 + i];
    rows[6 + i] = r[6 + i];
  }
  for (int i = 0; i < 3; i++) { // ... K_a^-1
    double x = rows[3 * i] / (double)a->fx, y = rows[3 * i + 1] / (double)a->fy;
    h[3 * i] = x;
    h[3 * i + 1] = y;
    h[3 * i + 2] = rows[3 * i + 2] - x * (double)a->cx - y * (double)a->cy;
  }
}

// --- opening -------------------------------------------------------------------------------------

static bool is_one_time(const lab_views *a, const lab_views *b) {
  for (int i = 0; i < a->n + b->n; i++) {
    const lab_frame *f = i < a->n ? &a->frames[i] : &b->frames[i - a->n];
    if (f->f.time != a->frames[0].f.time) return false;
  }
  return true;
}

static bool alloc_all(lab_masks *m) {
  m->supports = calloc((size_t)m->train.n, sizeof *m->supports);
  m->workers = calloc((size_t)m->se->pool.n_threads, sizeof *m->workers);
  if (!m->supports || !m->workers) return false;
  for (int i = 0; i < m->train.n; i++) {
    const sv_view *full = &m->train.frames[i].view;
    m->supports[i].view = sv_view_scaled(full, reduction(full));
    size_t n = pixels(&m->supports[i].view);
    if (n > m->cap_work) m->cap_work = n;
  }
  for (int i = 0; i < m->v->n; i++) {
    const sv_view *full = &m->v->frames[i].view;
    sv_view small = sv_view_scaled(full, reduction(full));
    if (pixels(full) > m->cap_px) m->cap_px = pixels(full);
    if (pixels(&small) > m->cap_work) m->cap_work = pixels(&small);
  }
  m->sky = malloc(m->cap_px);
  m->grey = malloc(m->cap_work * sizeof(float));
  bool is_good = m->sky && m->grey;
  for (int i = 0; i < m->se->pool.n_threads; i++) {
    worker *w = &m->workers[i];
    w->seen = malloc(m->cap_px);
    w->count = malloc(m->cap_px * sizeof *w->count);
    w->fw = m->is_by_depth ? NULL : malloc(2 * m->cap_work * sizeof(float));
    w->bw = m->is_by_depth ? NULL : malloc(2 * m->cap_work * sizeof(float));
    is_good = is_good && w->seen && w->count && (m->is_by_depth || (w->fw && w->bw));
  }
  return is_good;
}

static sv_status open_all(lab_masks *m, const lab_source *train, sv_err *err) {
  lab_source src = *train;
  src.split = "train";
  sv_status s = lab_views_open(&m->train, &src, &m->se->pool, err);
  if (s == SV_E_NOT_FOUND) { // lenses of one sensor need not have images of their own
    src.is_multiplexed = true;
    s = lab_views_open(&m->train, &src, &m->se->pool, err);
  }
  if (s != SV_OK) return s;
  if (m->train.n > UINT16_MAX)
    return sv_fail(err, SV_E_RANGE, "%s: %d training views are too many for --mask covisible", train->folder,
                   m->train.n);
  m->is_by_depth = m->v->has_depth && is_one_time(m->v, &m->train);
  m->scene = lab_scene_of(&m->train);
  if (!m->is_by_depth && m->train.n_measurements)
    return sv_fail(err, SV_E_NOT_FOUND,
                   "%s: without true depth of a scene at rest, masks need images of the training views, "
                   "and these have only multiplexed measurements",
                   train->folder);
  if (!alloc_all(m))
    return sv_fail(err, SV_E_NOMEM, "no memory for masks from %d training views", m->train.n);
  if (m->is_by_depth) s = open_depth(m, train, err);
  else sv_pool_run(&m->se->pool, pyramid_task, m, m->train.n);
  for (int i = 0; s == SV_OK && i < m->train.n; i++)
    if ((s = m->supports[i].err.status) != SV_OK && err) *err = m->supports[i].err;
  return s;
}

sv_status lab_masks_open(lab_masks **out, lab_session *se, const lab_views *v, const lab_source *train,
                         const float bg[3], sv_err *err) {
  lab_masks *m = *out = calloc(1, sizeof *m);
  if (!m) return sv_fail(err, SV_E_NOMEM, "no memory for masks");
  m->se = se;
  m->v = v;
  memcpy(m->bg, bg, sizeof m->bg);
  sv_status s = open_all(m, train, err);
  if (s == SV_OK) return SV_OK;
  lab_masks_close(m);
  *out = NULL;
  return s;
}

void lab_masks_close(lab_masks *m) {
  if (!m) return;
  for (int i = 0; m->supports && i < m->train.n; i++) {
    free(m->supports[i].zb.z);
    sv_flow_pyramid_free(&m->supports[i].pyramid);
  }
  for (int i = 0; m->workers && i < m->se->pool.n_threads; i++) {
    worker *w = &m->workers[i];
    lab_loader_free(&w->loader);
    sv_flow_work_free(&w->flow);
    free(w->fw);
    free(w->bw);
    free(w->seen);
    free(w->count);
  }
  free(m->supports);
  free(m->workers);
  free(m->sky);
  free(m->grey);
  sv_flow_pyramid_free(&m->now_pyramid);
  lab_views_free(&m->train);
  free(m);
}

// --- one view ------------------------------------------------------------------------------------

static void count_up(worker *w, size_t n) {
  for (size_t i = 0; i < n; i++) w->count[i] = (uint16_t)(w->count[i] + w->seen[i]);
}

static void depth_task(void *arg, int i_task, int i_thread) {
  lab_masks *m = arg;
  worker *w = &m->workers[i_thread];
  sv_covisible_test test = {.view = &m->now->frame->view, .depth = m->now->depth, .is_sky = m->sky};
  sv_covisible_by_depth(&test, &m->supports[i_task].zb, w->seen);
  count_up(w, pixels(test.view));
}

static void flow_task(void *arg, int i_task, int i_thread) {
  lab_masks *m = arg;
  worker *w = &m->workers[i_thread];
  const support *s = &m->supports[i_task];
  const sv_view *a = &m->now_view, *b = &s->view;
  double there[9], back[9];
  if (w->err.status != SV_OK) return;
  start_homography(a, b, m->scene.centre, there);
  start_homography(b, a, m->scene.centre, back);
  sv_status st = sv_flow_dense(&m->now_pyramid, &s->pyramid, there, &w->flow, w->fw);
  if (st == SV_OK) st = sv_flow_dense(&s->pyramid, &m->now_pyramid, back, &w->flow, w->bw);
  w->err.status = st;
  if (st != SV_OK) return;
  sv_flow_field fw = {w->fw, a->width_px, a->height_px}, bw = {w->bw, b->width_px, b->height_px};
  sv_flow_check(&fw, &bw, m->now_k, w->seen);
  count_up(w, pixels(a));
}

static void mark_sky(lab_masks *m, const lab_masked_view *view) {
  size_t n = pixels(&view->frame->view);
  for (size_t i = 0; i < n; i++)
    m->sky[i] = view->frame->n_channels == 4 && view->picture[4 * i + 3] <= CLEAR && !(view->depth[i] > 0);
}

static sv_status prepare_flow(lab_masks *m, const lab_masked_view *view, sv_err *err) {
  const sv_view *a = &m->now_view;
  grey_of_u8(view->picture, view->frame, m->bg, m->now_k, m->grey);
  sv_flow_pyramid_free(&m->now_pyramid);
  sv_status s = sv_flow_pyramid_make(&m->now_pyramid, m->grey, a->width_px, a->height_px);
  return s == SV_OK ? SV_OK
                    : sv_fail(err, s, "%s: an image of %dx%d pixels cannot be used for flow",
                              view->frame->path, a->width_px, a->height_px);
}

sv_status lab_masks_make(lab_masks *m, const lab_masked_view *view, uint8_t *mask, sv_err *err) {
  const sv_view *full = &view->frame->view;
  int n_threads = m->se->pool.n_threads, needed = sv_covisible_needed(m->train.n);
  sv_status s = SV_OK;
  m->now = view;
  m->now_k = m->is_by_depth ? 1 : reduction(full);
  m->now_view = sv_view_scaled(full, m->now_k);
  if (m->is_by_depth) mark_sky(m, view);
  else if ((s = prepare_flow(m, view, err)) != SV_OK) return s;
  for (int i = 0; i < n_threads; i++) memset(m->workers[i].count, 0, m->cap_px * sizeof(uint16_t));
  sv_pool_run(&m->se->pool, m->is_by_depth ? depth_task : flow_task, m, m->train.n);
  for (int i = 0; i < n_threads; i++)
    if (m->workers[i].err.status != SV_OK)
      return sv_fail(err, m->workers[i].err.status, "%s: no memory for flow", view->frame->path);
  int w = m->now_view.width_px, h = m->now_view.height_px;
  for (int y = 0; y < full->height_px; y++)
    for (int x = 0; x < full->width_px; x++) {
      int xs = x / m->now_k < w ? x / m->now_k : w - 1, ys = y / m->now_k < h ? y / m->now_k : h - 1, n = 0;
      for (int i = 0; i < n_threads; i++) n += m->workers[i].count[(size_t)ys * (size_t)w + (size_t)xs];
      mask[(size_t)y * (size_t)full->width_px + (size_t)x] = n >= needed;
    }
  return SV_OK;
}
