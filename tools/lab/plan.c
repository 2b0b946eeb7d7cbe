// SPDX-License-Identifier: Apache-2.0
#include "tools/lab/plan.h"

#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>

static size_t padded(size_t n) { return (n + SV_ARENA_ALIGN - 1) & ~(size_t)(SV_ARENA_ALIGN - 1); }

static size_t start_bytes(const sv_train_cfg *cfg, int n_points) {
  size_t fill = sv_init_scratch_bytes(cfg->n_gaussians, n_points);
  size_t radius = padded((size_t)cfg->n_gaussians * sizeof(float));
  return (fill > radius ? fill : radius) + SV_ARENA_ALIGN;
}

static size_t total_bytes(const lab_views *v, const sv_train_cfg *cfg, int n_points) {
  size_t n = SV_ARENA_ALIGN + padded((size_t)v->n * sizeof(uint8_t *));
  for (int i = 0; i < v->n; i++) n += padded(lab_frame_bytes(&v->frames[i]));
  return n + sv_trainer_bytes(cfg) + padded(start_bytes(cfg, n_points));
}

static sv_status carve(lab_plan *p, lab_session *s, const lab_views *v, const sv_train_cfg *cfg, int n_points,
                       sv_err *err) {
  sv_arena_part_begin(&p->arena, "pictures");
  p->pictures = SV_TAKE(&p->arena, uint8_t *, v->n);
  for (int i = 0; p->pictures && i < v->n; i++)
    p->pictures[i] = SV_TAKE(&p->arena, uint8_t, lab_frame_bytes(&v->frames[i]));
  sv_arena_part_begin(&p->arena, "start");
  p->scratch = sv_arena_sub(&p->arena, start_bytes(cfg, n_points));
  if (p->arena.status < 0)
    return sv_fail(err, p->arena.status, "the memory plan is too small by its own count");
  return sv_trainer_init(&p->trainer, cfg, &s->k, &s->pool, &p->arena, err);
}

sv_status lab_plan_make(lab_plan *p, lab_session *s, const lab_views *v, sv_train_cfg cfg, int n_points,
                        sv_err *err) {
  memset(p, 0, sizeof *p);
  cfg.cap_views = v->n;
  cfg.cap_width_px = v->cap_width_px, cfg.cap_height_px = v->cap_height_px;
  cfg.cap_pixels = v->cap_floats;
  cfg.n_threads = s->n_threads;
  p->bytes = total_bytes(v, &cfg, n_points);
  // Pages are given when they are first touched: what the plan has in reserve costs nothing here.
  p->block = mmap(NULL, p->bytes, PROT_READ | PROT_WRITE, MAP_PRIVATE | MAP_ANONYMOUS | MAP_NORESERVE, -1, 0);
  if (p->block == MAP_FAILED) {
    p->block = NULL;
    return sv_fail(err, SV_E_NOMEM, "the system does not give the %zu bytes that this training needs",
                   p->bytes);
  }
  p->arena = sv_arena_make(p->block, p->bytes);
  sv_status st = carve(p, s, v, &cfg, n_points, err);
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
