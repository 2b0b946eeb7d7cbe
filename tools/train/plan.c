// SPDX-License-Identifier: Apache-2.0
#include "tools/train/plan.h"

#include "src/base/mathx.h"
#include "src/train/driver.h"
#include "tools/dataset/measurement.h"

#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>

static size_t padded(size_t n) { return (n + SV_ARENA_ALIGN - 1) & ~(size_t)(SV_ARENA_ALIGN - 1); }

static size_t mask_bytes(const lab_frame *f) {
  return f->is_masked ? (size_t)f->view.width_px * (size_t)f->view.height_px : 0;
}

// Of what its lenses see through; 0 where that is not known.
static size_t clear_values(const lab_measurement *m) {
  return m->has_alpha ? (size_t)m->width_px * (size_t)m->height_px : 0;
}

static size_t total_bytes(const lab_views *v, const sv_train_cfg *cfg, const lab_plan_extras *x) {
  size_t n = SV_ARENA_ALIGN + 2 * padded((size_t)v->n * sizeof(uint8_t *));
  for (int i = 0; i < v->n; i++)
    if (v->frames[i].i_measurement < 0)
      n += padded(lab_frame_bytes(&v->frames[i])) + padded(mask_bytes(&v->frames[i]));
  n += padded((size_t)v->n_measurements * sizeof(uint16_t *));
  n += v->n_measurements ? padded((size_t)v->n * sizeof(sv_lens)) : 0;
  n += padded((size_t)v->n_measurements * sizeof(uint16_t *));
  for (int i = 0; i < v->n_measurements; i++)
    n += padded(2 * lab_measurement_values(&v->measurements[i])) +
         padded(2 * clear_values(&v->measurements[i]));
  return n + sv_trainer_bytes(cfg) + sv_dynamic_bytes(&x->dynamic, cfg) + sv_prior_bytes(&x->prior, cfg) +
         padded(sv_driver_scratch_bytes(cfg, x->n_points));
}

static sv_status carve(lab_plan *p, lab_session *s, const lab_views *v, const sv_train_cfg *cfg,
                       const lab_plan_extras *x, sv_err *err) {
  sv_arena_part_begin(&p->arena, "pictures");
  p->pictures = SV_TAKE(&p->arena, uint8_t *, v->n);
  for (int i = 0; p->pictures && i < v->n; i++)
    p->pictures[i] =
        v->frames[i].i_measurement < 0 ? SV_TAKE(&p->arena, uint8_t, lab_frame_bytes(&v->frames[i])) : NULL;
  p->masks = SV_TAKE(&p->arena, uint8_t *, v->n);
  for (int i = 0; p->masks && i < v->n; i++)
    p->masks[i] = mask_bytes(&v->frames[i]) ? SV_TAKE(&p->arena, uint8_t, mask_bytes(&v->frames[i])) : NULL;
  p->measurements = SV_TAKE(&p->arena, uint16_t *, v->n_measurements);
  p->lenses = v->n_measurements ? SV_TAKE(&p->arena, sv_lens, v->n) : NULL;
  for (int i = 0; p->measurements && i < v->n_measurements; i++)
    p->measurements[i] = SV_TAKE(&p->arena, uint16_t, lab_measurement_values(&v->measurements[i]));
  p->clear = SV_TAKE(&p->arena, uint16_t *, v->n_measurements);
  for (int i = 0; p->clear && i < v->n_measurements; i++)
    p->clear[i] =
        v->measurements[i].has_alpha ? SV_TAKE(&p->arena, uint16_t, clear_values(&v->measurements[i])) : NULL;
  sv_arena_part_begin(&p->arena, "start");
  p->scratch = sv_arena_sub(&p->arena, sv_driver_scratch_bytes(cfg, x->n_points));
  if (p->arena.status < 0)
    return sv_fail(err, p->arena.status, "internal error: the memory plan is too small");
  sv_status st = sv_trainer_init(&p->trainer, cfg, (sv_compute){&s->k, &s->pool}, &p->arena, err);
  if (st >= 0) st = sv_dynamic_init(&p->dynamic, &x->dynamic, &p->trainer, &p->arena, err);
  return st >= 0 ? sv_prior_init(&p->prior, &x->prior, &p->trainer, &p->arena, err) : st;
}

// Lenses are rendered by regions of their sensor, never whole.
static void size_caps(sv_train_cfg *cfg, const lab_views *v) {
  int side = v->n_measurements ? cfg->region_px : 0;
  cfg->cap_views = 0;
  cfg->cap_measurements = v->n_measurements;
  cfg->cap_regions = 0;
  cfg->cap_lenses = cfg->cap_lens_width_px = cfg->cap_lens_height_px = 0;
  cfg->cap_width_px = cfg->cap_height_px = side;
  cfg->cap_pixels = side ? sv_plane_floats(side, side) : 0;
  for (int i = 0; i < v->n_measurements; i++)
    cfg->cap_regions += sv_train_n_regions(v->measurements[i].width_px, v->measurements[i].height_px, side);
  for (int i = 0; i < v->n; i++) {
    const sv_view *view = &v->frames[i].view;
    if (v->frames[i].i_measurement >= 0) {
      cfg->cap_lenses++;
      cfg->cap_lens_width_px = sv_maxi(cfg->cap_lens_width_px, view->width_px);
      cfg->cap_lens_height_px = sv_maxi(cfg->cap_lens_height_px, view->height_px);
      continue;
    }
    size_t floats = sv_plane_floats(view->width_px, view->height_px);
    cfg->cap_views++;
    if (view->width_px > cfg->cap_width_px) cfg->cap_width_px = view->width_px;
    if (view->height_px > cfg->cap_height_px) cfg->cap_height_px = view->height_px;
    if (floats > cfg->cap_pixels) cfg->cap_pixels = floats;
  }
  cfg->cap_lens_px = (size_t)cfg->cap_lens_width_px * (size_t)cfg->cap_lens_height_px;
}

sv_status lab_plan_make(lab_plan *p, lab_session *s, const lab_views *v, sv_train_cfg cfg,
                        const lab_plan_extras *x, sv_err *err) {
  memset(p, 0, sizeof *p);
  size_caps(&cfg, v);
  cfg.n_threads = s->n_threads;
  p->bytes = total_bytes(v, &cfg, x);
  // Pages are given when they are first touched: what the plan has in reserve costs nothing here.
  p->block = mmap(NULL, p->bytes, PROT_READ | PROT_WRITE, MAP_PRIVATE | MAP_ANONYMOUS | MAP_NORESERVE, -1, 0);
  if (p->block == MAP_FAILED) {
    p->block = NULL;
    return sv_fail(err, SV_E_NOMEM, "cannot allocate the %zu bytes that this training needs", p->bytes);
  }
  sv_linux_large_pages(p->block, p->bytes);
  p->arena = sv_arena_make(p->block, p->bytes);
  sv_status st = carve(p, s, v, &cfg, x, err);
  if (st != SV_OK) {
    lab_plan_free(p);
    return st;
  }
  sv_arena_seal(&p->arena);
  return SV_OK;
}

void lab_plan_free(lab_plan *p) {
  if (p->block) munmap(p->block, p->bytes);
  p->block = NULL;
}

sv_sampling lab_sampling_of(const lab_views *v) {
  sv_sampling s = {.is_multiplexed = v->n_measurements > 0};
  for (int i = 0; i < v->n; i++) {
    int n = 1, e = v->frames[i].f.exposure;
    bool is_first = true;
    for (int k = 0; e >= 0 && k < v->n; k++) {
      if (k == i || v->frames[k].f.exposure != e) continue;
      is_first &= k > i;
      n++;
    }
    s.n_exposures += is_first;
    s.largest_px = sv_maxi(s.largest_px, v->frames[i].view.width_px * v->frames[i].view.height_px);
    if (n > s.n_sub_views) s.n_sub_views = n;
  }
  return s;
}
