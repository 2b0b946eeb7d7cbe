// SPDX-License-Identifier: Apache-2.0
// The Gaussians for the page, and as files to take home.
//
// Compact form, little endian: a header of 128 bytes, then one block after another,
//   n x 3 f32          places
//   n x 11 u16         f16 scale x y z (linear) | i16 quaternion w x y z of 32767 | f16 SH degree 0
//                      of R G B |
//                      f16 opacity logit
//   n x 3 ((d+1)^2 - 1) i8   higher SH of degree d, coefficient-major, in units of `sh unit`;
//                            padded to 4 bytes
//   n_moving x n_motion f32  motion of the first n_moving (src/port/feed.h), with bodies theirs
//                            behind it
// Header: u32 magic "SVG2", n, step, sequence number (low), is_mip, SH degree, n_moving, n_motion,
// motion, n_pos, n_rot, n_colour; f32 low-pass in square pixels; n_bodies, n_knots, 0; f32 centre
// 3, radius, eye 3, up 3, fov_y, time_min, time_max, seconds, t0, sh unit.
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "platform/codec/gzip.h"
#include "platform/preview/preview.h"
#include "src/format/axes.h"
#include "src/format/bytes.h"
#include "src/format/ply.h"
#include "src/format/splat_file.h"
#include "src/format/spz.h"

#define HEADER_BYTES 128
#define N_HALVES     11 // 16-bit values of a Gaussian
#define MAGIC        0x32475653u
#define CAP_SH       4.0f // higher SH beyond are cut: nothing that is seen has them

sv_status pv_model_open(pv_source *s, sv_err *err) {
  s->model_cap = (size_t)s->reader.ring[SV_FEED_MODEL].slot_bytes;
  s->model = malloc(s->model_cap);
  return s->model ? SV_OK : sv_fail(err, SV_E_NOMEM, "no memory for a model of %zu bytes", s->model_cap);
}

static void forget(pv_source *s) {
  pv_blob_drop(s->compact);
  s->compact = NULL;
  for (int i = 0; i < PV_N_FILES; i++) {
    pv_blob_drop(s->file[i]);
    s->file[i] = NULL;
  }
}

// Floats of motion, those of the bodies among them.
static uint64_t n_motion(const sv_feed_model *m) {
  return (uint64_t)m->n_moving * m->n_motion +
         (m->n_bodies ? SV_FEED_BODIES_FLOATS(m->n_bodies, m->n_knots, m->n_moving) : 0);
}

// The newest snapshot, NULL when there is none that is whole.
static const sv_feed_model *newest(pv_source *s) {
  size_t bytes;
  const sv_feed_model *m = (const sv_feed_model *)s->model;
  if (sv_feed_read(&s->reader, SV_FEED_MODEL, &s->model_seq, s->model, s->model_cap, &bytes) == SV_OK) {
    forget(s);
    bool is_whole = bytes >= sizeof *m && m->sh_degree <= 3 && m->n_motion <= 256 &&
                    m->n_floats == SV_GAUSSIAN_N_FLOATS(m->sh_degree) && m->n_moving <= m->n &&
                    m->n_bodies <= SV_FEED_CAP_BODIES && m->n_knots <= SV_FEED_CAP_KNOTS &&
                    m->n <= (bytes - sizeof *m) / sizeof(float) / m->n_floats &&
                    (uint64_t)m->n * m->n_floats + n_motion(m) <= (bytes - sizeof *m) / sizeof(float);
    if (!is_whole) memset(s->model, 0, sizeof *m);
  }
  return s->model_seq && m->n > 0 ? m : NULL;
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
  const uint32_t words[12] = {MAGIC,       m->n,        m->step,   (uint32_t)seq, m->is_mip, m->sh_degree,
                              m->n_moving, m->n_motion, m->motion, m->n_pos,      m->n_rot,  m->n_colour};
  const float floats[16] = {m->centre[0], m->centre[1], m->centre[2], m->radius, m->eye[0], m->eye[1],
                            m->eye[2],    m->up[0],     m->up[1],     m->up[2],  m->fov_y,  m->time_min,
                            m->time_max,  m->seconds,   m->t0,        unit};
  memset(o, 0, HEADER_BYTES);
  for (int i = 0; i < 12; i++) sv_put_le32(o + 4 * i, words[i]);
  sv_put_lef32(o + 48, m->dilation_px2);
  sv_put_le32(o + 52, m->n_bodies);
  sv_put_le32(o + 56, m->n_knots);
  for (int i = 0; i < 16; i++) sv_put_lef32(o + 64 + 4 * i, floats[i]);
}

pv_blob *pv_model_compact(pv_source *s) {
  const sv_feed_model *m = newest(s);
  if (!m || s->compact) return m ? s->compact : NULL;
  const size_t n = m->n, n_sh = 3 * (size_t)n_higher(m), n_moves = (size_t)n_motion(m);
  const size_t sh_at = HEADER_BYTES + n * (12 + 2 * N_HALVES), sh_end = sh_at + n * n_sh;
  const size_t motion_at = (sh_end + 3) & ~(size_t)3;
  pv_blob *b = pv_blob_make(motion_at + 4 * n_moves, s->model_seq);
  if (!b) return NULL;
  const float unit = sh_unit(m);
  put_header(b->data, m, s->model_seq, unit);
  memset(b->data + sh_end, 0, motion_at - sh_end);
  for (size_t i = 0; i < n; i++) {
    sv_gaussian g;
    get(m, (uint32_t)i, &g);
    for (size_t k = 0; k < 3; k++) sv_put_lef32(b->data + HEADER_BYTES + 12 * i + 4 * k, g.mean[k]);
    put_halves(b->data + HEADER_BYTES + 12 * n + 2 * N_HALVES * i, &g);
    put_higher((int8_t *)b->data + sh_at + n_sh * i, &g, n_higher(m), unit);
  }
  const float *row = (const float *)(m + 1) + n * m->n_floats;
  for (size_t i = 0; i < n_moves; i++) sv_put_lef32(b->data + motion_at + 4 * i, row[i]);
  return s->compact = b;
}

// --- files ---------------------------------------------------------------------------------------

static sv_status append(void *self, const void *data, size_t bytes, sv_err *err) {
  pv_blob *b = self; // made as large as the file will be; `seq` is what is written so far
  if (bytes > b->bytes - b->seq) return sv_fail(err, SV_E_FULL, "the file is larger than planned");
  memcpy(b->data + b->seq, data, bytes);
  b->seq += bytes;
  return SV_OK;
}

static pv_blob *make_ply(const sv_feed_model *m) {
  static sv_ply_writer w;
  sv_err err;
  sv_ply_options o = {.n = m->n,
                      .sh_degree = (int)m->sh_degree,
                      .is_mip = m->is_mip != 0,
                      .has_normals = true,
                      .dilation_px2 = m->dilation_px2,
                      .up = sv_up_name(m->up)};
  pv_blob *b = pv_blob_make(sv_ply_file_bytes(&o), 0);
  if (!b) return NULL;
  sv_status s = sv_ply_write_begin(&w, (sv_sink){b, append}, &o, &err);
  for (uint32_t i = 0; s >= 0 && i < m->n; i++) {
    sv_gaussian g;
    get(m, i, &g);
    s = sv_ply_write_gaussian(&w, &g, &err);
  }
  if (s >= 0) s = sv_ply_write_end(&w, &err);
  if (s >= 0) return b;
  pv_blob_drop(b);
  return NULL;
}

typedef struct {
  float order;
  uint32_t i;
} ranked;
static int by_order(const void *a, const void *b) {
  const ranked *x = a, *y = b;
  return x->order > y->order ? -1 : x->order < y->order ? 1 : (x->i > y->i) - (x->i < y->i);
}

static pv_blob *make_splat(const sv_feed_model *m) {
  pv_blob *b = pv_blob_make((size_t)m->n * SV_SPLAT_BYTES, 0);
  ranked *rank = malloc((size_t)m->n * sizeof *rank);
  sv_gaussian g;
  if (b && rank) {
    for (uint32_t i = 0; i < m->n; i++) {
      get(m, i, &g);
      rank[i] = (ranked){sv_splat_order(&g), i};
    }
    qsort(rank, m->n, sizeof *rank, by_order);
    for (uint32_t i = 0; i < m->n; i++) {
      get(m, rank[i].i, &g);
      sv_splat_encode(&g, b->data + (size_t)i * SV_SPLAT_BYTES);
    }
  } else {
    pv_blob_drop(b);
    b = NULL;
  }
  free(rank);
  return b;
}

static pv_blob *make_spz(const sv_feed_model *m) { // version 3: what most viewers read
  sv_spz z = {.version = 3, .n = m->n, .sh_degree = (int)m->sh_degree, .is_mip = m->is_mip != 0};
  uint8_t header[SV_SPZ_HEADER_BYTES], *packed = malloc(sv_spz_bytes(&z)), *gz = NULL;
  size_t bytes = 0;
  sv_err err;
  sv_turn turn;
  sv_turn_upright(&turn, sv_up_name(m->up));
  if (!packed) return NULL;
  for (uint32_t i = 0; i < m->n; i++) {
    sv_gaussian g;
    get(m, i, &g);
    sv_gaussian_turn_by(&g, &turn);
    sv_spz_put(&z, packed, i, &g);
  }
  sv_spz_header(&z, header);
  sv_piece pieces[2] = {{header, sizeof header}, {packed, sv_spz_bytes(&z)}};
  pv_blob *b = NULL;
  if (sv_gzip(pieces, 2, &gz, &bytes, &err) == SV_OK && (b = pv_blob_make(bytes, 0)))
    memcpy(b->data, gz, bytes);
  free(packed);
  free(gz);
  return b;
}

pv_blob *pv_model_file(pv_source *s, pv_file kind) {
  static pv_blob *(*const make[PV_N_FILES])(const sv_feed_model *) = {make_ply, make_splat, make_spz};
  const sv_feed_model *m = newest(s);
  if (!m) return NULL;
  if (!s->file[kind]) {
    s->file[kind] = make[kind](m);
    if (s->file[kind]) s->file[kind]->seq = m->step;
  }
  return s->file[kind];
}
