// SPDX-License-Identifier: Apache-2.0
#include <math.h>
#include <string.h>

#include "src/format/transforms.h"
#include "tests/fuzz/fuzz.h"

size_t fuzz_seed(int i, uint8_t *buf, size_t cap) {
#define EYE "\"transform_matrix\":[[1,0,0,2],[0,1,0,3],[0,0,1,4],[0,0,0,1]]"
  static const char *const texts[] = {
      "{\"camera_angle_x\":0.69,\"frames\":[{\"file_path\":\"./r_0\"," EYE
      ",\"ray_distance_path\":\"d.png\"},{\"file_path\":\"./r_1\"," EYE "}],\"ray_distance_unit\":0.1}",
      "{\"fl_x\":500,\"fl_y\":510,\"cx\":320.5,\"cy\":240.25,\"w\":640.0,\"h\":480,\"k1\":0.1,\"p2\":-0.01,"
      "\"k3\":0,\"k4\":0,"
      "\"camera_model\":\"OPENCV\",\"depth_scale\":8000,\"ply_file_path\":\"./"
      "points.ply\",\"composites\":[{\"exposure\":0,"
      "\"file_path\":\"c.png\",\"M_max\":4}],\"frames\":[{\"file_path\":\"a.JPG\",\"depth_path\":\"d\","
      "\"exposure\":3,\"sub_view\":2,"
      "\"camera\":\"left\",\"time\":0.5,\"split\":\"test\",\"footprint\":[80,0,160,160]," EYE "}]}"};
  if (i >= 2 || strlen(texts[i]) > cap) return 0;
  return memcpy(buf, texts[i], strlen(texts[i])), strlen(texts[i]);
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t bytes) {
  static jsmntok_t tok[4096];
  static sv_transforms_frame frames[64];
  sv_transforms t;
  sv_transforms_measurement c;
  sv_err err;
  if (sv_transforms_open(&t, &(sv_file_data){"f", data, bytes}, tok, 4096, &err) != SV_OK) return 0;
  (void)!sv_transforms_find_measurement(&t, false, 0, &c, &err);
  if (sv_transforms_read(&t, frames, 64, &err) != SV_OK) return 0;
  for (int i = 0; i < t.n_frames; i++) {
    sv_transforms_frame *f = &frames[i];
    FUZZ_CHECK(sv_rotation_error(f->cam_from_world.r) < 1e-9);
    for (int k = 0; k < 3; k++) FUZZ_CHECK(isfinite(f->cam_from_world.t[k]));
    FUZZ_CHECK(f->time == -1 || (f->time >= 0 && f->time <= 1));
    int w = f->model.width_px ? f->model.width_px : 640, h = f->model.height_px ? f->model.height_px : 480;
    if (sv_transforms_finish(f, w, h, &err) != SV_OK) continue;
    FUZZ_CHECK(f->model.p[0] > 0 && f->model.p[1] > 0 && isfinite(f->model.p[2]) && isfinite(f->model.p[3]));
    double uv[2] = {w * 0.3, h * 0.9}, ray[3], back[2];
    if (sv_model_unproject(&f->model, uv, ray)) (void)sv_model_project(&f->model, ray, back, NULL, NULL);
  }
  return 0;
}
