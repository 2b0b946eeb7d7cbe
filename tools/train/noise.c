// SPDX-License-Identifier: Apache-2.0
#include "tools/train/noise.h"

#include <stdlib.h>

#include "src/base/rng.h"
#include "tools/dataset/measurement.h"

typedef struct {
  const lab_views *v;
  const lab_plan *p;
  sv_noise_model model;
  uint32_t seed;
  sv_noise tables;
} job;

static uint32_t hash_of(const char *text) { // FNV-1a
  uint32_t h = 2166136261u;
  for (; *text; text++) h = (h ^ (unsigned char)*text) * 16777619u;
  return h;
}

static sv_noise_job noise_of(const job *j, int exposure, int sub_view, const char *file) {
  return (sv_noise_job){.model = j->model,
                        .key = {sv_hash3(j->seed, (uint32_t)exposure, (uint32_t)sub_view), hash_of(file)},
                        .is_over_black = true};
}

static void task(void *arg, int i_task, int i_thread) {
  const job *j = arg;
  sv_status s;
  (void)i_thread;
  if (i_task < j->v->n) {
    const lab_frame *f = &j->v->frames[i_task];
    if (f->i_measurement >= 0) return;
    sv_noise_job n = noise_of(j, f->f.exposure, f->f.sub_view, f->f.file_path);
    s = sv_noise_u8(&j->tables, &n, j->p->pictures[i_task], f->n_channels,
                    (size_t)f->view.width_px * (size_t)f->view.height_px);
  } else {
    const lab_measurement *m = &j->v->measurements[i_task - j->v->n];
    sv_noise_job n = noise_of(j, m->exposure, -1, sv_path_name(m->path));
    s = sv_noise_u16(&j->tables, &n, j->p->measurements[i_task - j->v->n], 3,
                     (size_t)m->width_px * (size_t)m->height_px);
  }
  (void)s; // images have 3 or 4 channels
}

sv_status lab_noise_add(const lab_views *v, const lab_plan *p, const sv_noise_model *m,
                        const sv_train_cfg *cfg, const sv_pool *pool, sv_err *err) {
  const uint64_t seed = cfg->seed;
  job j = {.v = v, .p = p, .model = *m, .seed = sv_hash3((uint32_t)seed, (uint32_t)(seed >> 32), 0x6e01)};
  for (int i = 0; i < v->n; i++)
    if (v->frames[i].i_measurement < 0 && v->frames[i].n_channels == 4 &&
        (cfg->background == SV_BG_WHITE || cfg->background == SV_BG_RANDOM))
      return sv_fail(err, SV_E_ARG, "%s: has alpha, which --noise blends over black; use --background black",
                     v->frames[i].path);
  size_t bytes = sv_noise_bytes() + SV_ARENA_ALIGN;
  void *block = malloc(bytes);
  sv_arena a = sv_arena_make(block, block ? bytes : 0);
  sv_status s = block ? sv_noise_init(&j.tables, &a) : SV_E_NOMEM;
  if (s == SV_OK) sv_pool_run(pool, task, &j, v->n + v->n_measurements);
  free(block);
  return s == SV_OK ? s : sv_fail(err, s, "no memory for the tables of the noise");
}
