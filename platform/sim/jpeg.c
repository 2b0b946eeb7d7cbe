// SPDX-License-Identifier: Apache-2.0
// What JPEG's baseline coding leaves of a frame (ITU-T T.81): YCbCr with a quarter of the chroma,
// 8x8 blocks, cosine transform, coefficients rounded to multiples of the tables of its annex K,
// scaled by quality as libjpeg does. No bytes are coded: the loss is all that cameras' pictures
// show of it.
#include <math.h>
#include <string.h>

#include "platform/sim/sim.h"
#include "src/base/mathx.h"

static const uint8_t TABLES[2][64] = {
    {16, 11,  10,  16, 24, 40, 51, 61, 12,  12,  14,  19,  26, 58, 60, 55,  14,  13,  16,  24, 40, 57,
     69, 56,  14,  17, 22, 29, 51, 87, 80,  62,  18,  22,  37, 56, 68, 109, 103, 77,  24,  35, 55, 64,
     81, 104, 113, 92, 49, 64, 78, 87, 103, 121, 120, 101, 72, 92, 95, 98,  112, 100, 103, 99},
    {17, 18, 24, 47, 99, 99, 99, 99, 18, 21, 26, 66, 99, 99, 99, 99, 24, 26, 56, 99, 99, 99,
     99, 99, 47, 66, 99, 99, 99, 99, 99, 99, 99, 99, 99, 99, 99, 99, 99, 99, 99, 99, 99, 99,
     99, 99, 99, 99, 99, 99, 99, 99, 99, 99, 99, 99, 99, 99, 99, 99, 99, 99, 99, 99}};

typedef struct {
  float cosine[64];  // [frequency][place]
  float step[2][64]; // of luma, of chroma
} coder;

static coder coder_of(int quality) {
  coder c;
  const int scale = quality < 50 ? 5000 / quality : 200 - 2 * quality;
  for (int u = 0; u < 8; u++)
    for (int x = 0; x < 8; x++)
      c.cosine[8 * u + x] = (float)((u ? 0.5 : 0.35355339059327379) * sv_cos((2 * x + 1) * u * SV_PI / 16));
  for (int t = 0; t < 2; t++)
    for (int i = 0; i < 64; i++) c.step[t][i] = (float)sv_clampi((TABLES[t][i] * scale + 50) / 100, 1, 255);
  return c;
}

// out = a in b^T (is_back: a^T in b), all 8x8, with the cosines for both.
static void transform(const coder *c, const float in[64], float out[64], bool is_back) {
  float half[64];
  for (int i = 0; i < 8; i++)
    for (int k = 0; k < 8; k++) {
      float sum = 0;
      for (int x = 0; x < 8; x++) sum += in[8 * i + x] * c->cosine[is_back ? 8 * x + k : 8 * k + x];
      half[8 * i + k] = sum;
    }
  for (int i = 0; i < 8; i++)
    for (int k = 0; k < 8; k++) {
      float sum = 0;
      for (int x = 0; x < 8; x++) sum += half[8 * x + k] * c->cosine[is_back ? 8 * x + i : 8 * i + x];
      out[8 * i + k] = sum;
    }
}

// A block of `stride` floats a row, in its place.
static void code(const coder *c, int table, float *px, int stride) {
  float block[64], coefficient[64];
  for (int i = 0; i < 64; i++) block[i] = px[i / 8 * stride + i % 8];
  transform(c, block, coefficient, false);
  for (int i = 0; i < 64; i++)
    coefficient[i] = c->step[table][i] * floorf(coefficient[i] / c->step[table][i] + 0.5f);
  transform(c, coefficient, block, true);
  for (int i = 0; i < 64; i++) px[i / 8 * stride + i % 8] = block[i];
}

#define SIDE 16 // pixels of a unit: four blocks of luma, one each of the chroma

typedef struct {
  float luma[SIDE * SIDE], chroma[2][64];
} unit;

static void load(unit *m, const uint8_t *rgb, int w, int h, int x0, int y0) {
  memset(m->chroma, 0, sizeof m->chroma);
  for (int i = 0; i < SIDE * SIDE; i++) { // the picture's last row and column are repeated
    const int x = sv_mini(x0 + i % SIDE, w - 1), y = sv_mini(y0 + i / SIDE, h - 1);
    const uint8_t *p = rgb + 3 * ((size_t)y * (size_t)w + (size_t)x);
    const float r = p[0], g = p[1], b = p[2], luma = 0.299f * r + 0.587f * g + 0.114f * b;
    const int at = i / SIDE / 2 * 8 + i % SIDE / 2;
    m->luma[i] = luma - 128;
    m->chroma[0][at] += 0.25f * ((b - luma) / 1.772f);
    m->chroma[1][at] += 0.25f * ((r - luma) / 1.402f);
  }
}

static uint8_t byte_of(float v) { return (uint8_t)sv_clampf(v + 0.5f, 0, 255); }

static void store(const unit *m, uint8_t *rgb, int w, int h, int x0, int y0) {
  for (int i = 0; i < SIDE * SIDE; i++) {
    const int x = x0 + i % SIDE, y = y0 + i / SIDE, at = i / SIDE / 2 * 8 + i % SIDE / 2;
    if (x >= w || y >= h) continue;
    const float luma = m->luma[i] + 128, cb = m->chroma[0][at], cr = m->chroma[1][at];
    uint8_t *p = rgb + 3 * ((size_t)y * (size_t)w + (size_t)x);
    p[0] = byte_of(luma + 1.402f * cr);
    p[1] = byte_of(luma - 0.344136f * cb - 0.714136f * cr);
    p[2] = byte_of(luma + 1.772f * cb);
  }
}

void sv_sim_jpeg(uint8_t *rgb, int width_px, int height_px, int quality) {
  const coder c = coder_of(quality);
  for (int y = 0; y < height_px; y += SIDE)
    for (int x = 0; x < width_px; x += SIDE) {
      unit m;
      load(&m, rgb, width_px, height_px, x, y);
      for (int i = 0; i < 4; i++) code(&c, 0, m.luma + i / 2 * 8 * SIDE + i % 2 * 8, SIDE);
      for (int i = 0; i < 2; i++) code(&c, 1, m.chroma[i], 8);
      store(&m, rgb, width_px, height_px, x, y);
    }
}
