// SPDX-License-Identifier: Apache-2.0
// motion.bin, in both forms, and with bodies: opened, and read for the model that it belongs to.
#include <string.h>

#include "src/deform/deform_file.h"
#include "tests/fuzz/blob.h"
#include "tests/fuzz/fuzz.h"

#define N 20

static _Alignas(64) uint8_t block[4u << 20], model[1u << 16];

static bool make_model(sv_gaussians *g) {
  sv_arena a = sv_arena_make(model, sizeof model);
  if (sv_gaussians_init(g, N, 0, &a) < 0) return false;
  memset(g->param, 0, (size_t)g->cap * (size_t)g->n_rows * sizeof *g->param);
  return true;
}

size_t fuzz_seed(int i, uint8_t *buf, size_t cap) {
  sv_gaussians g;
  const bool is_clip = i != 2, has_bodies = i == 3;
  sv_deform d = {.kind = is_clip ? SV_DEFORM_CLIP : SV_DEFORM_FIELD};
  sv_arena a = sv_arena_make(block, sizeof block);
  blob m = {buf, 0, cap};
  if (i > 3 || !make_model(&g)) return 0;
  sv_motion_cfg mc = {.functions = i == 1 ? SV_MOTION_POWERS : SV_MOTION_CHEBYSHEV, .n_pos = 2, .n_rot = 1};
  mc.cap_knots = has_bodies ? 3 : 0;
  sv_field_cfg fc = {.n_channels = 16, .n_levels = 1, .mult = {1}, .base = 2, .n_times = 2, .width = 16};
  fc.is_shared = true;
  fc.n_threads = 1;
  sv_status s = is_clip ? sv_motion_init(&d.motion, &mc, &g, &a) : sv_field_init(&d.field, &fc, &g, &a);
  if (s < 0) return 0;
  if (is_clip) sv_motion_reset(&d.motion, N / 2);
  else {
    sv_field_reset(&d.field, &g, 1);
    d.field.n_moving = N / 2;
  }
  if (has_bodies) {
    sv_bodies *b = &d.motion.bodies;
    b->n = 3;
    for (int k = 0; k < 3; k++)
      if (sv_bodies_add_knot(b, 0.5f * (float)k) < 0) return 0;
    for (int k = 0; k < N / 2; k++) b->of[k] = (uint8_t)(k % 3);
  }
  return sv_deform_write(&d, &g, (sv_sink){&m, blob_write}, NULL) == SV_OK ? m.n : 0;
}

static void read_one(const uint8_t *data, size_t bytes) {
  sv_deform_file f;
  sv_deform d;
  sv_gaussians g;
  sv_err err;
  sv_arena a = sv_arena_make(block, sizeof block);
  if (!make_model(&g) || sv_deform_open(&f, &(sv_file_data){"f", data, bytes}, &err) != SV_OK) return;
  if (sv_deform_read(&d, &f, &g, 1, &a, &err) != SV_OK) return;
  FUZZ_CHECK(sv_deform_n_moving(&d) >= 0 && sv_deform_n_moving(&d) <= N);
  const sv_bodies *b = &d.motion.bodies;
  if (d.kind != SV_DEFORM_CLIP || b->n < 2) return;
  sv_rigid at[SV_CAP_BODIES];
  sv_bodies_at(b, 0.3f, at);
  for (int i = 0; i < N; i++) FUZZ_CHECK(b->of[i] < b->n);
  for (int i = 0; i < b->n; i++) FUZZ_CHECK(at[i].q[0] == at[i].q[0] && at[i].d[0] == at[i].d[0]);
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t bytes) {
  static uint8_t sealed[1u << 16];
  read_one(data, bytes);
  if (bytes > sizeof sealed) return 0;
  if (bytes) memcpy(sealed, data, bytes);
  blob_seal(sealed, bytes);
  read_one(sealed, bytes);
  return 0;
}
