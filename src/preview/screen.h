// SPDX-License-Identifier: Apache-2.0
// C only: the feed is.
// What a screen of the machine shows: cameras, model and a line of text, drawn into the port's
// display between training steps. Owns a copy of the feed's thumbnails. Never waits, never changes
// the model.
#ifndef SV_PREVIEW_SCREEN_H
#define SV_PREVIEW_SCREEN_H

#include "src/base/arena.h"
#include "src/format/qr.h"
#include "src/port/feed.h"
#include "src/port/port.h"
#include "src/train/train.h"

// The model is seen from a viewpoint that swings to and fro around the scene, beginning at the
// first training view.
#define SV_SCREEN_SWING_RAD   0.25
#define SV_SCREEN_SWING_STEPS 15 // from the middle to one end
#define SV_SCREEN_STEP_S      0.1

typedef struct {
  int x0, y0, width_px, height_px;
} sv_screen_box;

typedef struct {
  sv_feed_reader feed;
  sv_feed_tiles *tiles; // NULL: there is no screen
  uint64_t tiles_seq;
  sv_qr qr;
  bool has_qr;
  double next_s;
  uint64_t n_drawn;
  // Of the newest frame: where cameras and model are, and from where the model is seen
  sv_screen_box tile[SV_FEED_CAP_TILES], model; // width 0: not there
  double turn_rad;
} sv_screen;

// What to draw.
typedef struct {
  sv_trainer *t;   // NULL: no model yet
  bool is_waiting; // for Start: the QR code is shown
  const char *line;
  double now_s;
} sv_screen_content;

void sv_screen_carve(sv_screen *s, sv_arena *a);
// For the tiles of a feed in this process, and for the display's link.
void sv_screen_start(sv_screen *s, const sv_feed *feed, const sv_display *d);
// Draws and shows a frame, when the screen takes one.
void sv_screen_draw(sv_screen *s, const sv_display *d, const sv_screen_content *c);
// Text alone, in lines.
void sv_screen_message(const sv_display *d, const char *text);

#endif
