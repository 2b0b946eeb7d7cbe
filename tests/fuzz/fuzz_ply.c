// SPDX-License-Identifier: Apache-2.0
#include <math.h>
#include <string.h>

#include "src/format/ply.h"
#include "src/format/splat_file.h"
#include "tests/fuzz/blob.h"
#include "tests/fuzz/fuzz.h"

static size_t model_seed(int degree, uint8_t *buf, size_t cap) {
  static sv_ply_writer w;
  blob m = {buf, 0, cap};
  sv_ply_options o = {.n = 3,
                      .sh_degree = degree,
                      .vertical = "y",
                      .is_mip = degree > 1,
                      .dilation_px2 = degree == 3 ? 0.1f : 0.0f,
                      .has_normals = degree == 1};
  sv_gaussian g = {{1, 2, 3}, {1, 0, 0, 0.5f}, {-1, -2, -3}, 0.25f, {{1, 2, 3}, {4, 5, 6}}};
  sv_status s = sv_ply_write_begin(&w, (sv_sink){&m, blob_write}, &o, NULL);
  for (int i = 0; i < 3 && s == SV_OK; i++) s = sv_ply_write_gaussian(&w, &g, NULL);
  if (s == SV_OK) s = sv_ply_write_end(&w, NULL);
  return s == SV_OK ? m.n : 0;
}

size_t fuzz_seed(int i, uint8_t *buf, size_t cap) {
#define XYZ "property float x\nproperty float y\nproperty float z\n"
  static const char t0[] =
      "ply\nformat ascii 1.0\ncomment hi\nelement a 1\nproperty int q\nelement vertex 2\n" XYZ
      "property uchar red\nproperty uchar green\nproperty uchar blue\nend_header\n5\n1 2 3 4 5 6\n1 2 3 4 5 "
      "6\n";
  static const char t1[] =
      "ply\nformat binary_little_endian 1.0\nelement vertex 1\nproperty double x\nproperty short y\nproperty "
      "char z\n"
      "property uint w\nproperty ushort red\nproperty float green\nproperty int blue\nelement face 1\n"
      "property list uchar int v\nend_header\n0123456789012345678901234567890";
  static const char t2[] = "ply\nformat ascii 1.0\nelement vertex 1\n" XYZ
                           "property float f_dc_0\nproperty float f_dc_1\nproperty float f_dc_2\n"
                           "property float opacity\nproperty float scale_0\nproperty float scale_1\nproperty "
                           "float scale_2\nproperty float rot_0\n"
                           "property float rot_1\nproperty float rot_2\nproperty float rot_3\nend_header\n1 "
                           "2 3 .1 .2 .3 inf -1 -1 -inf 1 0 0 0\n";
  static const struct {
    const char *t;
    size_t n;
  } texts[3] = {{t0, sizeof t0 - 1}, {t1, sizeof t1 - 1}, {t2, sizeof t2 - 1}};
  if (i < 3) return memcpy(buf, texts[i].t, texts[i].n), texts[i].n;
  return i < 7 ? model_seed(i - 3, buf, cap) : 0;
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t bytes) {
  sv_ply p;
  sv_err err;
  if (sv_ply_open(&p, "f", data, bytes, &err) != SV_OK) return 0;
  for (uint32_t k = 0; k < p.n && k < 50; k++) {
    uint32_t i = k % 3 == 2 ? p.n - 1 - k : k;
    float xyz[3], rgb[3];
    sv_gaussian g;
    if (sv_ply_read_point(&p, i, xyz, rgb, &err) == SV_OK)
      for (int c = 0; c < 3; c++) FUZZ_CHECK(isfinite(xyz[c]) && rgb[c] >= 0 && rgb[c] <= 1);
    if (sv_ply_read_gaussian(&p, i, &g, &err) == SV_OK) {
      const float *f = g.mean;
      uint8_t splat[SV_SPLAT_BYTES];
      for (size_t c = 0; c < 3; c++)
        FUZZ_CHECK(isfinite(f[c]) && isfinite(g.log_scale[c]) && isfinite(g.sh[15][c]));
      FUZZ_CHECK(isfinite(g.opacity_logit) && p.kind == SV_PLY_GAUSSIANS && p.sh_degree <= 3);
      sv_splat_encode(&g, splat);
    }
  }
  return 0;
}
