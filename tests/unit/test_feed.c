// SPDX-License-Identifier: Apache-2.0
// The feed: layout, snapshots that are whole or not there, a reader that was overtaken, foreign
// blocks; thumbnails.
#include <pthread.h>
#include <sched.h>
#include <string.h>

#include "src/preview/preview.h"
#include "src/port/feed.h"
#include "tests/common/test.h"

#define GAUSSIANS 100
#define FLOATS    14
#define HISTORY   1000

static _Alignas(64) uint8_t block[16u << 20];
static uint8_t copy[4u << 20];

static void open_feed(sv_feed *f, sv_feed_reader *r) {
  sv_err err;
  memset(block, 0, sizeof block);
  assert_true(sv_feed_bytes(GAUSSIANS, FLOATS, HISTORY) <= sizeof block);
  assert_int_equal(sv_feed_init(f, block, 100, GAUSSIANS, FLOATS, HISTORY), SV_E_NOMEM);
  assert_int_equal(
      sv_feed_init(f, block, sv_feed_bytes(GAUSSIANS, FLOATS, HISTORY), GAUSSIANS, FLOATS, HISTORY), SV_OK);
  assert_int_equal(sv_feed_attach(r, block, sv_feed_bytes(GAUSSIANS, FLOATS, HISTORY), &err), SV_OK);
}

TEST(test_snapshots) {
  sv_feed f;
  sv_feed_reader r;
  uint64_t seq = 0;
  size_t bytes;
  open_feed(&f, &r);
  for (int c = 0; c < SV_FEED_N_CHANNELS; c++)
    assert_int_equal(sv_feed_read(&r, (sv_feed_channel)c, &seq, copy, sizeof copy, &bytes), SV_AGAIN);
  for (int k = 1; k < 20; k++) {
    memset(sv_feed_begin(&f, SV_FEED_EVENTS), k, 500);
    assert_true(sv_feed_read(&r, SV_FEED_EVENTS, &seq, copy, sizeof copy, &bytes) ==
                SV_AGAIN); // not yet there
    sv_feed_commit(&f, SV_FEED_EVENTS, 400 + (size_t)k);
    assert_int_equal(sv_feed_read(&r, SV_FEED_EVENTS, &seq, copy, 10, &bytes), SV_E_NOMEM);
    assert_int_equal(sv_feed_read(&r, SV_FEED_EVENTS, &seq, copy, sizeof copy, &bytes), SV_OK);
    assert_int_equal(seq, k);
    assert_int_equal(bytes, 400 + k);
    assert_int_equal(copy[bytes - 1], k);
    assert_int_equal(sv_feed_read(&r, SV_FEED_EVENTS, &seq, copy, sizeof copy, &bytes), SV_AGAIN);
  }
  // Begun and not committed: the older one stays.
  (void)sv_feed_begin(&f, SV_FEED_EVENTS);
  seq = 0;
  assert_int_equal(sv_feed_read(&r, SV_FEED_EVENTS, &seq, copy, sizeof copy, &bytes), SV_OK);
  assert_int_equal(copy[0], 19);
}

// A slot that is being rewritten, or that was, is not taken for whole.
TEST(test_overtaken) {
  sv_feed f;
  sv_feed_reader r;
  uint64_t seq = 0;
  size_t bytes;
  open_feed(&f, &r);
  (void)sv_feed_begin(&f, SV_FEED_MODEL);
  sv_feed_commit(&f, SV_FEED_MODEL, 64);
  sv_feed_slot *slot =
      // number 1 of a ring of two: the second slot
      (sv_feed_slot *)(block + r.ring[SV_FEED_MODEL].at + sizeof(sv_feed_slot) +
                       r.ring[SV_FEED_MODEL].slot_bytes);
  assert_int_equal(slot->seq, 4);
  slot->seq = 7; // number 3 is being written
  assert_int_equal(sv_feed_read(&r, SV_FEED_MODEL, &seq, copy, sizeof copy, &bytes), SV_AGAIN);
  slot->seq = 8;
  assert_int_equal(sv_feed_read(&r, SV_FEED_MODEL, &seq, copy, sizeof copy, &bytes), SV_AGAIN);
  slot->seq = 4;
  slot->bytes = UINT64_MAX;
  assert_int_equal(sv_feed_read(&r, SV_FEED_MODEL, &seq, copy, sizeof copy, &bytes), SV_AGAIN);
}

// A channel of one slot: while it is written nobody reads it.
TEST(test_one_slot) {
  sv_feed f;
  sv_feed_reader r;
  uint8_t got[HISTORY];
  uint64_t seq = 0;
  size_t bytes;
  open_feed(&f, &r);
  for (uint8_t i = 1; i <= 3; i++) {
    memset(sv_feed_begin(&f, SV_FEED_HISTORY), i, HISTORY);
    assert_int_equal(sv_feed_read(&r, SV_FEED_HISTORY, &seq, got, sizeof got, &bytes), SV_AGAIN);
    sv_feed_commit(&f, SV_FEED_HISTORY, HISTORY);
    assert_int_equal(sv_feed_read(&r, SV_FEED_HISTORY, &seq, got, sizeof got, &bytes), SV_OK);
    assert_true(seq == i && bytes == HISTORY && got[0] == i && got[HISTORY - 1] == i);
  }
}

TEST(test_foreign) {
  sv_feed f;
  sv_feed_reader r;
  sv_err err;
  size_t n = sv_feed_bytes(GAUSSIANS, FLOATS, HISTORY);
  open_feed(&f, &r);
  sv_feed_header *h = (sv_feed_header *)block;
  assert_int_equal(sv_feed_attach(&r, block, 20, &err), SV_E_FORMAT);
  h->version++;
  assert_int_equal(sv_feed_attach(&r, block, n, &err), SV_E_UNSUPPORTED);
  h->version--;
  h->magic++;
  assert_int_equal(sv_feed_attach(&r, block, n, &err), SV_E_FORMAT);
  h->magic--;
  uint64_t *fields[] = {&h->ring[2].at, &h->ring[2].slot_bytes, &h->ring[2].n_slots};
  static const uint64_t values[] = {1, 65, UINT64_MAX, UINT64_MAX / 2, 1u << 30};
  for (int i = 0; i < 3; i++)
    for (int k = 0; k < 5; k++) {
      uint64_t was = *fields[i];
      *fields[i] = i == 2 && k == 0 ? 0 : values[k]; // one slot is enough
      assert_int_equal(sv_feed_attach(&r, block, n, &err), SV_E_FORMAT);
      *fields[i] = was;
    }
  assert_int_equal(sv_feed_attach(&r, block, n, &err), SV_OK);
}

// A sequence lock reads while it is written, and then discards the copy.
#if !defined(__SANITIZE_THREAD__)
static _Atomic int is_over;

static void *write_on(void *arg) {
  sv_feed *f = arg;
  for (int k = 1; k <= 200000; k++) {
    uint32_t *p = sv_feed_begin(f, SV_FEED_CURVE);
    for (int i = 0; i < 1000; i++) p[i] = (uint32_t)k;
    sv_feed_commit(f, SV_FEED_CURVE, 4000);
    if (k % 100 == 0) sched_yield();
  }
  is_over = 1;
  return NULL;
}

TEST(test_torn) {
  sv_feed f;
  sv_feed_reader r;
  pthread_t t;
  uint64_t seq = 0, n_read = 0;
  open_feed(&f, &r);
  is_over = 0;
  assert_int_equal(pthread_create(&t, NULL, write_on, &f), 0);
  while (!is_over) {
    size_t bytes;
    if (sv_feed_read(&r, SV_FEED_CURVE, &seq, copy, sizeof copy, &bytes) != SV_OK) continue;
    const uint32_t *p = (const uint32_t *)(const void *)copy;
    for (int i = 0; i < 1000; i++) assert_int_equal(p[i], seq);
    n_read++;
  }
  pthread_join(t, NULL);
  print_message("%llu whole snapshots of 200000\n", (unsigned long long)n_read);
  assert_true(n_read > 0);
}
#endif

TEST(test_thumbnails) {
  static uint8_t px[640 * 480 * 4], rgb[SV_FEED_TILE_W * SV_FEED_TILE_H * 3];
  int w, h;
  for (int i = 0; i < 640 * 480; i++) {
    px[3 * i] = 200;
    px[3 * i + 1] = 100;
    px[3 * i + 2] = 50;
  }
  sv_frame f = {.width_px = 640, .height_px = 480, .stride_bytes = 1920, .format = SV_PIX_RGB8, .data = px};
  assert_true(sv_preview_thumbnail(&f, SV_FEED_TILE_W, SV_FEED_TILE_H, rgb, &w, &h));
  assert_int_equal(w, 160);
  assert_int_equal(h, 120);
  assert_int_equal(rgb[3 * 160 * 119], 200);
  f.format = SV_PIX_BGR8;
  assert_true(sv_preview_thumbnail(&f, SV_FEED_TILE_W, SV_FEED_TILE_H, rgb, &w, &h));
  assert_int_equal(rgb[0], 50);
  // red in YUYV
  for (int i = 0; i < 640 * 480; i++) {
    px[2 * i] = 81;
    px[2 * i + 1] = i % 2 ? 240 : 90;
  }
  f.format = SV_PIX_YUYV;
  f.stride_bytes = 1280;
  assert_true(sv_preview_thumbnail(&f, SV_FEED_TILE_W, SV_FEED_TILE_H, rgb, &w, &h));
  assert_true(rgb[0] > 180 && rgb[1] < 60 && rgb[2] < 60);
  f.data_bytes = 1000; // shorter than it says
  assert_false(sv_preview_thumbnail(&f, SV_FEED_TILE_W, SV_FEED_TILE_H, rgb, &w, &h));
  f.data_bytes = 0;
  f.format = SV_PIX_JPEG;
  assert_false(sv_preview_thumbnail(&f, SV_FEED_TILE_W, SV_FEED_TILE_H, rgb, &w, &h));
  memset(px, 255, sizeof px);
  for (int i = 0; i < 640 * 480; i++)
    px[i] = i / 640 % 2 == 0 && i % 2 == 0 ? 255 : 0; // only red samples are lit
  f.format = SV_PIX_RGGB8;
  f.stride_bytes = 640;
  assert_true(sv_preview_thumbnail(&f, SV_FEED_TILE_W, SV_FEED_TILE_H, rgb, &w, &h));
  assert_int_equal(rgb[0], 255);
  assert_int_equal(rgb[1], 0);
  assert_int_equal(rgb[2], 0);
}

int main(void) {
  const struct CMUnitTest tests[] = {
    cmocka_unit_test(test_snapshots),
    cmocka_unit_test(test_overtaken),
    cmocka_unit_test(test_one_slot),
    cmocka_unit_test(test_foreign),
#if !defined(__SANITIZE_THREAD__)
    cmocka_unit_test(test_torn),
#endif
    cmocka_unit_test(test_thumbnails),
  };
  return cmocka_run_group_tests(tests, NULL, NULL);
}
