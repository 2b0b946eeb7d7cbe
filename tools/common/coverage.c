// SPDX-License-Identifier: Apache-2.0
#include "tools/common/coverage.h"

#include <stdlib.h>

#include "tools/common/fileio.h"
#include "tools/common/imageio.h"

typedef struct {
  int width_px, height_px;
  const char *of; // whose size that is
} picture_size;

// malloc'ed into *out; NULL after a failure.
static sv_status load_one(const char *folder, const char *name, const picture_size *z, const uint8_t **out,
                          sv_err *err) {
  char path[SV_CAP_PATH];
  sv_bitmap b;
  *out = NULL;
  sv_status s = sv_path_join(path, sizeof path, folder, name, err);
  if (s == SV_OK) s = sv_bitmap_read(path, &b, err);
  if (s != SV_OK) return s;
  s = sv_bitmap_to_channels(&b, 1, err);
  if (s == SV_OK) s = sv_bitmap_to_8(&b, err);
  if (s == SV_OK && (b.width_px != z->width_px || b.height_px != z->height_px))
    s = sv_fail(err, SV_E_FORMAT, "%s: %dx%d pixels, its %s in rig.json has %dx%d", path, b.width_px,
                b.height_px, z->of, z->width_px, z->height_px);
  if (s == SV_OK) {
    *out = b.u8;
    b.u8 = NULL;
  }
  sv_bitmap_free(&b);
  return s;
}

sv_status sv_coverage_load(const char *folder, sv_rig *rig, const sv_coverage_names *names, sv_err *err) {
  sv_status s = SV_OK;
  for (int i = 0; i < rig->n_sub_views; i++) {
    rig->sub_views[i].footprint.coverage = NULL;
    rig->sub_views[i].mask = NULL;
  }
  for (int i = 0; i < rig->n_sub_views && s == SV_OK; i++) {
    sv_sub_view *v = &rig->sub_views[i];
    const picture_size footprint = {v->footprint.width_px, v->footprint.height_px, "footprint"},
                       image = {v->model.width_px, v->model.height_px, "sub-view"};
    if (*names->name[i]) s = load_one(folder, names->name[i], &footprint, &v->footprint.coverage, err);
    if (s == SV_OK && *names->mask[i]) s = load_one(folder, names->mask[i], &image, &v->mask, err);
  }
  if (s != SV_OK) sv_coverage_free(rig);
  return s;
}

void sv_coverage_free(sv_rig *rig) {
  for (int i = 0; i < rig->n_sub_views; i++) {
    free((void *)(uintptr_t)rig->sub_views[i].footprint.coverage);
    free((void *)(uintptr_t)rig->sub_views[i].mask);
    rig->sub_views[i].footprint.coverage = NULL;
    rig->sub_views[i].mask = NULL;
  }
}

sv_status sv_coverage_save(const char *folder, const char *name, const sv_footprint *f, sv_err *err) {
  char path[SV_CAP_PATH];
  sv_bitmap b = {.width_px = f->width_px,
                 .height_px = f->height_px,
                 .n_channels = 1,
                 .bits = 8,
                 .u8 = (uint8_t *)(uintptr_t)f->coverage};
  sv_status s = sv_path_join(path, sizeof path, folder, name, err);
  return s == SV_OK ? sv_bitmap_write_png(path, &b, err) : s;
}
