// SPDX-License-Identifier: Apache-2.0
// The live view's side of the frames, on whatever thread takes them.
#include "src/preview/preview.h"

#include <string.h>

#define TILE_PERIOD_S  0.12
#define TILES_PERIOD_S 0.06
#define VIEW_PERIOD_S  0.2
#define COUNT_PERIOD_S 0.2

static double machine_s(const sv_preview *l) {
  const sv_clock *c = &l->cfg.port->machine;
  return sv_ns_to_s(c->now_ns(c->self));
}

// The ledger as the capture side has it now, for the other side: the half that is not shown is
// filled, then shown. A reader is done long before the next turn.
static void copy_counts(sv_preview *l, double now) {
  if (now < l->next_counts_s) return;
  l->next_counts_s = now + COUNT_PERIOD_S;
  int i = 1 - atomic_load(&l->i_counts);
  for (int c = 0; c < l->cfg.n_cameras && c < SV_FEED_CAP_CAMERAS; c++)
    l->counts[i].ledger[c] = *sv_sync_ledger(&l->cfg.queue->sync, c);
  l->counts[i].skew = l->cfg.queue->sync.skew;
  atomic_store(&l->i_counts, i);
}

const sv_ledger *sv_preview_ledger(const sv_preview *l, int i_camera) {
  if (!l->cfg.capture->has_worker) return sv_sync_ledger(&l->cfg.queue->sync, i_camera);
  return &l->counts[l->i_counts].ledger[i_camera];
}

const sv_skew_stats *sv_preview_skew(const sv_preview *l) {
  return l->cfg.capture->has_worker ? &l->counts[l->i_counts].skew : &l->cfg.queue->sync.skew;
}

// --- thumbnails ----------------------------------------------------------------------------------

static void publish_tile(sv_preview *l, int i, int w, int h, double now) {
  l->cameras[i].next_tile_s = now + TILE_PERIOD_S;
  l->tiles->tile[i].width_px = w;
  l->tiles->tile[i].height_px = h;
  l->cameras[i].n_tiles = ++l->tiles->tile[i].n;
  // A camera's first tile is shown at once; later ones go with the next one.
  if (now < l->next_tiles_s && l->tiles->tile[i].n > 1) return;
  l->next_tiles_s = now + TILES_PERIOD_S;
  size_t bytes = offsetof(sv_feed_tiles, rgb) + (size_t)l->tiles->n * sizeof l->tiles->rgb[0];
  memcpy(sv_feed_begin(l->feed, SV_FEED_TILES), l->tiles, bytes);
  sv_feed_commit(l->feed, SV_FEED_TILES, bytes);
}

// --- a camera in full view -----------------------------------------------------------------------

static bool is_view_due(const sv_preview *l, int i, double now) {
  return i < SV_FEED_CAP_TILES && (l->looked_at >> i & 1) && now >= l->cameras[i].next_view_s;
}

static void show_view(sv_preview *l, const sv_frame *f, double now) {
  if (!is_view_due(l, f->i_camera, now)) return;
  sv_feed_view *v = sv_feed_begin(l->feed, SV_FEED_VIEW);
  int w, h;
  l->cameras[f->i_camera].next_view_s = now + VIEW_PERIOD_S;
  if (!sv_preview_thumbnail(f, SV_FEED_CAP_VIEW_W, SV_FEED_CAP_VIEW_H, (uint8_t *)(v + 1), &w, &h)) return;
  *v = (sv_feed_view){.i_camera = f->i_camera, .width_px = w, .height_px = h};
  sv_feed_commit(l->feed, SV_FEED_VIEW, sizeof *v + 3 * (size_t)w * (size_t)h);
}

// --- frames --------------------------------------------------------------------------------------

void sv_preview_frame(sv_preview *l, const sv_frame *f) {
  if (!l->feed || f->i_camera < 0 || f->i_camera >= l->cfg.n_cameras) return;
  sv_preview_camera *c = &l->cameras[f->i_camera];
  sv_camera_stat_frame(&c->stat, f);
  c->fps = sv_camera_stat_fps(&c->stat);
  double now = machine_s(l);
  copy_counts(l, now);
  if (l->is_coded || f->i_camera >= l->tiles->n || f->is_error) return;
  show_view(l, f, now);
  if (now < c->next_tile_s) return;
  int w, h;
  if (sv_preview_thumbnail(f, SV_FEED_TILE_W, SV_FEED_TILE_H, l->tiles->rgb[f->i_camera], &w, &h))
    publish_tile(l, f->i_camera, w, h, now);
}

void sv_preview_decoded(sv_preview *l, int i_camera, const sv_image_u8 *image) {
  if (!l->feed || !l->is_coded) return;
  sv_frame f = {.i_camera = i_camera,
                .width_px = image->width_px,
                .height_px = image->height_px,
                .stride_bytes = image->stride_bytes,
                .format = SV_PIX_RGB8,
                .data = image->px};
  double now = machine_s(l);
  int w, h;
  if (i_camera >= l->tiles->n) return;
  show_view(l, &f, now);
  if (now < l->cameras[i_camera].next_tile_s) return;
  if (sv_preview_thumbnail(&f, SV_FEED_TILE_W, SV_FEED_TILE_H, l->tiles->rgb[i_camera], &w, &h))
    publish_tile(l, i_camera, w, h, now);
}

// The newest exposure's pictures, for cameras whose frames are compressed.
void sv_preview_exposure(sv_preview *l) {
  const sv_exposures *e = l->cfg.exposures;
  if (!l->feed || !l->is_coded || !e->sub || e->n < 1) return;
  int slot = (e->i_next + e->cfg.cap_exposures - 1) % e->cfg.cap_exposures;
  for (int i = 0; i < l->cfg.rig->n_sub_views; i++) {
    sv_image_u8 image;
    sv_view view;
    sv_exposures_get(e, slot, i, &image, &view);
    sv_preview_decoded(l, l->cfg.rig->sub_views[i].i_camera, &image);
  }
}

// While nothing is captured yet; the converter is free then.
void sv_preview_decode(sv_preview *l, const sv_frame *f) {
  sv_image_u8 image;
  sv_err err;
  if (!l->is_coded || f->i_camera >= l->tiles->n) return;
  const double now = machine_s(l);
  if (now < l->cameras[f->i_camera].next_tile_s && !is_view_due(l, f->i_camera, now)) return;
  if (sv_convert_frame(&l->cfg.exposures->convert, f, l->cfg.k, &l->cfg.port->pool, &image, &err) >= 0)
    sv_preview_decoded(l, f->i_camera, &image);
  sv_convert_forget(&l->cfg.exposures->convert);
}
