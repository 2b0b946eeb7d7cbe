// SPDX-License-Identifier: Apache-2.0
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "tools/common/fileio.h"
#include "tools/import/spatial.h"

#define CAP_MOOV     ((uint64_t)256 << 20)
#define CAP_BOXES    1000000 // at the top of a file
#define SAMPLE_ENTRY 78      // bytes of a VisualSampleEntry before its boxes

typedef struct {
  const char *name; // of the file
  const uint8_t *p, *end;
  sv_err *err;
} span;

typedef struct {
  char type[5];
  span in; // its content
} box;

static uint32_t u32(const uint8_t *p) {
  return (uint32_t)p[0] << 24 | (uint32_t)p[1] << 16 | (uint32_t)p[2] << 8 | p[3];
}

static uint64_t u64(const uint8_t *p) { return (uint64_t)u32(p) << 32 | u32(p + 4); }

// The next box of a span, which then begins behind it. SV_END at the span's end. The terminator of
// old QuickTime files, four zero bytes, ends it, too.
static sv_status next(span *s, box *b) {
  const size_t left = (size_t)(s->end - s->p);
  if (left == 0 || (left == 4 && u32(s->p) == 0)) return SV_END;
  uint64_t size = left >= 8 ? u32(s->p) : 0;
  size_t head = 8;
  if (left >= 16 && size == 1) {
    size = u64(s->p + 8);
    head = 16;
  } else if (left >= 8 && size == 0) size = left; // to the end
  if (left < 8 || size < head || size > left)
    return sv_fail(s->err, SV_E_FORMAT, "%s: a box of its head does not fit into the one around it", s->name);
  memcpy(b->type, s->p + 4, 4);
  b->type[4] = 0;
  b->in = (span){s->name, s->p + head, s->p + size, s->err};
  s->p += size;
  return SV_OK;
}

static bool is(const box *b, const char *type) { return memcmp(b->type, type, 4) == 0; }

// Skips version and flags, or more, of a box.
static sv_status skip(span *s, size_t bytes, const char *type) {
  if ((size_t)(s->end - s->p) < bytes)
    return sv_fail(s->err, SV_E_FORMAT, "%s: its box %s is too short", s->name, type);
  s->p += bytes;
  return SV_OK;
}

// The 32-bit number of a full box, or of a box without version and flags.
static sv_status number(const box *b, bool is_full, uint32_t *out) {
  span in = b->in;
  sv_status s = skip(&in, is_full ? 4 : 0, b->type);
  if (s == SV_OK) s = skip(&in, 4, b->type);
  if (s == SV_OK) *out = u32(in.p - 4);
  return s;
}

// --- vexu ----------------------------------------------------------------------------------------

static sv_status take_field(lab_spatial_track *t, const box *b) {
  uint32_t v = 0;
  sv_status s = SV_OK;
  if (is(b, "stri")) { // eye flags, in one byte behind version and flags
    span in = b->in;
    s = skip(&in, 5, b->type);
    if (s != SV_OK) return s;
    const uint8_t eyes = in.p[-1];
    t->has_left = eyes & 1;
    t->has_right = eyes & 2;
    t->is_reversed = eyes & 8;
  } else if (is(b, "blin")) { // micrometers
    s = number(b, true, &v);
    t->baseline_m = v * 1e-6;
  } else if (is(b, "prji")) {
    s = number(b, true, &v);
    t->is_rectilinear = v == u32((const uint8_t *)"rect");
  } else if (is(b, "pkin")) {
    s = number(b, true, &v);
    t->packing = v == u32((const uint8_t *)"side")   ? LAB_PACKING_SIDE
                 : v == u32((const uint8_t *)"over") ? LAB_PACKING_OVER
                                                     : LAB_PACKING_NONE;
  }
  return s;
}

// vexu holds eyes, proj and pack; eyes holds cams. One level below each other.
static sv_status walk_eyes(lab_spatial_track *t, span in, int depth) {
  box b;
  sv_status s;
  while ((s = next(&in, &b)) == SV_OK) {
    const bool is_holder = is(&b, "eyes") || is(&b, "cams") || is(&b, "proj") || is(&b, "pack");
    if (is_holder && depth < 2) s = walk_eyes(t, b.in, depth + 1);
    else s = take_field(t, &b);
    if (s != SV_OK) return s;
  }
  return s == SV_END ? SV_OK : s;
}

static sv_status walk_entry(lab_spatial_track *t, span in) {
  box b;
  sv_status s = skip(&in, SAMPLE_ENTRY, "stsd");
  if (s != SV_OK) return s;
  while ((s = next(&in, &b)) == SV_OK) {
    uint32_t v = 0;
    if (is(&b, "lhvC")) t->is_layered = true;
    if (is(&b, "vexu")) s = walk_eyes(t, b.in, 0);
    if (is(&b, "hfov")) s = number(&b, false, &v);
    if (v > 0 && v < 180000) t->fov_rad = v * 1e-3 * 0.017453292519943295;
    if (s != SV_OK) return s;
  }
  return s == SV_END ? SV_OK : s;
}

// --- down to the sample entry --------------------------------------------------------------------

static sv_status walk_track(lab_spatial_track *t, bool *is_video, span in, int depth) {
  box b;
  sv_status s;
  while ((s = next(&in, &b)) == SV_OK) {
    if (is(&b, "hdlr") && depth == 1) {
      span h = b.in;
      s = skip(&h, 12, "hdlr");
      if (s == SV_OK && memcmp(h.p - 4, "vide", 4) == 0) *is_video = true;
    } else if (is(&b, "stsd") && depth == 3 && *is_video) {
      s = skip(&b.in, 8, "stsd");
      box entry;
      if (s == SV_OK) s = next(&b.in, &entry);
      if (s == SV_OK) s = walk_entry(t, entry.in);
      if (s == SV_END) s = SV_OK; // no entry
    } else if (depth < 3 && (is(&b, "mdia") || is(&b, "minf") || is(&b, "stbl")))
      s = walk_track(t, is_video, b.in, depth + 1);
    if (s != SV_OK) return s;
  }
  return s == SV_END ? SV_OK : s;
}

sv_status lab_spatial_parse(lab_spatial *out, const sv_file_data *moov, sv_err *err) {
  const uint8_t *p = moov->data;
  span in = {moov->name, p, p + moov->bytes, err};
  box b;
  sv_status s;
  memset(out, 0, sizeof *out);
  while ((s = next(&in, &b)) == SV_OK) {
    lab_spatial_track t = {.is_rectilinear = true};
    bool is_video = false;
    if (!is(&b, "trak")) continue;
    if ((s = walk_track(&t, &is_video, b.in, 0)) != SV_OK) return s;
    if (is_video && out->n < LAB_SPATIAL_CAP_TRACKS) out->tracks[out->n++] = t;
  }
  return s == SV_END ? SV_OK : s;
}

// --- of a file -----------------------------------------------------------------------------------

// Where the content of moov stands. Media may be gigabytes and is skipped.
static sv_status find_moov(FILE *f, const char *path, uint64_t *bytes, sv_err *err) {
  uint8_t head[16];
  for (int i = 0; i < CAP_BOXES; i++) {
    if (fread(head, 1, 8, f) != 8) break;
    uint64_t size = u32(head), skipped = 8;
    if (size == 1) {
      if (fread(head + 8, 1, 8, f) != 8) break;
      size = u64(head + 8);
      skipped = 16;
    }
    if (size < skipped || size - skipped > INT64_MAX) break; // 0: it goes on to the end
    *bytes = size - skipped;
    if (memcmp(head + 4, "moov", 4) == 0) return SV_OK;
    if (fseeko(f, (off_t)*bytes, SEEK_CUR) != 0) break;
  }
  return sv_fail(err, SV_E_FORMAT, "%s: no MP4 or QuickTime file: it has no box moov", path);
}

sv_status lab_spatial_read(lab_spatial *out, const char *path, sv_err *err) {
  int fd;
  size_t all;
  uint64_t bytes = 0;
  sv_status s = sv_file_open(path, &fd, &all, err);
  if (s != SV_OK) return s;
  FILE *f = fdopen(fd, "rb");
  s = f ? find_moov(f, path, &bytes, err) : sv_fail(err, SV_E_IO, "%s: cannot be read", path);
  if (s == SV_OK && (bytes > all || bytes > CAP_MOOV))
    s = sv_fail(err, SV_E_FORMAT, "%s: its box moov is larger than the file or 256 MB", path);
  uint8_t *data = s == SV_OK ? malloc(bytes + 1) : NULL;
  if (s == SV_OK && !data) s = sv_fail(err, SV_E_NOMEM, "%s: no memory for its head", path);
  if (s == SV_OK && fread(data, 1, bytes, f) != bytes) s = sv_fail(err, SV_E_IO, "%s: cannot be read", path);
  const sv_file_data moov = {path, data, bytes};
  if (s == SV_OK) s = lab_spatial_parse(out, &moov, err);
  free(data);
  if (f) fclose(f);
  return s;
}
