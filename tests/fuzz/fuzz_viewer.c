// SPDX-License-Identifier: Apache-2.0
// Models in viewers' formats. The first byte picks the name, which decides for .splat: 0 SPZ, 1
// GLB, 2 .splat; the file follows.
#include <math.h>
#include <stdio.h>
#include <unistd.h>

#include "src/format/spz.h"
#include "tests/fuzz/blob.h"
#include "tests/fuzz/fuzz.h"
#include "tools/lab/model_formats.h"

#define CAP_N 20000 // larger ones only cost time

static const char *const names[] = {"m.spz", "m.glb", "m.splat"};

static size_t from_file(const char *path, uint8_t *buf, size_t cap) {
  FILE *f = fopen(path, "rb");
  const size_t n = f ? fread(buf, 1, cap, f) : 0;
  if (f) fclose(f);
  unlink(path);
  return n;
}

size_t fuzz_seed(int i, uint8_t *buf, size_t cap) {
  static _Alignas(64) uint8_t block[1 << 16];
  char path[64];
  sv_gaussians g;
  sv_arena a = sv_arena_make(block, sizeof block);
  const int degree = i % 3, kind = i / 3; // SPZ 2, 3, 4, GLB, .splat
  if (kind > 4 || sv_gaussians_init(&g, 5, degree, &a) != SV_OK) return 0;
  for (int k = 0; k < 5; k++) {
    const sv_gaussian v = {{(float)k, 1, 2}, {1, 0, 0, 0.2f}, {-2, -3, -1}, 0.5f, {{0.1f, 0.2f, 0.3f}}};
    sv_gaussians_put(&g, k, &v);
  }
  snprintf(path, sizeof path, "/tmp/fuzz_viewer_%ld", (long)getpid());
  const sv_model_notes notes = {
      .is_mip = i % 2, .up = "z", .unit = {.is_metric = i % 2, .scale_sigma = 0.001f}};
  const sv_status s = kind < 3    ? lab_write_spz(&g, &notes, 2 + kind, path, NULL)
                      : kind == 3 ? lab_write_glb(&g, &notes, path, NULL)
                                  : lab_write_splat(&g, path, NULL);
  if (s != SV_OK) return 0;
  buf[0] = (uint8_t)(kind < 3 ? 0 : kind - 2);
  return 1 + from_file(path, buf + 1, cap - 1);
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t bytes) {
  sv_gaussians g = {0};
  sv_err err = {0};
  sv_spz z;
  size_t at[SV_SPZ_N_STREAMS], packed[SV_SPZ_N_STREAMS];
  sv_model_notes notes;
  void *block = NULL;
  if (bytes < 2) return 0;
  const sv_file_data file = {names[data[0] % 3], data + 1, bytes - 1};
  if (!lab_is_viewer_format(file.name, file.data, file.bytes)) return 0;
  if (sv_spz_is_4(file.data, file.bytes) && sv_spz_open4(&z, &file, at, packed, &err) == SV_OK && z.n > CAP_N)
    return 0;
  const sv_status s = lab_read_viewer_format(&g, &notes, &block, &file, &err);
  FUZZ_CHECK(s == SV_OK || (s < 0 && err.text[0]));
  for (int i = 0; s == SV_OK && i < g.n && i < 50; i++) {
    sv_gaussian v;
    sv_gaussians_get(&g, i, &v);
    for (int c = 0; c < 3; c++) FUZZ_CHECK(isfinite(v.mean[c]) && isfinite(v.log_scale[c]));
    FUZZ_CHECK(isfinite(v.opacity_logit) && isfinite(v.sh[0][0]) && isfinite(v.quat_wxyz[0]));
  }
  free(block);
  return 0;
}
