// SPDX-License-Identifier: Apache-2.0
#include "platform/preview/compact.h"

#include <math.h>
#include <string.h>

#include "src/format/bytes.h"
#include "src/format/gaussian.h"

#define HEADER_BYTES 128
#define N_HALVES     11 // 16-bit values of a Gaussian
#define N_EYE        7  // floats of a camera
#define MAGIC        0x32475653u
#define CAP_SH       4.0f // higher SH beyond are cut: nothing that is seen has them

uint64_t pv_compact_motion_floats(const sv_feed_model *m) {
  return (uint64_t)m->n_moving * m->n_motion +
         (m->n_bodies ? SV_FEED_BODIES_FLOATS(m->n_bodies, m->n_knots, m->n_moving) : 0);
}

static void get(const sv_feed_model *m, uint32_t i, sv_gaussian *g) {
  memset(g, 0, sizeof *g);
  memcpy(g, (const float *)(m + 1) + (size_t)i * m->n_floats,
         SV_GAUSSIAN_N_FLOATS(m->sh_degree) * sizeof(float));
}

static uint16_t half_of(float f) { // round to nearest, by the bits; too large: the largest
  uint32_t u;
  memcpy(&u, &f, 4);
  uint32_t sign = u >> 16 & 0x8000, rest = u & 0x7fffffff;
  if (rest >= 0x477ff000) return (uint16_t)(sign | 0x7bff);
  if (rest < 0x38800000) { // below 2^-14: a multiple of 2^-24
    float a;
    memcpy(&a, &rest, 4);
    return (uint16_t)(sign | (uint32_t)(a * 16777216.0f + 0.5f));
  }
  return (uint16_t)(sign | ((rest + 0x1000 - 0x38000000) >> 13));
}

static void put16(uint8_t *o, unsigned v) {
  o[0] = (uint8_t)v;
  o[1] = (uint8_t)(v >> 8);
}

static void put_halves(uint8_t *o, const sv_gaussian *g) {
  float n = 0;
  for (int k = 0; k < 4; k++) n += g->quat_wxyz[k] * g->quat_wxyz[k];
  n = n > 0 ? 32767.0f / sqrtf(n) : 0;
  for (int k = 0; k < 3; k++) {
    put16(o + 2 * k, half_of(expf(g->log_scale[k])));
    put16(o + 14 + 2 * k, half_of(g->sh[0][k]));
  }
  for (int k = 0; k < 4; k++) put16(o + 6 + 2 * k, (unsigned)(int)lrintf(g->quat_wxyz[k] * n));
  put16(o + 20, half_of(g->opacity_logit));
}

static int n_higher(const sv_feed_model *m) { return (int)((m->sh_degree + 1) * (m->sh_degree + 1)) - 1; }

// One step of the higher SH's bytes: the largest there is makes 127.
static float sh_unit(const sv_feed_model *m) {
  float most = 0;
  for (uint32_t i = 0; i < m->n && m->sh_degree; i++) {
    const float *sh = (const float *)(m + 1) + (size_t)i * m->n_floats + SV_GAUSSIAN_N_FLOATS(0);
    for (int k = 0; k < 3 * n_higher(m); k++)
      if (fabsf(sh[k]) > most) most = fabsf(sh[k]);
  }
  return (most < CAP_SH ? most : CAP_SH) / 127.0f;
}

static void put_higher(int8_t *o, const sv_gaussian *g, int n, float unit) {
  for (int k = 0; k < n; k++)
    for (int c = 0; c < 3; c++) {
      float v = unit > 0 ? g->sh[1 + k][c] / unit : 0;
      *o++ = (int8_t)lrintf(v > 127 ? 127 : v < -127 ? -127 : v);
    }
}

static void put_header(uint8_t *o, const sv_feed_model *m, uint64_t seq, float unit) {
  const uint32_t is_mip = (m->is_mip ? 1u : 0) | m->background << 8;
  const uint32_t words[12] = {MAGIC,       m->n,        m->step,   (uint32_t)seq, is_mip,   m->sh_degree,
                              m->n_moving, m->n_motion, m->motion, m->n_pos,      m->n_rot, m->n_colour};
  const float floats[16] = {m->centre[0], m->centre[1], m->centre[2], m->radius, m->eye[0], m->eye[1],
                            m->eye[2],    m->up[0],     m->up[1],     m->up[2],  m->fov_y,  m->time_min,
                            m->time_max,  m->seconds,   m->t0,        unit};
  memset(o, 0, HEADER_BYTES);
  for (int i = 0; i < 12; i++) sv_put_le32(o + 4 * i, words[i]);
  sv_put_lef32(o + 48, m->dilation_px2);
  sv_put_le32(o + 52, m->n_bodies);
  sv_put_le32(o + 56, m->n_knots);
  const float ppm = m->scale_sigma > 0 ? fminf(1e6f * m->scale_sigma + 0.5f, 65535) : 0;
  sv_put_le32(o + 60, (m->is_metric ? 1u : 0) | m->n_eyes << 8 | (uint32_t)ppm << 16);
  for (int i = 0; i < 16; i++) sv_put_lef32(o + 64 + 4 * i, floats[i]);
}

static size_t sh_end(const sv_feed_model *m) {
  return HEADER_BYTES + (size_t)m->n * (12 + 2 * N_HALVES + 3 * (size_t)n_higher(m));
}

static size_t motion_at(const sv_feed_model *m) { return (sh_end(m) + 3) & ~(size_t)3; }

size_t pv_compact_bytes(const sv_feed_model *m) {
  return motion_at(m) + 4 * ((size_t)pv_compact_motion_floats(m) + N_EYE * (size_t)m->n_eyes);
}

void pv_compact_put(const sv_feed_model *m, uint64_t seq, uint8_t *out) {
  const size_t n = m->n, n_sh = 3 * (size_t)n_higher(m), n_moves = (size_t)pv_compact_motion_floats(m),
               sh_at = HEADER_BYTES + n * (12 + 2 * N_HALVES), moves_at = motion_at(m);
  const float unit = sh_unit(m), *row = (const float *)(m + 1) + n * m->n_floats;
  put_header(out, m, seq, unit);
  memset(out + sh_end(m), 0, moves_at - sh_end(m));
  for (size_t i = 0; i < n; i++) {
    sv_gaussian g;
    get(m, (uint32_t)i, &g);
    for (size_t k = 0; k < 3; k++) sv_put_lef32(out + HEADER_BYTES + 12 * i + 4 * k, g.mean[k]);
    put_halves(out + HEADER_BYTES + 12 * n + 2 * N_HALVES * i, &g);
    put_higher((int8_t *)out + sh_at + n_sh * i, &g, n_higher(m), unit);
  }
  for (size_t i = 0; i < n_moves; i++) sv_put_lef32(out + moves_at + 4 * i, row[i]);
  uint8_t *eyes = out + moves_at + 4 * n_moves;
  for (uint32_t i = 0; i < m->n_eyes; i++, eyes += 4 * N_EYE) {
    const sv_feed_eye *e = &m->eyes[i];
    for (int k = 0; k < 3; k++) {
      sv_put_lef32(eyes + 4 * k, e->eye[k]);
      sv_put_lef32(eyes + 12 + 4 * k, e->forward[k]);
    }
    sv_put_lef32(eyes + 24, e->tan_half);
  }
}
