// SPDX-License-Identifier: Apache-2.0
#include "src/preview/screen.h"

#include <string.h>

#include "src/base/mathx.h"
#include "src/base/str.h"
#include "src/preview/pictures.h"
#include "src/train/driver.h"

#define MARGIN_PX 4
#define QR_QUIET  4 // modules of white around the code

// An image of either kind, by its pixel (x, y).
typedef struct {
  int width_px, height_px;
  const uint8_t *rgb; // packed; NULL: planes
  const sv_planes *planes;
} picture;

void sv_screen_carve(sv_screen *s, sv_arena *a) { s->tiles = SV_TAKE(a, sv_feed_tiles, 1); }

void sv_screen_start(sv_screen *s, const sv_feed *feed, const sv_display *d) {
  sv_err err;
  if (!s->tiles || !d->begin) return;
  memset(s->tiles, 0, sizeof *s->tiles);
  s->tiles_seq = 0;
  s->next_s = 0;
  if (sv_feed_attach(&s->feed, feed->header, (size_t)feed->header->bytes, &err) < 0) s->tiles = NULL;
  s->has_qr = d->link && sv_qr_make(&s->qr, d->link);
}

// --- drawing -------------------------------------------------------------------------------------

static void fill(const sv_display_frame *f, sv_screen_box b, uint8_t grey) {
  for (int y = b.y0; y < b.y0 + b.height_px; y++)
    memset(f->px + (size_t)y * f->stride_bytes + 4 * (size_t)b.x0, grey, 4 * (size_t)b.width_px);
}

// The largest box of an image's shape within another, in its middle.
static sv_screen_box fit(sv_screen_box b, int width_px, int height_px) {
  sv_screen_box r = b;
  if ((int64_t)width_px * b.height_px > (int64_t)height_px * b.width_px)
    r.height_px = (int)((int64_t)b.width_px * height_px / width_px);
  else r.width_px = (int)((int64_t)b.height_px * width_px / height_px);
  r.x0 += (b.width_px - r.width_px) / 2;
  r.y0 += (b.height_px - r.height_px) / 2;
  return r;
}

// Each pixel of the box is the nearest one of the image.
static void put(const sv_display_frame *f, sv_screen_box b, const picture *p) {
  for (int y = 0; y < b.height_px; y++) {
    uint8_t *out = f->px + (size_t)(b.y0 + y) * f->stride_bytes + 4 * (size_t)b.x0;
    const int from_y = (int)((int64_t)y * p->height_px / b.height_px);
    for (int x = 0; x < b.width_px; x++, out += 4) {
      const int from_x = (int)((int64_t)x * p->width_px / b.width_px);
      uint8_t rgb[3];
      if (p->rgb) memcpy(rgb, p->rgb + 3 * ((size_t)from_y * (size_t)p->width_px + (size_t)from_x), 3);
      else sv_pictures_pixel(rgb, p->planes, from_x, from_y);
      out[0] = rgb[2];
      out[1] = rgb[1];
      out[2] = rgb[0];
    }
  }
}

// --- parts ---------------------------------------------------------------------------------------

static int text_scale(const sv_display_frame *f) { return sv_maxi(1, f->height_px / 360); }

// Cameras in a grid of so many columns.
static void put_tiles(sv_screen *s, const sv_display_frame *f, sv_screen_box area, int n_columns) {
  const sv_feed_tiles *t = s->tiles;
  const int n = sv_clampi(t->n, 0, SV_FEED_CAP_TILES), n_rows = (n + n_columns - 1) / n_columns;
  for (int i = 0; i < n; i++) {
    const int w = t->tile[i].width_px, h = t->tile[i].height_px;
    sv_screen_box cell = {.width_px = area.width_px / n_columns, .height_px = area.height_px / n_rows};
    cell.x0 = area.x0 + i % n_columns * cell.width_px;
    cell.y0 = area.y0 + i / n_columns * cell.height_px;
    cell.width_px -= MARGIN_PX;
    cell.height_px -= MARGIN_PX;
    if (w < 1 || h < 1 || cell.width_px < 8 || cell.height_px < 8) continue;
    s->tile[i] = fit(cell, w, h);
    put(f, s->tile[i], &(picture){w, h, t->rgb[i], NULL});
  }
}

static int grid_columns(int n) {
  int columns = 1;
  while (columns * columns < n) columns++;
  return columns;
}

// To and fro: 0, 1, ..., STEPS, ..., 0, -1, ..., -STEPS, ..., -1.
static double turn_at(double now_s) {
  const int n = SV_SCREEN_SWING_STEPS, i = (int)((int64_t)(now_s / SV_SCREEN_STEP_S) % (4 * n));
  const int step = i <= n ? i : i <= 3 * n ? 2 * n - i : i - 4 * n;
  return SV_SCREEN_SWING_RAD * step / n;
}

static void put_model(sv_screen *s, const sv_display_frame *f, sv_screen_box area,
                      const sv_screen_content *c) {
  const double turn_rad = turn_at(c->now_s);
  const sv_view v = sv_pictures_turned(c->t, turn_rad);
  const sv_planes *rendered;
  if (sv_driver_render(c->t, &v, &rendered) < 0) return;
  s->turn_rad = turn_rad;
  s->model = fit(area, v.width_px, v.height_px);
  put(f, s->model, &(picture){v.width_px, v.height_px, NULL, rendered});
}

// The link to the page at the right of the area, which becomes narrower.
static void put_qr(const sv_screen *s, const sv_display_frame *f, sv_screen_box *area) {
  const int side = s->qr.side + 2 * QR_QUIET, zoom = sv_mini(area->width_px / 2, area->height_px) / side;
  if (zoom < 1) return;
  const int px = zoom * side;
  area->width_px -= px;
  const sv_screen_box b = {area->x0 + area->width_px, area->y0 + (area->height_px - px) / 2, px, px};
  fill(f, b, 255);
  for (int y = 0; y < s->qr.side; y++)
    for (int x = 0; x < s->qr.side; x++)
      if (s->qr.module[y][x] & SV_QR_DARK)
        fill(f, (sv_screen_box){b.x0 + (x + QR_QUIET) * zoom, b.y0 + (y + QR_QUIET) * zoom, zoom, zoom}, 0);
}

static void put_all(sv_screen *s, const sv_display *d, const sv_display_frame *f,
                    const sv_screen_content *c) {
  const int scale = text_scale(f), bar_px = sv_mini(f->height_px, (SV_DISPLAY_LINE_PX + 2) * scale);
  sv_screen_box area = {.width_px = f->width_px, .height_px = f->height_px - bar_px};
  memset(s->tile, 0, sizeof s->tile);
  s->model = (sv_screen_box){0};
  fill(f, (sv_screen_box){.width_px = f->width_px, .height_px = f->height_px}, 24);
  if (c->t) {
    sv_screen_box strip = area;
    strip.width_px = s->tiles->n > 0 ? area.width_px / 5 : 0;
    area.x0 += strip.width_px;
    area.width_px -= strip.width_px;
    if (strip.width_px) put_tiles(s, f, strip, 1);
    put_model(s, f, area, c);
  } else {
    if (c->is_waiting && s->has_qr) put_qr(s, f, &area);
    put_tiles(s, f, area, grid_columns(s->tiles->n));
  }
  d->text(d->self, MARGIN_PX, f->height_px - bar_px + 2 * scale, scale, c->line);
}

void sv_screen_draw(sv_screen *s, const sv_display *d, const sv_screen_content *c) {
  sv_display_frame f;
  size_t bytes;
  if (!s->tiles || !d->begin || !d->begin(d->self, &f)) return;
  // AGAIN: the copy is the newest one, or torn (number 0)
  if (sv_feed_read(&s->feed, SV_FEED_TILES, &s->tiles_seq, s->tiles, sizeof *s->tiles, &bytes) < 0)
    s->tiles->n = 0;
  if (!s->tiles_seq) s->tiles->n = 0;
  put_all(s, d, &f, c);
  d->commit(d->self);
  s->n_drawn++;
}

void sv_screen_message(const sv_display *d, const char *text) {
  sv_display_frame f;
  if (!d->begin || !d->begin(d->self, &f)) return;
  fill(&f, (sv_screen_box){.width_px = f.width_px, .height_px = f.height_px}, 24);
  const int scale = text_scale(&f), line_px = SV_DISPLAY_LINE_PX * scale;
  const int n_chars = sv_clampi((f.width_px - 2 * MARGIN_PX) / (SV_DISPLAY_CHAR_PX * scale), 1, 255);
  for (int y = line_px; *text && y + line_px <= f.height_px; y += line_px) {
    char line[256];
    int n = sv_mini((int)strlen(text), n_chars);
    if (text[n]) // between words, where there are some
      for (int i = n; i > 0; i--)
        if (text[i] == ' ') {
          n = i;
          break;
        }
    memcpy(line, text, (size_t)n);
    line[n] = 0;
    d->text(d->self, MARGIN_PX, y, scale, line);
    text += n + (text[n] == ' ');
  }
  d->commit(d->self);
}
