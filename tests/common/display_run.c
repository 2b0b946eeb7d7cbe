// SPDX-License-Identifier: Apache-2.0
#include "tests/common/display_run.h"

#include <poll.h>
#include <string.h>

#include "src/train/driver.h"

#define SPEC "textured,rig=stereo,size=96x64"

static _Alignas(64) uint8_t feed_block[32u << 20];
static sv_feed feed;

bool display_run(world *w, const sv_display *d) {
  if (!world_open(w, SPEC, 4, ~0u, 2)) return false;
  w->cfg.train.n_gaussians = 500;
  w->cfg.steps = 20;
  w->cfg.has_preview = true;
  w->cfg.has_screen = d != NULL;
  memset(feed_block, 0, sizeof feed_block);
  if (sv_feed_init(&feed, feed_block, sizeof feed_block, 500, SV_GAUSSIAN_N_FLOATS(3), 0) < 0) return false;
  w->port.publish.feed = &feed;
  if (d) w->port.display = *d;
  if (world_init(w) < 0 || sv_app_run(&w->app, &w->err) < 0) return false;
  const uint64_t before = w->app.preview.screen.n_drawn;
  for (int i = 0; d && i < 200 && w->app.preview.screen.n_drawn == before; i++) {
    if (sv_preview_tick(&w->app.preview) < 0) return false;
    poll(NULL, 0, 10); // a refresh of the screen
  }
  sv_display_frame f;
  for (int i = 0; d && i < 200 && !d->begin(d->self, &f); i++) poll(NULL, 0, 10);
  return true;
}

static bool is_same(const uint8_t px[4], const uint8_t rgb[3]) {
  return px[0] == rgb[2] && px[1] == rgb[1] && px[2] == rgb[0];
}

static const uint8_t *pixel_at(const sv_display_frame *f, int x, int y) {
  return f->px + (size_t)y * f->stride_bytes + 4 * (size_t)x;
}

long display_differences(world *w, const sv_display_frame *shown, long *n_compared) {
  const sv_screen *s = &w->app.preview.screen;
  const sv_feed_tiles *t = w->app.preview.tiles;
  const sv_view v = sv_pictures_turned(&w->app.trainer, s->turn_rad);
  const sv_planes *p;
  long n = 0;
  *n_compared = 0;
  if (sv_driver_render(&w->app.trainer, &v, &p) < 0) return -1;
  for (int y = 0; y < s->model.height_px; y++)
    for (int x = 0; x < s->model.width_px; x++) {
      uint8_t rgb[3];
      sv_pictures_pixel(rgb, p, x * v.width_px / s->model.width_px, y * v.height_px / s->model.height_px);
      n += !is_same(pixel_at(shown, s->model.x0 + x, s->model.y0 + y), rgb);
      ++*n_compared;
    }
  for (int i = 0; i < t->n; i++)
    for (int y = 0; y < s->tile[i].height_px; y++)
      for (int x = 0; x < s->tile[i].width_px; x++) {
        const int u = x * t->tile[i].width_px / s->tile[i].width_px,
                  k = y * t->tile[i].height_px / s->tile[i].height_px;
        n += !is_same(pixel_at(shown, s->tile[i].x0 + x, s->tile[i].y0 + y),
                      t->rgb[i] + 3 * (k * t->tile[i].width_px + u));
        ++*n_compared;
      }
  return n;
}
