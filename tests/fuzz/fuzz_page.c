// SPDX-License-Identifier: Apache-2.0
// C only: the feed is.
// What the page's server makes of a feed whose writer is not to be trusted. The input is a list of
// changes to a good one: channel (u8; from 7 on: the header), place (u24), length (u8), bytes.
#include "tests/fuzz/page_feed.h"

#define CAP_CHANGES 64
#define CAP_JSON    (48u << 10)

typedef struct {
  size_t at, n;
  uint8_t was[255];
} change;

size_t fuzz_seed(int i, uint8_t *buf, size_t cap) {
  static const uint8_t seeds[][9] = {{0, 0, 0, 0, 4, 6, 0, 0, 0},   {1, 0, 0, 0, 4, 16, 0, 0, 0},
                                     {2, 4, 0, 0, 4, 3, 0, 0, 0},   {3, 0, 0, 0, 4, 0, 5, 0, 0},
                                     {4, 0, 0, 0, 4, 255, 1, 0, 0}, {5, 0, 0, 0, 4, 255, 0, 0, 0},
                                     {9, 24, 0, 0, 4, 0, 1, 0, 0}};
  if (i > 6 || cap < 9) return 0;
  memcpy(buf, seeds[i], 9);
  return 9;
}

// Start of the newest slot of a channel in the good feed, its head included; the header from the
// last channel on.
static size_t place_of(int channel) {
  static size_t places[SV_FEED_N_CHANNELS];
  const sv_feed_header *h = (const sv_feed_header *)(const void *)page_block;
  for (int i = 0; i < SV_FEED_N_CHANNELS && !places[SV_FEED_N_CHANNELS - 1]; i++) {
    const sv_feed_ring *r = &h->ring[i];
    places[i] = (size_t)(r->at + r->head % r->n_slots * (sizeof(sv_feed_slot) + r->slot_bytes));
  }
  return channel < SV_FEED_N_CHANNELS ? places[channel] : 0;
}

static void look(void) {
  static char json[CAP_JSON];
  sv_err err;
  sv_feed_reader reader;
  pv_source *s = &page_source;
  if (sv_feed_attach(&reader, page_block, page_bytes, &err) != SV_OK) return;
  s->reader = reader;
  s->state_seq = s->tiles_seq = s->model_seq = s->picture_seq = s->view_seq = 0;
  (void)pv_state_read(s);
  static void (*const fill[])(const pv_source *, sv_str *) = {pv_state_json, pv_curve_json, pv_events_json,
                                                              pv_calibration_json};
  for (int i = 0; i < 4; i++) {
    sv_str o = sv_str_make(json, sizeof json);
    fill[i](s, &o);
    FUZZ_CHECK(o.len < sizeof json);
  }
  (void)pv_mosaic_read(s);
  (void)pv_picture_jpeg(s);
  for (int k = 0; k < SV_FEED_CAP_TILES; k++) (void)pv_camera_jpeg(s, k);
  (void)pv_model_compact(s);
  for (int k = 0; k < PV_N_FILES; k++) (void)pv_model_file(s, (pv_file)k);
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t bytes) {
  static change changes[CAP_CHANGES];
  int n = 0;
  page_make();
  (void)place_of(0); // of the feed before it is changed
  for (size_t i = 0; i + 5 <= bytes && n < CAP_CHANGES; n++) {
    change *c = &changes[n];
    c->n = data[i + 4];
    c->at = place_of(data[i]) + data[i + 1] + 256u * data[i + 2] + 65536u * data[i + 3];
    i += 5;
    if (c->n > bytes - i) c->n = bytes - i;
    if (c->at + c->n > page_bytes) c->n = 0;
    memcpy(c->was, page_block + c->at % page_bytes, c->n);
    memcpy(page_block + c->at % page_bytes, data + i, c->n);
    i += c->n;
  }
  look();
  while (n-- > 0) memcpy(page_block + changes[n].at % page_bytes, changes[n].was, changes[n].n);
  look(); // and the good one again
  return 0;
}
