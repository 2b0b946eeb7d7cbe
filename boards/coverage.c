// SPDX-License-Identifier: Apache-2.0
// Pictures beside rig.json: coverage, the share of each pixel that a lens lights, and masks
// (src/format/rig_file.h).
#include <string.h>

#include "boards/board_main.h"
#include "platform/codec/codec.h"

#define HEADER_BYTES ((size_t)64 << 10) // room for more than pixels in a file

// --- reading -------------------------------------------------------------------------------------

typedef struct {
  const char *path; // for messages
  const uint8_t *data;
  size_t bytes;
} png_file;

typedef struct {
  int width_px, height_px;
  const char *of; // whose size that is
} picture_size;

static sv_status decode(const png_file *file, const picture_size *z, uint8_t *dst, sv_arena *arena,
                        sv_err *err) {
  const char *path = file->path;
  sv_codec_info info;
  sv_codec codec;
  sv_err why;
  sv_status s = sv_codec_probe(file->data, file->bytes, &info, &why);
  if (s < 0) return sv_fail(err, s, "%s: %s", path, why.text);
  if (info.width_px != z->width_px || info.height_px != z->height_px)
    return sv_fail(err, SV_E_FORMAT, "%s: %dx%d pixels, its %s in rig.json has %dx%d", path, info.width_px,
                   info.height_px, z->of, z->width_px, z->height_px);
  sv_codec_cfg cc = {.max_width_px = z->width_px, .max_height_px = z->height_px, .has_progressive = true};
  s = sv_codec_init(&codec, &cc, arena);
  if (s < 0) return sv_fail(err, s, "%s: no room to decode %dx%d pixels", path, z->width_px, z->height_px);
  sv_picture out = {z->width_px, z->height_px, (size_t)z->width_px, SV_PIX_GREY8, dst};
  s = sv_codec_decode(&codec, file->data, file->bytes, &out, &why);
  sv_codec_close(&codec);
  return s < 0 ? sv_fail(err, s, "%s: %s", path, why.text) : SV_OK;
}

typedef struct {
  const sv_file_reader *files;
  const char *dir; // for messages
  sv_arena *arena;
} reader;

// NULL after a failure.
static const uint8_t *read_one(const reader *r, const char *name, const picture_size *z, sv_err *err) {
  char path[2 * SV_CAPTURE_CAP_PATH];
  sv_fmt(path, sizeof path, "%s/%s", r->dir, name);
  const size_t n_px = (size_t)z->width_px * (size_t)z->height_px;
  uint8_t *px = SV_TAKE(r->arena, uint8_t, n_px);
  // up to 16-bit RGBA
  size_t mark = sv_arena_mark(r->arena), cap = 8 * n_px + HEADER_BYTES, bytes = 0;
  uint8_t *file = SV_TAKE(r->arena, uint8_t, cap);
  if (!px || !file) {
    sv_fail(err, r->arena->status, "%s: no room for %dx%d pixels", path, z->width_px, z->height_px);
    return NULL;
  }
  sv_status s = r->files->read(r->files->self, name, file, cap, &bytes, err);
  if (s >= 0) s = decode(&(png_file){path, file, bytes}, z, px, r->arena, err);
  sv_arena_reset(r->arena, mark);
  return s < 0 ? NULL : px;
}

sv_status coverage_read(sv_rig *rig, const sv_coverage_names *names, const sv_file_reader *files,
                        const char *dir, sv_arena *arena, sv_err *err) {
  const reader r = {files, dir, arena};
  for (int i = 0; i < rig->n_sub_views; i++) {
    sv_sub_view *v = &rig->sub_views[i];
    const picture_size footprint = {v->footprint.width_px, v->footprint.height_px, "footprint"},
                       image = {v->model.width_px, v->model.height_px, "sub-view"};
    v->footprint.coverage = *names->name[i] ? read_one(&r, names->name[i], &footprint, err) : NULL;
    if (*names->name[i] && !v->footprint.coverage) return err->status;
    v->mask = *names->mask[i] ? read_one(&r, names->mask[i], &image, err) : NULL;
    if (*names->mask[i] && !v->mask) return err->status;
  }
  return SV_OK;
}

// --- writing -------------------------------------------------------------------------------------

static sv_status write_one(const sv_store *st, const char *name, const sv_picture *in, sv_arena *arena,
                           sv_err *err) {
  sv_codec codec;
  sv_codec_cfg cc = {.max_width_px = in->width_px, .max_height_px = in->height_px};
  size_t mark = sv_arena_mark(arena), bytes,
         cap = sv_codec_png_cap(in->width_px, in->height_px, SV_PIX_GREY8);
  uint8_t *file = SV_TAKE(arena, uint8_t, cap);
  sv_status s = sv_codec_init(&codec, &cc, arena);
  if (s < 0 || !file) {
    if (s >= 0) sv_codec_close(&codec);
    sv_arena_reset(arena, mark);
    return sv_fail(err, SV_E_NOMEM, "%s: no room to encode %dx%d pixels", name, in->width_px, in->height_px);
  }
  s = sv_codec_encode_png(&codec, in, file, cap, &bytes, err);
  sv_codec_close(&codec);
  if (s >= 0) s = st->begin(st->self, name, err);
  if (s >= 0) s = st->write(st->self, file, bytes, err);
  if (s >= 0) s = st->commit(st->self, err);
  sv_arena_reset(arena, mark);
  return s;
}

static sv_picture grey(const uint8_t *px, int width_px, int height_px) {
  return (sv_picture){width_px, height_px, (size_t)width_px, SV_PIX_GREY8, (uint8_t *)(uintptr_t)px};
}

sv_status coverage_write(const sv_rig *rig, sv_coverage_names *names, const sv_store *st, sv_arena *arena,
                         sv_err *err) {
  sv_status s = SV_OK;
  memset(names, 0, sizeof *names);
  for (int i = 0; s >= 0 && i < rig->n_sub_views; i++) {
    const sv_sub_view *v = &rig->sub_views[i];
    const sv_footprint *f = &v->footprint;
    const sv_picture coverage = grey(f->coverage, f->width_px, f->height_px),
                     mask = grey(v->mask, v->model.width_px, v->model.height_px);
    if (f->coverage) {
      sv_fmt(names->name[i], sizeof names->name[i], "%s.coverage.png", v->name);
      s = write_one(st, names->name[i], &coverage, arena, err);
    }
    if (s >= 0 && v->mask) {
      sv_fmt(names->mask[i], sizeof names->mask[i], "%s.mask.png", v->name);
      s = write_one(st, names->mask[i], &mask, arena, err);
    }
  }
  return s;
}
