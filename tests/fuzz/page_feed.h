// SPDX-License-Identifier: Apache-2.0
// C only: the feed is.
// A feed of a small run for the page's fuzz targets, and the server's source over it.
#ifndef SV_TESTS_FUZZ_PAGE_FEED_H
#define SV_TESTS_FUZZ_PAGE_FEED_H

#include <string.h>

#include "platform/preview/preview.h"
#include "src/format/gaussian.h"
#include "tests/fuzz/fuzz.h"

#define PAGE_N        8
#define PAGE_FLOATS   SV_GAUSSIAN_N_FLOATS(1)
#define PAGE_CAP_FEED (24u << 20)

static _Alignas(64) uint8_t page_block[PAGE_CAP_FEED];
static size_t page_bytes;
static pv_source page_source;

static void page_fill(sv_feed *f) {
  sv_feed_state *s = sv_feed_begin(f, SV_FEED_STATE);
  *s = (sv_feed_state){.status = SV_FEED_STATUS_TRAINING,
                       .n_cameras = 2,
                       .n_reasons = 1,
                       .n_parts = 1,
                       .step = 7,
                       .steps = 100,
                       .temperature_c = 40};
  strcpy(s->source, "sim:textured");
  strcpy(s->cameras[0].name, "left");
  sv_feed_commit(f, SV_FEED_STATE, sizeof *s);
  sv_feed_tiles *t = sv_feed_begin(f, SV_FEED_TILES);
  t->n = 2;
  for (int i = 0; i < 2; i++) {
    t->tile[i].width_px = 16;
    t->tile[i].height_px = 12;
    t->tile[i].n = 1;
  }
  sv_feed_commit(f, SV_FEED_TILES, sizeof *t);
  sv_feed_model *m = sv_feed_begin(f, SV_FEED_MODEL);
  *m = (sv_feed_model){
      .n = PAGE_N, .sh_degree = 1, .n_floats = PAGE_FLOATS, .step = 7, .radius = 1, .fov_y = 1, .n_eyes = 2};
  float *rows = (float *)(void *)(m + 1);
  for (int i = 0; i < PAGE_N * PAGE_FLOATS; i++) rows[i] = (float)(i % 7) * 0.1f;
  sv_feed_commit(f, SV_FEED_MODEL, sizeof *m + sizeof(float) * PAGE_N * PAGE_FLOATS);
  sv_feed_picture *p = sv_feed_begin(f, SV_FEED_PICTURE);
  *p = (sv_feed_picture){.width_px = 32, .height_px = 12, .step = 7};
  sv_feed_commit(f, SV_FEED_PICTURE, sizeof *p + 32 * 12 * 3);
  sv_feed_view *v = sv_feed_begin(f, SV_FEED_VIEW);
  *v = (sv_feed_view){.i_camera = 1, .width_px = 32, .height_px = 24};
  sv_feed_commit(f, SV_FEED_VIEW, sizeof *v + 32 * 24 * 3);
  sv_feed_curve *c = sv_feed_begin(f, SV_FEED_CURVE);
  c->n = 2;
  c->stride = 1;
  sv_feed_commit(f, SV_FEED_CURVE, sizeof *c);
  sv_feed_events *e = sv_feed_begin(f, SV_FEED_EVENTS);
  e->n_total = 1;
  strcpy(e->event[0].text, "hello");
  sv_feed_commit(f, SV_FEED_EVENTS, sizeof *e);
}

static void page_make(void) {
  sv_err err;
  sv_feed f;
  if (page_bytes) return;
  page_bytes = sv_feed_bytes(PAGE_N, PAGE_FLOATS, 0);
  FUZZ_CHECK(page_bytes <= sizeof page_block);
  FUZZ_CHECK(sv_feed_init(&f, page_block, page_bytes, PAGE_N, PAGE_FLOATS, 0) == SV_OK);
  page_fill(&f);
  page_source.scans = (pv_scans){.place = {"", ""}, .fd = -1};
  FUZZ_CHECK(sv_feed_attach(&page_source.reader, page_block, page_bytes, &err) == SV_OK);
  FUZZ_CHECK(pv_pictures_open(&page_source, &err) == SV_OK && pv_model_open(&page_source, &err) == SV_OK);
}

#endif
