// SPDX-License-Identifier: Apache-2.0
#include "src/train/background.h"

#include "src/base/mathx.h"

#define SAMPLES     160 // of a picture's width and height, about
#define FLAT_WITHIN 10  // of 255, in each channel
#define FLAT_PART   4   // one of so many pixels
#define BLACK_PART  8
#define DRAWN_SHARE 0.25f

// Calls `each` with the sampled pixels that count.
static void visit(const sv_trainer *t, void (*each)(void *self, const uint8_t *px), void *self) {
  for (int v = 0; v < t->n_views; v++) {
    const sv_image_u8 *im = &t->views[v].image;
    const int dx = 1 + im->width_px / SAMPLES, dy = 1 + im->height_px / SAMPLES;
    for (int y = dy / 2; y < im->height_px; y += dy)
      for (int x = dx / 2; x < im->width_px; x += dx)
        if (sv_image_counts(im, 1, x, y))
          each(self, im->px + (size_t)y * (size_t)im->stride_bytes + (size_t)x * (size_t)im->n_channels);
  }
}

typedef struct {
  uint32_t n[3][256];
} histograms;

static void add_to_histograms(void *self, const uint8_t *px) {
  histograms *h = self;
  for (int k = 0; k < 3; k++) h->n[k][px[k]]++;
}

// The value that most pixels are near to.
static uint8_t peak_of(const uint32_t n[256]) {
  uint32_t most = 0;
  int at = 0;
  for (int i = 0; i < 256; i++) {
    uint32_t sum = 0;
    for (int j = sv_maxi(i - FLAT_WITHIN, 0); j <= sv_mini(i + FLAT_WITHIN, 255); j++) sum += n[j];
    if (sum <= most) continue;
    most = sum;
    at = i;
  }
  return (uint8_t)at;
}

// Pixels near a color.
typedef struct {
  uint8_t near[3];
  int within;
  uint32_t n;
  uint64_t sum[3];
} tally;

static void add_if_near(void *self, const uint8_t *px) {
  tally *c = self;
  for (int k = 0; k < 3; k++)
    if (px[k] > c->near[k] + c->within || px[k] < c->near[k] - c->within) return;
  c->n++;
  for (int k = 0; k < 3; k++) c->sum[k] += px[k];
}

static uint32_t mean_of(const tally *c) {
  uint32_t rgb = 0;
  for (int k = 0; k < 3; k++) rgb = rgb << 8 | (uint32_t)((c->sum[k] + c->n / 2) / c->n);
  return rgb;
}

sv_train_background sv_train_background_of_views(const sv_trainer *t) {
  const sv_train_background plain = {0}; // black
  const bool is_wanted = t->cfg.background == SV_BG_BACKDROP || t->cfg.background == SV_BG_OF_PICTURES;
  if (!is_wanted || t->n_views < 1 || t->n_measurements > 0 || t->cfg.is_deep) return plain;
  for (int v = 0; v < t->n_views; v++)
    if (t->views[v].image.n_channels != 3) return plain;
  histograms h = {0};
  tally all = {.within = 255}, black = {.within = FLAT_WITHIN}, flat = {.within = FLAT_WITHIN};
  visit(t, add_to_histograms, &h);
  for (int k = 0; k < 3; k++) flat.near[k] = peak_of(h.n[k]);
  visit(t, add_if_near, &all);
  visit(t, add_if_near, &black);
  visit(t, add_if_near, &flat);
  if (all.n < 1 || black.n * BLACK_PART >= all.n) return plain;
  if (flat.n * FLAT_PART >= all.n) return (sv_train_background){.rgb = mean_of(&flat)};
  if (t->cfg.background == SV_BG_BACKDROP) return plain;
  return (sv_train_background){.rgb = mean_of(&all), .is_guess = true};
}

bool sv_train_is_background_drawn(sv_trainer *t, float progress) {
  return t->background.is_guess && progress > t->cfg.relocate_until && sv_rng_f(&t->rng) < DRAWN_SHARE;
}

void sv_train_background_color(sv_background b, uint32_t color, float bg[3]) {
  const uint32_t rgb = b == SV_BG_WHITE ? 0xffffff : b == SV_BG_BLACK || b == SV_BG_RANDOM ? 0 : color;
  for (int k = 0; k < 3; k++) bg[k] = (float)(rgb >> (16 - 8 * k) & 255) / 255.0f;
}
