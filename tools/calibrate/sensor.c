// SPDX-License-Identifier: Apache-2.0
// What calibrated images show of their sensor: a capture folder tells what its cameras reported.
#include <stdlib.h>
#include <string.h>

#include "platform/replay/capture.h"
#include "tools/calibrate/calibrate.h"

#define ARENA_BYTES ((size_t)256 << 20) // of a long capture; only what is used takes memory

// Cuts the last part off a path and returns it; NULL: there is none.
static char *cut(char *path) {
  char *slash = strrchr(path, '/');
  if (!slash) return NULL;
  *slash = 0;
  return slash + 1;
}

static bool look_up(const sv_capture *c, const char *folder, const int size_px[2], sv_sensor_area *out) {
  for (int i = 0; i < c->n_cameras; i++) {
    const sv_camera_caps *k = &c->cameras[i].caps;
    if (strcmp(c->cameras[i].folder, folder) || k->width_px != size_px[0] || k->height_px != size_px[1])
      continue;
    *out = k->area;
    return out->sensor_width_px > 0;
  }
  return false;
}

bool cal_sensor_area(const char *picture, const int size_px[2], sv_sensor_area *out) {
  char path[SV_CAP_PATH], file[SV_CAP_PATH];
  sv_err err;
  sv_capture capture;
  if (!sv_copy(path, sizeof path, picture) || !cut(path)) return false;
  const char *folder = cut(path);
  if (!folder || sv_path_join(file, sizeof file, path, "capture.json", &err) < 0 || !sv_path_exists(file))
    return false;
  void *block = malloc(ARENA_BYTES);
  if (!block) return false;
  sv_arena arena = sv_arena_make(block, ARENA_BYTES);
  const bool is_found =
      sv_capture_load(&capture, path, &arena, &err) >= 0 && look_up(&capture, folder, size_px, out);
  free(block);
  return is_found;
}
