// SPDX-License-Identifier: Apache-2.0
#include "src/format/history.h"

#include <string.h>

#include "src/format/sequence_block.h"

#define N_ROWS SV_SEQUENCE_N_MOVED

// The base model of the file: transparent, at the origin. Keyframes are coded against it.
#define BASE_LOGIT       (-16.0f)
#define BASE_BLOCK_BYTES 16   // of such a model, at most on average over the rows
#define FILE_BYTES       1024 // of a file's head and ends, more than enough

static float base_value(const void *self, uint32_t i, int row) {
  (void)self;
  (void)i;
  return row == 3 ? 1.0f : row == 10 ? BASE_LOGIT : 0.0f;
}

static sv_sequence_head head_of(const sv_history *h) {
  const int n = h->n_frames;
  return (sv_sequence_head){.n = (uint32_t)h->cfg.n,
                            .n_moving = (uint32_t)h->cfg.n,
                            .n_frames = (uint32_t)(n < 2 ? 2 : n),
                            .group = n < SV_SEQUENCE_GROUP ? (uint32_t)(n < 2 ? 2 : n) : SV_SEQUENCE_GROUP,
                            .sh_degree = 0,
                            .seconds = (float)sv_ns_to_s(sv_history_span_ns(h)),
                            .radius = h->cfg.radius};
}

static size_t ring_bytes(const sv_history_cfg *cfg) {
  return (size_t)cfg->cap_frames * (size_t)cfg->n * SV_HISTORY_GAUSSIAN_BYTES;
}

void sv_history_carve(sv_history *h, const sv_history_cfg *cfg, sv_arena *arena) {
  *h = (sv_history){.cfg = *cfg};
  if (cfg->n < 1) return;
  h->cap_bytes = ring_bytes(cfg);
  h->ring = SV_TAKE(arena, uint8_t, h->cap_bytes);
  // Its pages come now, not while the run goes on.
  if (h->ring) memset(h->ring, 0, h->cap_bytes);
  h->frame = SV_TAKE(arena, sv_history_frame, cfg->cap_frames);
  for (int k = 0; k < 3; k++) h->value[k] = SV_TAKE(arena, int32_t, (size_t)N_ROWS * (size_t)cfg->n);
}

void sv_history_clear(sv_history *h) { h->i_first = h->n_frames = h->in_group = 0; }

static sv_history_frame *frame_at(const sv_history *h, int k) {
  return &h->frame[(h->i_first + k) % h->cfg.cap_frames];
}

sv_ns sv_history_time_ns(const sv_history *h, int k) { return frame_at(h, k)->time_ns; }

sv_ns sv_history_span_ns(const sv_history *h) {
  return h->n_frames < 2 ? 0 : sv_history_time_ns(h, h->n_frames - 1) - sv_history_time_ns(h, 0);
}

// --- the ring ------------------------------------------------------------------------------------

// The oldest group goes; when it is the newest one, too, the next frame begins another.
static void drop_group(sv_history *h) {
  const int n = h->n_frames < SV_SEQUENCE_GROUP ? h->n_frames : SV_SEQUENCE_GROUP;
  h->i_first = (h->i_first + n) % h->cfg.cap_frames;
  h->n_frames -= n;
  if (h->n_frames == 0) h->in_group = 0;
}

static void drop_old(sv_history *h, sv_ns now_ns) {
  while (h->cfg.span_ns > 0 && h->n_frames > SV_SEQUENCE_GROUP &&
         now_ns - sv_history_time_ns(h, SV_SEQUENCE_GROUP) > h->cfg.span_ns)
    drop_group(h);
}

// A block of the next frame's row, against the base model or the frames before it.
static void choose(const sv_history *h, int row, uint32_t i0, int32_t base, sv_sequence_block *b) {
  const uint32_t n = (uint32_t)h->cfg.n, left = n - i0 < SV_SEQUENCE_BLOCK ? n - i0 : SV_SEQUENCE_BLOCK;
  const int k_frame = h->in_group % SV_SEQUENCE_GROUP; // in its group
  const size_t at = (size_t)row * n + i0;
  int32_t before[SV_SEQUENCE_BLOCK] = {0}, earlier[SV_SEQUENCE_BLOCK] = {0};
  memset(b->value, 0, sizeof b->value);
  for (uint32_t k = 0; k < left; k++) {
    b->value[k] = h->value[2][at + k];
    before[k] = k_frame ? h->value[0][at + k] : base;
    if (k_frame > 1) earlier[k] = h->value[1][at + k];
  }
  sv_sequence_choose(b, before, k_frame > 1 ? earlier : NULL);
}

// The next frame as bytes; 0: they do not fit.
static size_t encode(const sv_history *h, uint8_t *out, size_t cap) {
  const sv_sequence_head head = head_of(h);
  uint8_t packed[SV_SEQUENCE_BLOCK_MAX_BYTES];
  sv_sequence_block b;
  size_t bytes = 0;
  for (int row = 0; row < N_ROWS; row++) {
    const int32_t base = sv_sequence_quantized(&head, base_value, NULL, 0, row);
    for (uint32_t i = 0; i < head.n; i += SV_SEQUENCE_BLOCK) {
      choose(h, row, i, base, &b);
      const size_t size = sv_sequence_pack(&b, packed);
      if (size > cap - bytes) return 0;
      memcpy(out + bytes, packed, size);
      bytes += size;
    }
  }
  return bytes;
}

// Into the free bytes behind the newest frame, else into those at the start of the ring. 0: neither
// has room.
static size_t encode_somewhere(const sv_history *h, size_t *at) {
  *at = 0;
  if (h->n_frames == 0) return encode(h, h->ring, h->cap_bytes);
  const sv_history_frame *oldest = frame_at(h, 0), *newest = frame_at(h, h->n_frames - 1);
  const size_t end = newest->at + newest->bytes;
  const bool is_wrapped = oldest->at > newest->at;
  const size_t bytes = encode(h, h->ring + end, (is_wrapped ? oldest->at : h->cap_bytes) - end);
  if (bytes) *at = end;
  return bytes || is_wrapped ? bytes : encode(h, h->ring, oldest->at);
}

static sv_status put(sv_history *h, sv_ns time_ns) {
  size_t at, bytes;
  drop_old(h, time_ns);
  if (h->n_frames == h->cfg.cap_frames) drop_group(h);
  while (!(bytes = encode_somewhere(h, &at)) && h->n_frames > 0) drop_group(h);
  if (!bytes) {
    h->n_lost++;
    return SV_E_FULL;
  }
  h->n_frames++;
  *frame_at(h, h->n_frames - 1) = (sv_history_frame){.at = at, .bytes = bytes, .time_ns = time_ns};
  h->in_group = h->in_group % SV_SEQUENCE_GROUP + 1;
  h->n_added++;
  int32_t *oldest = h->value[1];
  h->value[1] = h->value[0];
  h->value[0] = h->value[2];
  h->value[2] = oldest;
  return SV_OK;
}

sv_status sv_history_add(sv_history *h, sv_ns time_ns, float (*get)(const void *self, uint32_t i, int row),
                         const void *self) {
  const sv_sequence_head head = head_of(h);
  if (h->cfg.n < 1) return SV_E_NOT_FOUND;
  int32_t *value = h->value[2];
  for (int row = 0; row < N_ROWS; row++)
    for (uint32_t i = 0; i < head.n; i++) *value++ = sv_sequence_quantized(&head, get, self, i, row);
  return put(h, time_ns);
}

sv_status sv_history_repeat(sv_history *h, sv_ns time_ns) {
  if (h->cfg.n < 1 || h->n_frames < 1) return SV_E_NOT_FOUND;
  memcpy(h->value[2], h->value[0], (size_t)N_ROWS * (size_t)h->cfg.n * sizeof(int32_t));
  return put(h, time_ns);
}

size_t sv_history_used_bytes(const sv_history *h) {
  size_t bytes = 0;
  for (int k = 0; k < h->n_frames; k++) bytes += frame_at(h, k)->bytes;
  return bytes;
}

// --- the file ------------------------------------------------------------------------------------

size_t sv_history_state_bytes(const sv_history_cfg *cfg) {
  return SV_SEQUENCE_INDEX_BYTES * (size_t)cfg->cap_frames;
}

size_t sv_history_cap_file_bytes(const sv_history_cfg *cfg) {
  const size_t n_blocks = ((size_t)cfg->n + SV_SEQUENCE_BLOCK - 1) / SV_SEQUENCE_BLOCK;
  if (cfg->n < 1) return 0;
  return ring_bytes(cfg) + (size_t)cfg->cap_frames * (SV_SEQUENCE_INDEX_BYTES + SV_SECTIONS_BYTES(8)) +
         N_ROWS * n_blocks * BASE_BLOCK_BYTES + FILE_BYTES;
}

sv_status sv_history_write(const sv_history *h, const sv_sequence_head *head, void *state, sv_sink sink,
                           sv_err *err) {
  const sv_sequence_source source = {NULL, base_value, NULL};
  sv_sequence_head full = head_of(h);
  sv_sequence_writer w;
  if (h->n_frames < 2) return sv_fail(err, SV_E_NOT_FOUND, "the history has %d frames yet", h->n_frames);
  full.is_mip = head->is_mip;
  full.unit = head->unit;
  full.dilation_px2 = head->dilation_px2;
  memcpy(full.centre, head->centre, sizeof full.centre);
  memcpy(full.up, head->up, sizeof full.up);
  sv_status s = sv_sequence_begin_coded(&w, &full, &source, state, sink, err);
  for (int k = 0; k < h->n_frames && s == SV_OK; k++)
    s = sv_sequence_put_coded(&w, h->ring + frame_at(h, k)->at, frame_at(h, k)->bytes, err);
  return s == SV_OK ? sv_sequence_end(&w, err) : s;
}
