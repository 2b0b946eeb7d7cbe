// SPDX-License-Identifier: Apache-2.0
// Thumbnails and the device's rendering as JPEG.
#include <stdlib.h>
#include <string.h>

#include "platform/codec/codec.h"
#include "platform/preview/preview.h"

#define QUALITY 80

// All thumbnails in one picture, so that a page needs one connection for all cameras.
enum { CAP_COLUMNS = 4, CAP_W = CAP_COLUMNS * SV_FEED_TILE_W, CAP_H = CAP_COLUMNS * SV_FEED_TILE_H };

typedef struct {
  sv_codec codec;
  uint8_t *block, *canvas, *jpeg;
  size_t cap_jpeg;
} pictures;

sv_status pv_pictures_open(pv_source *s, sv_err *err) {
  static pictures p;
  sv_codec_cfg cfg = {.max_width_px = SV_FEED_CAP_PICTURE_W, .max_height_px = CAP_H};
  size_t bytes = sv_codec_bytes(&cfg) + 2 * SV_ARENA_ALIGN;
  p.block = malloc(bytes);
  p.canvas = malloc(3u * CAP_W * CAP_H);
  p.cap_jpeg = 3u * SV_FEED_CAP_PICTURE_W * CAP_H + 4096;
  p.jpeg = malloc(p.cap_jpeg);
  s->tiles = calloc(1, sizeof *s->tiles);
  s->picture_cap = sizeof(sv_feed_picture) + 3u * SV_FEED_CAP_PICTURE_W * SV_FEED_CAP_PICTURE_H;
  s->picture = malloc(s->picture_cap);
  s->view_cap = sizeof(sv_feed_view) + 3u * SV_FEED_CAP_VIEW_W * SV_FEED_CAP_VIEW_H;
  s->view = malloc(s->view_cap);
  if (!p.block || !p.canvas || !p.jpeg || !s->tiles || !s->picture || !s->view)
    return sv_fail(err, SV_E_NOMEM, "no memory for images");
  sv_arena a = sv_arena_make(p.block, bytes);
  sv_status r = sv_codec_init(&p.codec, &cfg, &a);
  if (r < 0) return sv_fail(err, r, "no memory for images");
  s->codec = &p;
  return SV_OK;
}

void pv_mosaic_grid(int n, int *n_columns, int *n_rows) {
  *n_columns = n <= 1 ? 1 : n <= 4 ? 2 : n <= 9 ? 3 : CAP_COLUMNS;
  *n_rows = n <= 1 ? 1 : (n + *n_columns - 1) / *n_columns;
}

// Tile i into the middle of its cell of a canvas with so many columns.
static void put_tile(uint8_t *canvas, int n_columns, const sv_feed_tiles *tiles, int i) {
  const uint8_t *rgb = tiles->rgb[i];
  const int w = tiles->tile[i].width_px, h = tiles->tile[i].height_px, width_px = n_columns * SV_FEED_TILE_W;
  if (w < 1 || h < 1 || w > SV_FEED_TILE_W || h > SV_FEED_TILE_H) return;
  const int x0 = i % n_columns * SV_FEED_TILE_W + (SV_FEED_TILE_W - w) / 2,
            y0 = i / n_columns * SV_FEED_TILE_H + (SV_FEED_TILE_H - h) / 2;
  for (int y = 0; y < h; y++)
    memcpy(canvas + 3 * ((size_t)(y0 + y) * (size_t)width_px + (size_t)x0), rgb + 3 * (size_t)y * (size_t)w,
           3 * (size_t)w);
}

static size_t encode(pictures *p, const uint8_t *rgb, int w, int h) {
  sv_picture pic = {.width_px = w,
                    .height_px = h,
                    .stride_bytes = (size_t)w * 3,
                    .format = SV_PIX_RGB8,
                    .data = (uint8_t *)(uintptr_t)rgb};
  size_t bytes;
  sv_err err;
  return sv_codec_encode_jpeg(&p->codec, &pic, (sv_jpeg_options){QUALITY, false},
                              (sv_codec_buffer){p->jpeg, p->cap_jpeg}, &bytes, &err) < 0
             ? 0
             : bytes;
}

bool pv_mosaic_read(pv_source *s) {
  pictures *p = s->codec;
  size_t bytes;
  if (sv_feed_read(&s->reader, SV_FEED_TILES, &s->tiles_seq, s->tiles, sizeof *s->tiles, &bytes) != SV_OK)
    return false;
  int n = s->tiles->n < 0                   ? 0
          : s->tiles->n > SV_FEED_CAP_TILES ? SV_FEED_CAP_TILES
                                            : s->tiles->n,
      columns, rows;
  pv_mosaic_grid(n, &columns, &rows);
  int width_px = columns * SV_FEED_TILE_W, height_px = rows * SV_FEED_TILE_H;
  memset(p->canvas, 0, 3 * (size_t)width_px * (size_t)height_px);
  for (int i = 0; i < n; i++) put_tile(p->canvas, columns, s->tiles, i);
  bytes = encode(p, p->canvas, width_px, height_px);
  static const char next[] = "\r\n" PV_PART_HEAD;
  pv_blob *b = bytes ? pv_blob_make(bytes + sizeof next - 1, s->tiles_seq) : NULL;
  if (!b) return false;
  memcpy(b->data, p->jpeg, bytes);
  memcpy(b->data + bytes, next, sizeof next - 1);
  pv_blob_drop(s->mosaic);
  s->mosaic = b;
  return true;
}

pv_blob *pv_picture_jpeg(pv_source *s) {
  pictures *p = s->codec;
  size_t bytes;
  const sv_feed_picture *h = (const sv_feed_picture *)s->picture;
  if (sv_feed_read(&s->reader, SV_FEED_PICTURE, &s->picture_seq, s->picture, s->picture_cap, &bytes) ==
      SV_OK) {
    pv_blob_drop(s->jpeg);
    s->jpeg = NULL;
    bool is_whole = h->width_px > 0 && h->height_px > 0 && h->width_px <= SV_FEED_CAP_PICTURE_W &&
                    h->height_px <= SV_FEED_CAP_PICTURE_H &&
                    bytes == sizeof *h + 3 * (size_t)h->width_px * (size_t)h->height_px;
    size_t n = is_whole ? encode(p, (const uint8_t *)(h + 1), h->width_px, h->height_px) : 0;
    pv_blob *b = n ? pv_blob_make(n, s->picture_seq) : NULL;
    if (b) memcpy(b->data, p->jpeg, n);
    s->jpeg = b;
  }
  return s->jpeg;
}

// The feed has one view at a time, of whichever camera: each is kept until its next one.
pv_blob *pv_camera_jpeg(pv_source *s, int i) {
  pictures *p = s->codec;
  size_t bytes;
  const sv_feed_view *v = (const sv_feed_view *)s->view;
  if (sv_feed_read(&s->reader, SV_FEED_VIEW, &s->view_seq, s->view, s->view_cap, &bytes) == SV_OK) {
    const bool is_whole = v->i_camera >= 0 && v->i_camera < SV_FEED_CAP_TILES && v->width_px > 0 &&
                          v->height_px > 0 && v->width_px <= SV_FEED_CAP_VIEW_W &&
                          v->height_px <= SV_FEED_CAP_VIEW_H &&
                          bytes == sizeof *v + 3 * (size_t)v->width_px * (size_t)v->height_px;
    const size_t n = is_whole ? encode(p, (const uint8_t *)(v + 1), v->width_px, v->height_px) : 0;
    pv_blob *b = n ? pv_blob_make(n, s->view_seq) : NULL;
    if (b) {
      memcpy(b->data, p->jpeg, n);
      pv_blob_drop(s->camera[v->i_camera]);
      s->camera[v->i_camera] = b;
    }
  }
  return s->camera[i];
}
