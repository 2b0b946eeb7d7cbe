// SPDX-License-Identifier: Apache-2.0
#include "src/format/sequence.h"

#include <math.h>
#include <string.h>

#include "src/format/bytes.h"
#include "src/format/sequence_block.h"

#define KIND    "SEQN"
#define VERSION 1

float sv_sequence_step(const sv_sequence_head *h, int row) {
  if (row >= 11) return row < SV_SEQUENCE_N_MOVED ? 1.0f / 128 : 1.0f / 64; // SH
  if (row >= 3) return row < 7 ? 1.0f / 512 : row < 10 ? 1.0f / 32 : 1.0f / 16;
  float step = 1;
  while (step > h->radius / 8192 && step > 1e-9f) step *= 0.5f;
  while (step * 2 <= h->radius / 8192 && step < 1e9f) step *= 2;
  return step;
}

static bool is_good(const sv_sequence_head *h) {
  return h->n >= 1 && h->n <= SV_SEQUENCE_MAX_N && h->n_moving <= h->n && h->n_frames >= 2 &&
         h->n_frames <= SV_SEQUENCE_MAX_T && h->group >= 1 && h->group <= h->n_frames && h->sh_degree >= 0 &&
         h->sh_degree <= 3 && h->radius > 1e-6f && h->radius < 1e9f && h->seconds >= 0 && h->seconds < 1e6f &&
         h->unit.scale_sigma >= 0 && h->unit.scale_sigma < 1 && h->dilation_px2 >= 0 &&
         h->dilation_px2 < 1e3f;
}

// --- the head ------------------------------------------------------------------------------------

static void put_head(const sv_sequence_head *h, uint64_t base_bytes, uint8_t out[SV_SEQUENCE_HEAD_BYTES]) {
  const uint32_t words[8] = {h->n,
                             h->n_moving,
                             h->n_frames,
                             h->group,
                             (uint32_t)h->sh_degree,
                             (h->is_mip ? 1u : 0) | (h->unit.is_metric ? 2u : 0),
                             (uint32_t)base_bytes,
                             0};
  const float floats[6] = {h->dilation_px2, h->seconds, h->centre[0], h->centre[1], h->centre[2], h->radius};
  memset(out, 0, SV_SEQUENCE_HEAD_BYTES);
  for (int i = 0; i < 8; i++) sv_put_le32(out + 4 * i, words[i]);
  for (int i = 0; i < 6; i++) sv_put_lef32(out + 32 + 4 * i, floats[i]);
  sv_put_lef32(out + 28, h->unit.scale_sigma);
  memcpy(out + 56, h->up, 3);
  for (int r = 0; r < SV_GAUSSIAN_FLOATS; r++)
    sv_put_lef32(out + 64 + 4 * r, r < sv_sequence_n_rows(h) ? sv_sequence_step(h, r) : 0);
}

static sv_status get_head(sv_sequence_reader *r, sv_err *err) {
  uint8_t in[SV_SEQUENCE_HEAD_BYTES];
  sv_sequence_head *h = &r->head;
  sv_status s = sv_sections_get(&r->sections, "HEAD", in, sizeof in, err);
  if (s < 0) return s;
  const uint32_t flags = sv_le32(in + 20), degree = sv_le32(in + 16);
  *h = (sv_sequence_head){.n = sv_le32(in),
                          .n_moving = sv_le32(in + 4),
                          .n_frames = sv_le32(in + 8),
                          .group = sv_le32(in + 12),
                          .sh_degree = degree <= 3 ? (int)degree : -1,
                          .is_mip = flags & 1,
                          .unit = {.is_metric = flags >> 1 & 1, .scale_sigma = sv_lef32(in + 28)},
                          .dilation_px2 = sv_lef32(in + 32),
                          .seconds = sv_lef32(in + 36),
                          .centre = {sv_lef32(in + 40), sv_lef32(in + 44), sv_lef32(in + 48)},
                          .radius = sv_lef32(in + 52)};
  memcpy(h->up, in + 56, 3);
  if (!is_good(h)) return sv_fail(err, SV_E_FORMAT, "%s: its head is out of range", r->sections.name);
  for (int row = 0; row < sv_sequence_n_rows(h); row++)
    if (sv_lef32(in + 64 + 4 * row) != sv_sequence_step(h, row)) // of another version
      return sv_fail(err, SV_E_FORMAT, "%s: the step of row %d is unknown", r->sections.name, row);
  return SV_OK;
}

// --- writing -------------------------------------------------------------------------------------

static float unit_quaternion(float (*get)(const void *, uint32_t, int), const void *self, uint32_t i,
                             int row) {
  float q[4], n2 = 0;
  for (int k = 0; k < 4; k++) {
    q[k] = get(self, i, 3 + k);
    n2 += q[k] * q[k];
  }
  return n2 > 1e-30f ? q[row - 3] / sqrtf(n2) : (float)(row == 3);
}

int32_t sv_sequence_quantized(const sv_sequence_head *h, float (*get)(const void *self, uint32_t i, int row),
                              const void *self, uint32_t i, int row) {
  const float v = row >= 3 && row < 7 ? unit_quaternion(get, self, i, row) : get(self, i, row);
  return sv_sequence_round(v / sv_sequence_step(h, row));
}

static int32_t quantized(const sv_sequence_writer *w, float (*get)(const void *, uint32_t, int), uint32_t i,
                         int row) {
  return sv_sequence_quantized(&w->head, get, w->source.self, i, row);
}

// What a block of up to 64 values is written as, in the form with the fewest bits.
static void encode_base(const sv_sequence_writer *w, int row, uint32_t i0, sv_sequence_block *b) {
  for (uint32_t k = 0; k < SV_SEQUENCE_BLOCK; k++)
    b->value[k] = i0 + k < w->head.n ? quantized(w, w->source.base, i0 + k, row) : 0;
  sv_sequence_choose(b, NULL, NULL);
}

static bool is_keyframe(const sv_sequence_head *h, uint32_t frame) { return frame % h->group == 0; }

static void encode_moved(const sv_sequence_writer *w, int row, uint32_t i0, sv_sequence_block *b) {
  int32_t before[SV_SEQUENCE_BLOCK] = {0}, earlier[SV_SEQUENCE_BLOCK] = {0};
  const uint32_t n = w->head.n_moving, left = n - i0 < SV_SEQUENCE_BLOCK ? n - i0 : SV_SEQUENCE_BLOCK,
                 in_group = w->frame % w->head.group;
  const size_t at = (size_t)row * n + i0;
  memset(b->value, 0, sizeof b->value);
  for (uint32_t k = 0; k < left; k++) {
    b->value[k] = quantized(w, w->source.moved, i0 + k, row);
    before[k] = in_group ? w->last[0][at + k] : quantized(w, w->source.base, i0 + k, row);
    if (in_group > 1) earlier[k] = w->last[1][at + k];
  }
  sv_sequence_choose(b, before, in_group > 1 ? earlier : NULL);
}

// All blocks of a section, once to count the bytes and once to write them.
typedef void (*encode_fn)(const sv_sequence_writer *w, int row, uint32_t i0, sv_sequence_block *b);

static sv_status put_blocks(sv_sequence_writer *w, int n_rows, uint32_t n, encode_fn encode, uint64_t *bytes,
                            sv_err *err) {
  sv_sequence_block b;
  uint8_t packed[SV_SEQUENCE_BLOCK_MAX_BYTES];
  sv_status s = SV_OK;
  const bool is_counted = *bytes == 0;
  for (int row = 0; row < n_rows; row++)
    for (uint32_t i = 0; i < n && s == SV_OK; i += SV_SEQUENCE_BLOCK) {
      encode(w, row, i, &b);
      const size_t size = sv_sequence_pack(&b, packed);
      if (is_counted) *bytes += size;
      else s = sv_sections_write(&w->out, packed, size, err);
    }
  return s;
}

static sv_status put_section(sv_sequence_writer *w, const char *tag, uint64_t bytes, encode_fn encode,
                             sv_err *err) {
  const bool is_base = encode == encode_base;
  const int n_rows = is_base ? sv_sequence_n_rows(&w->head) : SV_SEQUENCE_N_MOVED;
  const uint32_t n = is_base ? w->head.n : w->head.n_moving;
  sv_status s = sv_sections_section_begin(&w->out, tag, bytes, err);
  if (s == SV_OK && bytes) s = put_blocks(w, n_rows, n, encode, &bytes, err);
  if (s == SV_OK) s = sv_sections_section_end(&w->out, err);
  w->at_bytes += SV_SECTIONS_BYTES(bytes);
  return s;
}

size_t sv_sequence_writer_bytes(const sv_sequence_head *h) {
  if (!is_good(h)) return 0;
  return SV_SEQUENCE_INDEX_BYTES * (size_t)h->n_frames +
         2 * sizeof(int32_t) * SV_SEQUENCE_N_MOVED * (size_t)h->n_moving;
}

sv_status sv_sequence_begin_coded(sv_sequence_writer *w, const sv_sequence_head *h,
                                  const sv_sequence_source *source, void *state, sv_sink sink, sv_err *err) {
  uint8_t head[SV_SEQUENCE_HEAD_BYTES];
  uint64_t bytes = 0;
  if (!is_good(h))
    return sv_fail(err, SV_E_ARG, "a sequence of %u Gaussians and %u frames cannot be written", h->n,
                   h->n_frames);
  *w = (sv_sequence_writer){.head = *h, .source = *source, .index = state};
  sv_status s = put_blocks(w, sv_sequence_n_rows(h), h->n, encode_base, &bytes, err);
  put_head(h, bytes, head);
  if (s == SV_OK) s = sv_sections_begin(&w->out, sink, KIND, VERSION, err);
  if (s == SV_OK) s = sv_sections_put(&w->out, "HEAD", head, sizeof head, err);
  w->at_bytes = SV_SECTIONS_HEADER_BYTES + SV_SECTIONS_BYTES(sizeof head);
  return s == SV_OK ? put_section(w, "BASE", bytes, encode_base, err) : s;
}

sv_status sv_sequence_begin(sv_sequence_writer *w, const sv_sequence_head *h,
                            const sv_sequence_source *source, void *state, sv_sink sink, sv_err *err) {
  sv_status s = sv_sequence_begin_coded(w, h, source, state, sink, err);
  if (s < 0) return s;
  w->last[0] = (int32_t *)(void *)(w->index + SV_SEQUENCE_INDEX_BYTES * (size_t)h->n_frames);
  w->last[1] = w->last[0] + SV_SEQUENCE_N_MOVED * (size_t)h->n_moving;
  return s;
}

static sv_status is_full(const sv_sequence_writer *w, sv_err *err) {
  return sv_fail(err, SV_E_ARG, "a sequence of %u frames has no more", w->head.n_frames);
}

// Of the next frame, which is about to be written.
static void put_index(sv_sequence_writer *w, uint64_t bytes) {
  uint8_t *entry = w->index + SV_SEQUENCE_INDEX_BYTES * (size_t)w->frame;
  sv_put_le64(entry, w->at_bytes + SV_SECTIONS_HEADER_BYTES);
  sv_put_le32(entry + 8, (uint32_t)bytes);
  sv_put_le32(entry + 12, is_keyframe(&w->head, w->frame));
}

sv_status sv_sequence_put_coded(sv_sequence_writer *w, const uint8_t *data, size_t bytes, sv_err *err) {
  if (w->frame >= w->head.n_frames) return is_full(w, err);
  put_index(w, bytes);
  w->frame++;
  w->at_bytes += SV_SECTIONS_BYTES(bytes);
  return sv_sections_put(&w->out, "FRAM", data, bytes, err);
}

sv_status sv_sequence_frame(sv_sequence_writer *w, sv_err *err) {
  uint64_t bytes = 0;
  const uint32_t n = w->head.n_moving;
  if (w->frame >= w->head.n_frames) return is_full(w, err);
  sv_status s = put_blocks(w, SV_SEQUENCE_N_MOVED, n, encode_moved, &bytes, err);
  put_index(w, bytes);
  if (s == SV_OK) s = put_section(w, "FRAM", bytes, encode_moved, err);
  int32_t *oldest = w->last[1];
  for (int row = 0; row < SV_SEQUENCE_N_MOVED; row++)
    for (uint32_t i = 0; i < n; i++) oldest[(size_t)row * n + i] = quantized(w, w->source.moved, i, row);
  w->last[1] = w->last[0];
  w->last[0] = oldest;
  w->frame++;
  return s;
}

sv_status sv_sequence_end(sv_sequence_writer *w, sv_err *err) {
  if (w->frame != w->head.n_frames)
    return sv_fail(err, SV_E_ARG, "a sequence of %u frames ends after %u", w->head.n_frames, w->frame);
  sv_status s =
      sv_sections_put(&w->out, "INDX", w->index, SV_SEQUENCE_INDEX_BYTES * (size_t)w->head.n_frames, err);
  return s == SV_OK ? sv_sections_end(&w->out, err) : s;
}

// --- reading -------------------------------------------------------------------------------------

sv_status sv_sequence_open(sv_sequence_reader *r, const sv_file_data *file, sv_err *err) {
  const void *base, *index;
  size_t index_bytes;
  *r = (sv_sequence_reader){.frame = -1};
  sv_status s = sv_sections_open(&r->sections, file, KIND, VERSION, err);
  if (s >= 0) s = get_head(r, err);
  if (s >= 0) s = sv_sections_find(&r->sections, "BASE", &base, &r->base_bytes, err);
  if (s >= 0) s = sv_sections_find(&r->sections, "INDX", &index, &index_bytes, err);
  if (s < 0) return s;
  r->base = base;
  r->index = index;
  if (index_bytes != SV_SEQUENCE_INDEX_BYTES * (size_t)r->head.n_frames)
    return sv_fail(err, SV_E_FORMAT, "%s: its index is not that of %u frames", file->name, r->head.n_frames);
  return SV_OK;
}

size_t sv_sequence_reader_bytes(const sv_sequence_head *h) {
  return sizeof(int32_t) *
         ((size_t)sv_sequence_n_rows(h) * h->n + 2 * SV_SEQUENCE_N_MOVED * (size_t)h->n_moving);
}

// One section's blocks: each is decoded into b, then `take` stores it. False: damaged.
typedef void (*take_fn)(sv_sequence_reader *r, int row, uint32_t i0, uint32_t n, const sv_sequence_block *b);

static bool get_blocks(sv_sequence_reader *r, const uint8_t *data, size_t bytes, take_fn take, int n_rows,
                       uint32_t n) {
  sv_sequence_block b;
  for (int row = 0; row < n_rows; row++)
    for (uint32_t i = 0; i < n; i += SV_SEQUENCE_BLOCK) {
      const size_t size = sv_sequence_unpack(&b, data, bytes);
      if (!size) return false;
      data += size;
      bytes -= size;
      take(r, row, i, n - i < SV_SEQUENCE_BLOCK ? n - i : SV_SEQUENCE_BLOCK, &b);
    }
  return bytes == 0;
}

static void take_base(sv_sequence_reader *r, int row, uint32_t i0, uint32_t n, const sv_sequence_block *b) {
  for (uint32_t k = 0; k < n; k++) r->value[(size_t)row * r->head.n + i0 + k] = sv_sequence_value(b, k, 0, 0);
}

static void take_moved(sv_sequence_reader *r, int row, uint32_t i0, uint32_t n, const sv_sequence_block *b) {
  const bool is_key = is_keyframe(&r->head, (uint32_t)r->frame);
  const size_t at = (size_t)row * r->head.n_moving + i0;
  const int32_t *before = is_key ? r->value + (size_t)row * r->head.n + i0 : r->last[0] + at;
  for (uint32_t k = 0; k < n; k++)
    r->last[1][at + k] = sv_sequence_value(b, k, before[k], r->last[1][at + k]);
}

sv_status sv_sequence_read_base(sv_sequence_reader *r, void *state, sv_err *err) {
  r->value = state;
  r->last[0] = r->value + (size_t)sv_sequence_n_rows(&r->head) * r->head.n;
  r->last[1] = r->last[0] + SV_SEQUENCE_N_MOVED * (size_t)r->head.n_moving;
  r->frame = -1;
  memset(r->last[0], 0, 2 * sizeof(int32_t) * SV_SEQUENCE_N_MOVED * (size_t)r->head.n_moving);
  if (get_blocks(r, r->base, r->base_bytes, take_base, sv_sequence_n_rows(&r->head), r->head.n)) return SV_OK;
  return sv_fail(err, SV_E_FORMAT, "%s: its base model is damaged", r->sections.name);
}

static sv_status read_next(sv_sequence_reader *r, sv_err *err) {
  const uint8_t *entry = r->index + SV_SEQUENCE_INDEX_BYTES * (size_t)++r->frame;
  const uint64_t at = sv_le64(entry);
  const size_t bytes = sv_le32(entry + 8);
  const bool is_inside = at <= r->sections.bytes && bytes <= r->sections.bytes - (size_t)at;
  if (!is_inside ||
      !get_blocks(r, r->sections.buf + at, bytes, take_moved, SV_SEQUENCE_N_MOVED, r->head.n_moving)) {
    const unsigned k = (unsigned)r->frame;
    r->frame = -1;
    return sv_fail(err, SV_E_FORMAT, "%s: frame %u is damaged", r->sections.name, k);
  }
  int32_t *newest = r->last[1];
  r->last[1] = r->last[0];
  r->last[0] = newest;
  return SV_OK;
}

sv_status sv_sequence_read_frame(sv_sequence_reader *r, uint32_t k, sv_err *err) {
  if (k >= r->head.n_frames)
    return sv_fail(err, SV_E_ARG, "%s: has frames 0 to %u, not %u", r->sections.name, r->head.n_frames - 1,
                   k);
  const int64_t key = (int64_t)(k - k % r->head.group);
  if (r->frame < key || r->frame > (int64_t)k) r->frame = key - 1;
  sv_status s = SV_OK;
  while (s == SV_OK && r->frame < (int64_t)k) s = read_next(r, err);
  return s;
}

void sv_sequence_get(const sv_sequence_reader *r, uint32_t i, sv_gaussian *out) {
  float *v = out->mean; // the first of the rows
  const bool is_moved = r->frame >= 0 && i < r->head.n_moving;
  memset(out, 0, sizeof *out);
  for (int row = 0; row < sv_sequence_n_rows(&r->head); row++) {
    const int32_t q = is_moved && row < SV_SEQUENCE_N_MOVED ? r->last[0][(size_t)row * r->head.n_moving + i]
                                                            : r->value[(size_t)row * r->head.n + i];
    const float x = (float)q * sv_sequence_step(&r->head, row);
    memcpy((uint8_t *)v + sizeof(float) * (size_t)row, &x, sizeof x);
  }
}
