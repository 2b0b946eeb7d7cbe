// SPDX-License-Identifier: Apache-2.0
#include <math.h>
#include <string.h>

#include "src/format/kalibr.h"
#include "src/format/rig_file.h"
#include "tests/fuzz/fuzz.h"

size_t fuzz_seed(int i, uint8_t *buf, size_t cap) {
  static const char *const texts[] = {
      "cam0:\n  cam_overlaps: [1]\n  camera_model: pinhole\n  distortion_coeffs: [-0.28, 0.07,\n    1.0e-05, "
      "2e-4]\n"
      "  distortion_model: radtan\n  intrinsics: [458.6, 457.2, 367.2, 248.3]\n  resolution: [752, 480]\n"
      "  rostopic: /cam0/image_raw\ncam1:\n  T_cn_cnm1:\n  - [1.0, 0.0, 0.0, -0.11]\n  - [0.0, 1.0, 0.0, 0]\n"
      "  - [0.0, 0.0, 1.0, 0]\n  - [0.0, 0.0, 0.0, 1.0]\n  camera_model: pinhole\n  distortion_coeffs: [0, "
      "0, 0, 0]\n"
      "  distortion_model: equidistant\n  intrinsics: [1, 1, 1, 1]\n  resolution: [4, 3]\n",
      "%YAML:1.0\n---\nimu0:\n  rate: 200\n  T:\n  - - 1\n    - 2\ncam0: # left\n    camera_model: "
      "'pinhole'\n"
      "    distortion_coeffs: []\n    distortion_model: \"none\"\n    intrinsics:\n    - 1\n    - 2\n    - "
      "3\n    - 4\n"
      "    resolution: [[7], 5]\n"};
  if (i >= 2 || strlen(texts[i]) > cap) return 0;
  return memcpy(buf, texts[i], strlen(texts[i])), strlen(texts[i]);
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t bytes) {
  enum { CAP = 4 };
  static sv_sub_view views[CAP];
  char text[2048];
  sv_err err;
  sv_rig rig = {.sub_views = views, .cap_sub_views = CAP};
  sv_status s = sv_kalibr_read(&rig, "f", (const char *)data, bytes, &err);
  FUZZ_CHECK(s <= 0);
  if (s != SV_OK) return 0;
  FUZZ_CHECK(rig.n_sub_views > 0 && rig.n_sub_views <= CAP);
  for (int i = 0; i < rig.n_sub_views; i++) {
    const sv_sub_view *v = &views[i];
    FUZZ_CHECK(v->model.p[0] > 0 && v->model.p[1] > 0 && v->model.width_px > 0 && v->model.height_px > 0);
    FUZZ_CHECK(sv_rotation_error(v->cam_from_rig.r) < 1e-9 && isfinite(v->cam_from_rig.t[0]));
  }
  sv_str out = sv_str_make(text, sizeof text);
  FUZZ_CHECK(sv_rig_json_write(&out, &rig) == SV_OK);
  return 0;
}
