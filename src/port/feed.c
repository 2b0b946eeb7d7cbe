// SPDX-License-Identifier: Apache-2.0
#include "src/port/feed.h"

#include <string.h>

#define ALIGN   64u
#define N_TRIES 8

static uint64_t padded(uint64_t n) { return (n + ALIGN - 1) / ALIGN * ALIGN; }

// One or two slots for channels that are large and rare, four for small and frequent ones.
static uint64_t payload(sv_feed_channel c, uint32_t cap_gaussians, uint32_t cap_floats, size_t history_bytes,
                        uint64_t *n_slots) {
  *n_slots = 4;
  switch (c) {
  case SV_FEED_STATE: return sizeof(sv_feed_state);
  case SV_FEED_TILES: return sizeof(sv_feed_tiles);
  case SV_FEED_MODEL:
    *n_slots = 2;
    return sizeof(sv_feed_model) + sizeof(float) * (uint64_t)cap_gaussians * cap_floats;
  case SV_FEED_PICTURE:
    *n_slots = 2;
    return sizeof(sv_feed_picture) + 3u * SV_FEED_CAP_PICTURE_W * SV_FEED_CAP_PICTURE_H;
  case SV_FEED_VIEW: return sizeof(sv_feed_view) + 3u * SV_FEED_CAP_VIEW_W * SV_FEED_CAP_VIEW_H;
  case SV_FEED_MODES: return sizeof(sv_feed_modes);
  case SV_FEED_HISTORY: *n_slots = 1; return history_bytes;
  case SV_FEED_CURVE: return sizeof(sv_feed_curve);
  case SV_FEED_CALIBRATION: return sizeof(sv_feed_calibration);
  default: return sizeof(sv_feed_events);
  }
}

// Fills the header's rings (NULL: only counts) and returns the size of the block.
static uint64_t lay_out(sv_feed_header *h, uint32_t cap_gaussians, uint32_t cap_floats,
                        size_t history_bytes) {
  uint64_t at = padded(sizeof *h);
  for (int c = 0; c < SV_FEED_N_CHANNELS; c++) {
    uint64_t n, bytes = padded(payload((sv_feed_channel)c, cap_gaussians, cap_floats, history_bytes, &n));
    if (h) {
      h->ring[c].at = at;
      h->ring[c].slot_bytes = bytes;
      h->ring[c].n_slots = n;
    }
    at += n * (sizeof(sv_feed_slot) + bytes);
  }
  return at;
}

size_t sv_feed_bytes(uint32_t cap_gaussians, uint32_t cap_floats, size_t history_bytes) {
  return (size_t)lay_out(NULL, cap_gaussians, cap_floats, history_bytes);
}

sv_status sv_feed_init(sv_feed *f, void *block, size_t bytes, uint32_t cap_gaussians, uint32_t cap_floats,
                       size_t history_bytes) {
  if (bytes < sv_feed_bytes(cap_gaussians, cap_floats, history_bytes)) return SV_E_NOMEM;
  memset(f, 0, sizeof *f);
  f->header = block;
  (void)lay_out(f->header, cap_gaussians, cap_floats, history_bytes);
  f->header->bytes = bytes;
  f->header->command_fd = -1;
  f->header->version = SV_FEED_VERSION;
  f->header->magic = SV_FEED_MAGIC;
  return SV_OK;
}

static sv_feed_slot *slot_of(const sv_feed *f, sv_feed_channel c, uint64_t k) {
  const sv_feed_ring *r = &f->header->ring[c];
  return (sv_feed_slot *)((uint8_t *)f->header + r->at +
                          (k % r->n_slots) * (sizeof(sv_feed_slot) + r->slot_bytes));
}

size_t sv_feed_cap(const sv_feed *f, sv_feed_channel c) { return (size_t)f->header->ring[c].slot_bytes; }
uint64_t sv_feed_seq(const sv_feed *f, sv_feed_channel c) { return f->next[c]; }

void *sv_feed_begin(sv_feed *f, sv_feed_channel c) {
  sv_feed_slot *s = slot_of(f, c, f->next[c] + 1);
  atomic_store_explicit(&s->seq, 2 * (f->next[c] + 1) + 1, memory_order_relaxed);
  // readers must see that the slot is open before they see it change
  atomic_thread_fence(memory_order_release);
  return s + 1;
}

void sv_feed_commit(sv_feed *f, sv_feed_channel c, size_t bytes) {
  uint64_t k = ++f->next[c];
  sv_feed_slot *s = slot_of(f, c, k);
  s->bytes = bytes;
  atomic_store_explicit(&s->seq, 2 * k + 2, memory_order_release);
  atomic_store_explicit(&f->header->ring[c].head, k, memory_order_release);
}

// --- reader --------------------------------------------------------------------------------------

sv_status sv_feed_attach(sv_feed_reader *r, const void *block, size_t bytes, sv_err *err) {
  memset(r, 0, sizeof *r);
  const sv_feed_header *h = block;
  if (bytes < sizeof *h || h->magic != SV_FEED_MAGIC)
    return sv_fail(err, SV_E_FORMAT, "feed: not a block published by subview");
  if (h->version != SV_FEED_VERSION)
    return sv_fail(err, SV_E_UNSUPPORTED, "feed: version %u, but this program reads version %u", h->version,
                   SV_FEED_VERSION);
  for (int c = 0; c < SV_FEED_N_CHANNELS; c++) {
    uint64_t at = h->ring[c].at, slot = h->ring[c].slot_bytes, n = h->ring[c].n_slots;
    bool is_inside = at % ALIGN == 0 && slot % ALIGN == 0 && at <= bytes && slot <= bytes && n >= 1 &&
                     n <= 64 && n * (sizeof(sv_feed_slot) + slot) <= bytes - at;
    if (!is_inside) return sv_fail(err, SV_E_FORMAT, "feed: channel %d lies outside of the block", c);
    r->ring[c].at = at;
    r->ring[c].slot_bytes = slot;
    r->ring[c].n_slots = n;
  }
  r->header = h;
  return SV_OK;
}

// Reading an atomic of a read-only mapping: the qualifier is on the view, not on the object.
static uint64_t load(const _Atomic uint64_t *p) {
  return atomic_load_explicit((_Atomic uint64_t *)(uintptr_t)p, memory_order_acquire);
}

uint64_t sv_feed_newest(const sv_feed_reader *r, sv_feed_channel c) { return load(&r->header->ring[c].head); }

sv_status sv_feed_read(const sv_feed_reader *r, sv_feed_channel c, uint64_t *seq, void *buf, size_t cap,
                       size_t *bytes) {
  const sv_feed_ring *ring = &r->ring[c];
  for (int i = 0; i < N_TRIES; i++) {
    uint64_t k = sv_feed_newest(r, c);
    if (k == 0 || k == *seq) return SV_AGAIN;
    const sv_feed_slot *s =
        (const sv_feed_slot *)((const uint8_t *)r->header + ring->at +
                               (k % ring->n_slots) * (sizeof(sv_feed_slot) + ring->slot_bytes));
    if (load(&s->seq) != 2 * k + 2) continue;
    uint64_t n = s->bytes;
    if (n > ring->slot_bytes) continue;
    if (n > cap) return SV_E_NOMEM;
    *seq = 0; // what was in buf is gone
    memcpy(buf, s + 1, (size_t)n);
    atomic_thread_fence(memory_order_acquire);
    if (load(&s->seq) != 2 * k + 2) continue;
    *seq = k;
    *bytes = (size_t)n;
    return SV_OK;
  }
  return SV_AGAIN;
}
