// SPDX-License-Identifier: Apache-2.0
// The first byte picks the file's kind: cameras, images, points, rigs, frames, as text (0..4) or
// binary (5..9).
#include <math.h>
#include <string.h>

#include "src/format/bytes.h"
#include "src/format/colmap.h"
#include "tests/fuzz/fuzz.h"

static size_t put_doubles(uint8_t *p, int n) {
  static const uint8_t one[8] = {0, 0, 0, 0, 0, 0, 0xF0, 0x3F};
  for (int i = 0; i < n; i++) memcpy(p + 8 * i, one, 8);
  return 8 * (size_t)n;
}

size_t fuzz_seed(int i, uint8_t *b, size_t cap) {
  static const char *const texts[5] = {
      ("# c\n1 SIMPLE_RADIAL 640 480 500 320 240 0.1\n7 FULL_OPENCV 10 20 1 2 3 4 5 6 7 8 9 10 11 12\n2 "
       "PINHOLE 5 5 1 1 1 1\n"),
      "1 1 0 0 0 1 2 3 7 a b.jpg\n\n2 0.6 0.8 0 0 0 0 0 7 c.jpg\n1 2 -1 3 4 5\n",
      "9 1 -2 3 255 2 3 0.5 1 2 3 4 \n10 1 1 1 0 0 0 1\n",
      "1 4 CAMERA 1 CAMERA 2 1 0.6 0.8 0 0 1 2 3 IMU 1 0 CAMERA 3 0\n2 1 CAMERA 4\n7 0\n",
      "1 4 1 0 0 0 1 2 3 3 CAMERA 1 11 IMU 7 5 CAMERA 2 12\n9 4 1 0 0 0 0 0 0 0\n"};
  size_t n = 0;
  if (i > 9 || cap < 1000) return 0;
  b[n++] = (uint8_t)i;
  if (i < 5) return memcpy(b + 1, texts[i], strlen(texts[i])), 1 + strlen(texts[i]);
  memset(b + 1, 0, 999);
  sv_put_le64(b + n, 1);
  n += 8;
  if (i == 5) {
    sv_put_le32(b + n, 1);
    sv_put_le32(b + n + 4, 4);
    sv_put_le64(b + n + 8, 640);
    sv_put_le64(b + n + 16, 480);
    n += 24;
    n += put_doubles(b + n, 8);
  } else if (i == 6) {
    n += 4;
    put_doubles(b + n, 1);
    n += 56;
    n += 4;
    memcpy(b + n, "a.jpg", 6);
    n += 6;
    sv_put_le64(b + n, 2);
    n += 8 + 48;
  } else if (i == 8) {
    sv_put_le32(b + n, 1);
    sv_put_le32(b + n + 4, 3);
    sv_put_le32(b + n + 12, 1);
    n += 16;
    sv_put_le32(b + n + 4, 2);
    b[n + 8] = 1;
    put_doubles(b + n + 9, 1);
    n += 9 + 56;
    sv_put_le32(b + n + 4, 3);
    n += 9;
  } else if (i == 9) {
    n += 8;
    put_doubles(b + n, 1);
    n += 56;
    sv_put_le32(b + n, 2);
    n += 4 + 32;
  } else {
    n += 8;
    n += put_doubles(b + n, 3);
    n += 3 + put_doubles(b + n + 3, 1);
    sv_put_le64(b + n, 2);
    n += 8 + 16;
  }
  return n;
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t bytes) {
  sv_colmap c;
  sv_err err;
  if (!bytes) return 0;
  int kind = data[0] % 10;
  sv_status s = sv_colmap_open(&c, "f", data + 1, bytes - 1, kind > 4, &err);
  for (int i = 0; i < 10000 && s == SV_OK; i++) {
    sv_colmap_camera k;
    sv_colmap_image m;
    sv_colmap_point p;
    if (kind % 5 == 0) {
      s = sv_colmap_next_camera(&c, &k, &err);
      if (s == SV_OK)
        FUZZ_CHECK(k.model.p[0] > 0 && k.model.p[1] > 0 && k.model.width_px > 0 && isfinite(k.model.p[4]));
    } else if (kind % 5 == 1) {
      s = sv_colmap_next_image(&c, &m, &err);
      if (s == SV_OK)
        FUZZ_CHECK(m.name[0] && strlen(m.name) < sizeof m.name &&
                   sv_rotation_error(m.cam_from_world.r) < 1e-9);
    } else if (kind % 5 == 3) {
      static sv_colmap_rig g;
      s = sv_colmap_next_rig(&c, &g, &err);
      for (int j = 0; s == SV_OK && j < g.n_cameras; j++)
        FUZZ_CHECK(sv_rotation_error(g.cameras[j].cam_from_rig.r) < 1e-9);
    } else if (kind % 5 == 4) {
      static sv_colmap_frame f;
      s = sv_colmap_next_frame(&c, &f, &err);
      if (s == SV_OK)
        FUZZ_CHECK(f.n_images <= SV_COLMAP_CAP_DATA && sv_rotation_error(f.rig_from_world.r) < 1e-9);
    } else {
      s = sv_colmap_next_point(&c, &p, &err);
      if (s == SV_OK) FUZZ_CHECK(isfinite(p.xyz[0]) && isfinite(p.xyz[1]) && isfinite(p.xyz[2]));
    }
    FUZZ_CHECK(s == SV_OK || s == SV_END || s < 0);
  }
  return 0;
}
