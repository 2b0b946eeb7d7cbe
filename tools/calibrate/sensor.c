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

// A capture that holds a picture, opened in block; folder and file are the picture's places in it.
typedef struct {
  sv_capture capture;
  void *block;
  char path[SV_CAP_PATH];
  const char *folder, *file;
} home;

static bool open_home(home *h, const char *picture) {
  char json[SV_CAP_PATH];
  sv_err err;
  h->block = NULL;
  if (!sv_copy(h->path, sizeof h->path, picture)) return false;
  h->file = cut(h->path);
  h->folder = h->file ? cut(h->path) : NULL;
  if (!h->folder || sv_path_join(json, sizeof json, h->path, "capture.json", &err) < 0 ||
      !sv_path_exists(json))
    return false;
  if (!(h->block = malloc(ARENA_BYTES))) return false;
  sv_arena arena = sv_arena_make(h->block, ARENA_BYTES);
  return sv_capture_load(&h->capture, h->path, &arena, &err) >= 0;
}

// The camera of the picture; NULL: there is none.
static const sv_capture_camera *camera_of(const home *h) {
  for (int i = 0; i < h->capture.n_cameras; i++)
    if (!strcmp(h->capture.cameras[i].folder, h->folder)) return &h->capture.cameras[i];
  return NULL;
}

bool cal_sensor_area(const char *picture, const int size_px[2], sv_sensor_area *out) {
  home h;
  const sv_capture_camera *c = open_home(&h, picture) ? camera_of(&h) : NULL;
  const bool is_found = c && c->caps.width_px == size_px[0] && c->caps.height_px == size_px[1];
  if (is_found) *out = c->caps.area;
  free(h.block);
  return is_found && out->sensor_width_px > 0;
}

// 0: not told, or not alone different.
static double exposure_s(const char *picture) {
  home h;
  double s = 0;
  const sv_capture_camera *c = open_home(&h, picture) ? camera_of(&h) : NULL;
  for (int i = 0; c && c->caps.is_light_shared && i < c->n_frames; i++)
    if (!strcmp(c->frames[i].file, h.file)) s = sv_ns_to_s(c->frames[i].exposure_ns);
  free(h.block);
  return s;
}

double cal_exposure_share(const cal_boards *b, int c) {
  if (c <= 0 || c >= b->n_cameras || !b->cameras[0].n_pictures || !b->cameras[c].n_pictures) return 1;
  const double first_s = exposure_s(b->cameras[0].pictures[0].path),
               this_s = exposure_s(b->cameras[c].pictures[0].path);
  return first_s > 0 && this_s > 0 ? this_s / first_s : 1;
}
