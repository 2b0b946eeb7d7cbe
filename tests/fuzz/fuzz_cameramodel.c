// SPDX-License-Identifier: Apache-2.0
#include <math.h>
#include <stdio.h>
#include <string.h>

#include "src/format/cameramodel.h"
#include "tests/fuzz/fuzz.h"

static size_t splined_seed(uint8_t *buf, size_t cap) {
  char *p = (char *)buf;
  size_t n =
      (size_t)snprintf(p, cap,
                       "{'lensmodel':'LENSMODEL_SPLINED_STEREOGRAPHIC_order=3_Nx=5_Ny=4_fov_x_deg=120',"
                       "'intrinsics':[300,300,320,240");
  for (int k = 0; k < 40; k++) n += (size_t)snprintf(p + n, cap - n, ",%g", 0.001 * (k % 7 - 3));
  return n + (size_t)snprintf(p + n, cap - n, "],'extrinsics':[0,0,0,0,0,0],'imagersize':[640,480]}");
}

size_t fuzz_seed(int i, uint8_t *buf, size_t cap) {
  static const char *const texts[] = {"# m\n{ 'lensmodel': 'LENSMODEL_OPENCV4', 'intrinsics': [ 500., 510, "
                                      "319.5, 239.5, -1.e-1, .01, 1e-3, -2E-3,],\n'extrinsics': "
                                      "[ 0.1, 0, 1.5, 1, 2, 3,],\n 'imagersize': [ 640, 480,],}\n",
                                      ("{\"icam\":3,'nested':[[1,(2,),{'a':None,'b':[True,False]}],[]],'o':b'"
                                       "a\\'b{[' b'more#x',r'k':r'x','t':'''two\nlines''',"
                                       "'lensmodel':'LENSMODEL_PINHOLE','intrinsics':(1,1,1,1),'rt_cam_ref':("
                                       "0,0,0,0,0,0),'imagersize':[4,3]} # end"),
                                      "{'lensmodel':'LENSMODEL_OPENCV8','intrinsics':[1,1,1,1,0,0,0,0,0,0,0,"
                                      "0],'extrinsics':[0,0,0,0,0,0],'imagersize':[4,3]}"};
  if (i == 3) return splined_seed(buf, cap);
  if (i == 4) {
    static const char kb4[] =
        "{'lensmodel':'LENSMODEL_KB4','intrinsics':[300,300,320,240,0.01,-0.02,0.003,0],"
        "'extrinsics':[0,0.1,0,0,0,0],'imagersize':[640,480]}";
    return memcpy(buf, kb4, sizeof kb4 - 1), sizeof kb4 - 1;
  }
  if (i >= 3 || strlen(texts[i]) > cap) return 0;
  return memcpy(buf, texts[i], strlen(texts[i])), strlen(texts[i]);
}

// Pixels to rays and back, and points to pixels: numbers, or a refusal.
static void use(const sv_camera_model *m) {
  for (int i = 0; i < 9; i++) {
    const double uv[2] = {m->width_px * (i % 3) * 0.5, m->height_px * (i / 3) * 0.5};
    const double x[3] = {i % 3 - 1.0, i / 3 - 1.0, 0.5 + 0.1 * i};
    double ray[3], at[2];
    if (sv_model_unproject(m, uv, ray)) {
      FUZZ_CHECK(fabs(sv_norm3(ray) - 1) < 1e-6);
      if (sv_model_project(m, ray, at, NULL, NULL)) FUZZ_CHECK(isfinite(at[0]) && isfinite(at[1]));
    }
    if (sv_model_project(m, x, at, NULL, NULL)) FUZZ_CHECK(isfinite(at[0]) && isfinite(at[1]));
  }
}

static void read_splined(const uint8_t *data, size_t bytes) {
  static _Alignas(64) uint8_t block[64 << 10];
  static char text[64 << 10];
  sv_arena a = sv_arena_make(block, sizeof block);
  sv_camera_model m;
  sv_pose p;
  sv_err err;
  if (sv_cameramodel_read_splined(&(sv_file_data){"f", data, bytes}, &a, &m, &p, &err) != SV_OK) return;
  use(&m);
  sv_str s = sv_str_make(text, sizeof text);
  if (m.kind != SV_MODEL_SPLINED || m.spline.nx * m.spline.ny > 1000) return;
  FUZZ_CHECK(sv_cameramodel_write(&s, &m, &p) == SV_OK);
  sv_arena b = sv_arena_make(block + sizeof block / 2, sizeof block / 2);
  FUZZ_CHECK(sv_cameramodel_read_splined(&(sv_file_data){"g", text, s.len}, &b, &m, &p, &err) == SV_OK);
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t bytes) {
  sv_camera_model m, m2;
  sv_pose p, p2;
  sv_err err;
  char text[2048];
  read_splined(data, bytes);
  if (sv_cameramodel_read(&(sv_file_data){"f", data, bytes}, &m, &p, &err) != SV_OK) return 0;
  FUZZ_CHECK(m.p[0] > 0 && m.width_px > 0 && sv_rotation_error(p.r) < 1e-9);
  sv_str s = sv_str_make(text, sizeof text);
  // what was accepted can be written, and read again
  FUZZ_CHECK(sv_cameramodel_write(&s, &m, &p) == SV_OK);
  FUZZ_CHECK(sv_cameramodel_read(&(sv_file_data){"g", text, s.len}, &m2, &p2, &err) == SV_OK);
  FUZZ_CHECK(m2.kind == m.kind && m2.width_px == m.width_px && m2.height_px == m.height_px);
  for (int i = 0; i < 9; i++) FUZZ_CHECK(fabs(p.r[i] - p2.r[i]) < 1e-9);
  return 0;
}
