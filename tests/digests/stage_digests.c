// SPDX-License-Identifier: Apache-2.0
// Prints a digest of what each stage of each training step leaves behind, for a small simulated
// scene. The output of two builds, instruction sets or thread counts is compared with diff: the
// first line that differs names the step and the stage.
//
//   stage-digests [STEPS [ISA [THREADS]]]     (20, the best of this CPU, 1)
//
// Bytes that a stage leaves undefined are not part of its digest. A stage digest is of the last
// image rendered in a step.
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "tests/common/world.h"

static world w;

// FNV-1a.
static uint64_t hash(uint64_t h, const void *data, size_t bytes) {
  const uint8_t *p = data;
  for (size_t i = 0; i < bytes; i++) h = (h ^ p[i]) * 0x100000001b3ull;
  return h;
}
#define HASH_START 0xcbf29ce484222325ull

static uint64_t of_splats(const sv_renderer *r, int n) {
  uint64_t h = HASH_START;
  for (int i = 0; i < n; i++)
    if (r->splat[i].n_intersections) h = hash(h, &r->splat[i], sizeof r->splat[i]);
  return h;
}

// By tile, front to back: which Gaussians. Saturated blocks have been removed from the masks.
static uint64_t of_lists(const sv_renderer *r) {
  uint64_t h = hash(HASH_START, r->tile_begin, sizeof *r->tile_begin * ((size_t)r->n_tiles + 1));
  for (uint32_t i = 0; i < r->tile_begin[r->n_tiles]; i++)
    h = hash(h, &r->intersection[r->list[i]], sizeof *r->intersection);
  return h;
}

static uint64_t of_planes(const sv_planes *p) {
  uint64_t h = HASH_START;
  for (int c = 0; c < 3; c++)
    for (int y = 0; y < p->height_px; y++)
      h = hash(h, p->c[c] + (size_t)y * (size_t)p->stride, sizeof(float) * (size_t)p->width_px);
  return h;
}

static uint64_t of_igrads(const sv_renderer *r) {
  uint64_t h = HASH_START;
  for (uint32_t i = 0; i < r->tile_begin[r->n_tiles]; i++)
    if (r->intersection[r->list[i]].mask)
      h = hash(h, r->igrad + (size_t)r->list[i] * SV_IGRAD_BYTES, SV_IGRAD_BYTES);
  return h;
}

static void print(uint32_t step, const char *stage, uint64_t digest) {
  printf("step %4u  %-24s %016llx\n", (unsigned)step, stage, (unsigned long long)digest);
}

int main(int argc, char **argv) {
  const int n_steps = argc > 1 ? atoi(argv[1]) : 20;
  const int isa = argc > 2 ? sv_isa_by_name(argv[2]) : -1, n_threads = argc > 3 ? atoi(argv[3]) : 1;
  if (n_steps < 1 || n_threads < 1 || (argc > 2 && isa < 0)) {
    fputs("stage-digests [STEPS [ISA [THREADS]]]; ISA: ref, sse41, avx2, avx512 or neon\n", stderr);
    return 2;
  }
  const uint32_t mask = isa < 0 ? ~0u : sv_isa_only((sv_isa)isa);
  if (!world_open(&w, "textured,rig=stereo,size=100x76", 3, mask, n_threads)) return 1;
  w.cfg.train.n_gaussians = 1500;
  w.cfg.train.sh_degree = 2;
  w.cfg.train.relocate_every = 5;
  w.cfg.steps = 1;
  if (world_run(&w) < 0) {
    fprintf(stderr, "%s\n", w.err.text);
    return 1;
  }
  sv_trainer *t = &w.app.trainer;
  print(0, "start", sv_train_digest(t));
  for (int i = 0; i < n_steps; i++) {
    sv_step_stats st;
    const sv_status s = sv_train_step(t, (float)i / (float)n_steps, &st);
    if (s < 0) {
      fprintf(stderr, "step %u failed: status %d\n", (unsigned)t->step, (int)s);
      return 1;
    }
    print(t->step, "target", of_planes(&t->target));
    print(t->step, "projection", of_splats(&t->render, t->g.n));
    print(t->step, "binning and sorting", of_lists(&t->render));
    print(t->step, "rasterization", of_planes(&t->render.rgb));
    print(t->step, "loss gradient", of_planes(&t->grad));
    print(t->step, "rasterization backward", of_igrads(&t->render));
    print(t->step, "parameters", sv_train_digest(t));
  }
  world_close(&w);
  return 0;
}
