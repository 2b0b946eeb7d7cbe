// SPDX-License-Identifier: Apache-2.0
#include <math.h>
#include <string.h>

#include "src/format/cameramodel.h"
#include "tests/fuzz/fuzz.h"

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
  if (i >= 3 || strlen(texts[i]) > cap) return 0;
  return memcpy(buf, texts[i], strlen(texts[i])), strlen(texts[i]);
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t bytes) {
  sv_camera_model m, m2;
  sv_pose p, p2;
  sv_err err;
  char text[2048];
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
