// SPDX-License-Identifier: Apache-2.0
// Writes OpenEXR files of one channel of floats as Blender does ("BW", 32 bits, ZIP), for tests.
// Owns nothing; needs the library that reads them.
#ifndef SV_TESTS_COMMON_EXR_WRITE_H
#define SV_TESTS_COMMON_EXR_WRITE_H

#ifdef __cplusplus
extern "C" {
#endif

// values: [height][width]. Fails the test when it cannot be written; does nothing in builds without
// the library (lab_has_exr).
typedef struct {
  const char *channel;
  int width_px, height_px;
  const float *values;
} exr_image;
void exr_write(const char *path, const exr_image *image);

#ifdef __cplusplus
}
#endif
#endif
