// SPDX-License-Identifier: Apache-2.0
// Masks of images: black pixels are ignored, as in nerfstudio's mask_path.
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "tools/dataset/dataset.h"

static bool join_if_there(char *out, size_t cap, const char *folder, const char *name) {
  return sv_path_join(out, cap, folder, name, NULL) == SV_OK && sv_path_exists(out);
}

static bool is_outside(const char *path) { return path[0] == '/' || strncmp(path, "../", 3) == 0; }

// A mask below the folder for an image's path, which may lack its extension.
static bool find_in(char *out, size_t cap, const char *folder, const char *image) {
  char name[SV_TRANSFORMS_CAP_PATH + 8];
  const int n_stem = (int)(strlen(image) - strlen(sv_path_extension(image)));
  for (const char *from = image; from; from = (from = strchr(from, '/')) ? from + 1 : NULL) {
    const int n = n_stem - (int)(from - image);
    if (is_outside(from)) continue; // that would be the image
    if (join_if_there(out, cap, folder, from) && sv_path_extension(image)[0]) return true;
    snprintf(name, sizeof name, "%.*s.png", n, from);
    if (join_if_there(out, cap, folder, name)) return true;
    snprintf(name, sizeof name, "%s.png", from);
    if (join_if_there(out, cap, folder, name)) return true;
  }
  return false;
}

static sv_status check_size(const lab_frame *f, sv_err *err) {
  lab_peek peek;
  sv_status s = lab_picture_peek(f->mask_path, &peek, err);
  if (s != SV_OK || (peek.width_px == f->f.model.width_px && peek.height_px == f->f.model.height_px))
    return s;
  return sv_fail(err, SV_E_FORMAT, "%s: the mask is %dx%d, its image %dx%d pixels", f->mask_path,
                 peek.width_px, peek.height_px, f->f.model.width_px, f->f.model.height_px);
}

sv_status lab_mask_find(lab_frame *f, const lab_source *src, const char *folder, sv_err *err) {
  if (f->i_measurement >= 0 && (src->masks || *f->f.mask_path))
    return sv_fail(err, SV_E_UNSUPPORTED,
                   "%s: a mask of an image that shares its sensor with others; masks are for images of "
                   "their own",
                   f->f.file_path);
  if (src->masks && !sv_path_is_folder(src->masks))
    return sv_fail(err, SV_E_NOT_FOUND, "%s: no such folder; expected the masks of the images", src->masks);
  if (src->masks && find_in(f->mask_path, sizeof f->mask_path, src->masks, f->f.file_path))
    return check_size(f, err);
  *f->mask_path = 0;
  if (src->masks && src->has_all_masks)
    return sv_fail(err, SV_E_NOT_FOUND, "%s: no mask for the image %s", src->masks, f->f.file_path);
  if (!*f->f.mask_path) return SV_OK;
  sv_status s = sv_path_join(f->mask_path, sizeof f->mask_path, folder, f->f.mask_path, err);
  if (s == SV_OK && !sv_path_exists(f->mask_path))
    s = sv_fail(err, SV_E_NOT_FOUND, "%s: mask not found (listed in the transforms file)", f->mask_path);
  return s == SV_OK ? check_size(f, err) : s;
}

typedef struct {
  const lab_frame *f;
  const uint8_t *px; // NULL: all of the file
  int width_px;
  const sv_remap *map; // NULL: the view is the file
} mask_source;

static bool counts(const mask_source *m, int x, int y) {
  if (!sv_lens_view_is_lit(&m->f->lens, x + 0.5, y + 0.5)) return false;
  return m->map ? sv_remap_counts(m->map, m->px, x, y)
                : !m->px || m->px[(size_t)y * (size_t)m->width_px + (size_t)x] != 0;
}

sv_status lab_mask_load(lab_loader *l, const lab_frame *f, int scale, uint8_t *dst, sv_err *err) {
  sv_bitmap b = {0};
  const bool has_file = *f->mask_path != 0;
  sv_status s = has_file ? sv_bitmap_read(f->mask_path, &b, err) : SV_OK;
  if (s != SV_OK) return s;
  if (has_file && (b.width_px != f->f.model.width_px || b.height_px != f->f.model.height_px))
    s = sv_fail(err, SV_E_FORMAT, "%s: the mask changed while it was read", f->mask_path);
  if (s == SV_OK && has_file) s = sv_bitmap_to_8(&b, err);
  if (s == SV_OK && has_file) s = sv_bitmap_to_channels(&b, 1, err);
  if (s == SV_OK && f->lens.is_remapped) s = lab_undistort_map(l, f, err);
  const mask_source m = {f, b.u8, b.width_px, f->lens.is_remapped ? &l->map : NULL};
  for (int y = 0; s == SV_OK && y < f->view.height_px; y++)
    for (int x = 0; x < f->view.width_px; x++) {
      bool is_in = true;
      for (int i = 0; i < scale * scale && is_in; i++)
        is_in = counts(&m, x * scale + i % scale, y * scale + i / scale);
      *dst++ = is_in;
    }
  sv_bitmap_free(&b);
  return s;
}
