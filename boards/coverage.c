// SPDX-License-Identifier: Apache-2.0
// Coverage pictures beside rig.json: the share of each pixel that a lens lights
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

static sv_status decode(const png_file *file, const sv_footprint *f, uint8_t *dst, sv_arena *arena,
                        sv_err *err) {
  const char *path = file->path;
  sv_codec_info info;
  sv_codec codec;
  sv_err why;
  sv_status s = sv_codec_probe(file->data, file->bytes, &info, &why);
  if (s < 0) return sv_fail(err, s, "%s: %s", path, why.text);
  if (info.width_px != f->width_px || info.height_px != f->height_px)
    return sv_fail(err, SV_E_FORMAT, "%s: %dx%d pixels, its footprint in rig.json has %dx%d", path,
                   info.width_px, info.height_px, f->width_px, f->height_px);
  sv_codec_cfg cc = {.max_width_px = f->width_px, .max_height_px = f->height_px, .has_progressive = true};
  s = sv_codec_init(&codec, &cc, arena);
  if (s < 0) return sv_fail(err, s, "%s: no room to decode %dx%d pixels", path, f->width_px, f->height_px);
  sv_picture out = {f->width_px, f->height_px, (size_t)f->width_px, SV_PIX_GREY8, dst};
  s = sv_codec_decode(&codec, file->data, file->bytes, &out, &why);
  sv_codec_close(&codec);
  return s < 0 ? sv_fail(err, s, "%s: %s", path, why.text) : SV_OK;
}

static sv_status read_one(const sv_file_reader *files, const char *dir, const char *name, sv_footprint *f,
                          sv_arena *arena, sv_err *err) {
  char path[2 * SV_CAPTURE_CAP_PATH];
  sv_fmt(path, sizeof path, "%s/%s", dir, name);
  const size_t n_px = (size_t)f->width_px * (size_t)f->height_px;
  uint8_t *coverage = SV_TAKE(arena, uint8_t, n_px);
  size_t mark = sv_arena_mark(arena), cap = 8 * n_px + HEADER_BYTES, bytes = 0; // up to 16-bit RGBA
  uint8_t *file = SV_TAKE(arena, uint8_t, cap);
  if (!coverage || !file)
    return sv_fail(err, arena->status, "%s: no room for %dx%d pixels", path, f->width_px, f->height_px);
  sv_status s = files->read(files->self, name, file, cap, &bytes, err);
  if (s >= 0) s = decode(&(png_file){path, file, bytes}, f, coverage, arena, err);
  sv_arena_reset(arena, mark);
  f->coverage = s < 0 ? NULL : coverage;
  return s;
}

sv_status coverage_read(sv_rig *rig, const sv_coverage_names *names, const sv_file_reader *files,
                        const char *dir, sv_arena *arena, sv_err *err) {
  sv_status s = SV_OK;
  for (int i = 0; s >= 0 && i < rig->n_sub_views; i++)
    if (*names->name[i]) s = read_one(files, dir, names->name[i], &rig->sub_views[i].footprint, arena, err);
  return s;
}

// --- writing -------------------------------------------------------------------------------------

static sv_status write_one(const sv_store *st, const char *name, const sv_footprint *f, sv_arena *arena,
                           sv_err *err) {
  sv_codec codec;
  sv_codec_cfg cc = {.max_width_px = f->width_px, .max_height_px = f->height_px};
  size_t mark = sv_arena_mark(arena), bytes, cap = sv_codec_png_cap(f->width_px, f->height_px, SV_PIX_GREY8);
  uint8_t *file = SV_TAKE(arena, uint8_t, cap);
  sv_status s = sv_codec_init(&codec, &cc, arena);
  if (s < 0 || !file) {
    if (s >= 0) sv_codec_close(&codec);
    sv_arena_reset(arena, mark);
    return sv_fail(err, SV_E_NOMEM, "%s: no room to encode %dx%d pixels", name, f->width_px, f->height_px);
  }
  sv_picture in = {f->width_px, f->height_px, (size_t)f->width_px, SV_PIX_GREY8,
                   (uint8_t *)(uintptr_t)f->coverage};
  s = sv_codec_encode_png(&codec, &in, file, cap, &bytes, err);
  sv_codec_close(&codec);
  if (s >= 0) s = st->begin(st->self, name, err);
  if (s >= 0) s = st->write(st->self, file, bytes, err);
  if (s >= 0) s = st->commit(st->self, err);
  sv_arena_reset(arena, mark);
  return s;
}

sv_status coverage_write(const sv_rig *rig, sv_coverage_names *names, const sv_store *st, sv_arena *arena,
                         sv_err *err) {
  sv_status s = SV_OK;
  memset(names, 0, sizeof *names);
  for (int i = 0; s >= 0 && i < rig->n_sub_views; i++) {
    if (!rig->sub_views[i].footprint.coverage) continue;
    sv_fmt(names->name[i], sizeof names->name[i], "%s.coverage.png", rig->sub_views[i].name);
    s = write_one(st, names->name[i], &rig->sub_views[i].footprint, arena, err);
  }
  return s;
}
