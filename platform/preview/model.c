// SPDX-License-Identifier: Apache-2.0
// The Gaussians for the page, and as files to take home.
//
// Compact form, little endian: a header of 96 bytes, then 32 bytes a Gaussian (two RGBA32UI texels):
//   0 f32 x y z | 12 u8 R G B A (SH degree 0, opacity) | 16 f16 scale x y z (linear) | 22 i16 quaternion w x y z of
//   32767 | 30 u16 0, kept for an index into what moves.
// Header: u32 magic "SVG1", n, bytes a Gaussian, step, sequence number (low), flags, motion kind, motion floats;
// f32 centre 3, radius, eye 3, up 3, fov_y, time_min, time_max, 3 x 0. Motion data, when there is any, follows the
// Gaussians: n rows of `motion floats` floats.
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "platform/codec/gzip.h"
#include "platform/preview/preview.h"
#include "src/format/bytes.h"
#include "src/format/ply.h"
#include "src/format/splat_file.h"
#include "src/format/spz.h"

#define HEADER_BYTES   96
#define GAUSSIAN_BYTES 32
#define MAGIC          0x31475653u

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

// The newest snapshot, NULL when there is none that is whole.
static const sv_feed_model *newest(pv_source *s) {
  size_t bytes;
  const sv_feed_model *m = (const sv_feed_model *)s->model;
  if (sv_feed_read(&s->reader, SV_FEED_MODEL, &s->model_seq, s->model, s->model_cap, &bytes) == SV_OK) {
    forget(s);
    bool is_whole = bytes >= sizeof *m && m->sh_degree <= 3 && m->n_motion <= 256 &&
                    m->n_floats == SV_GAUSSIAN_N_FLOATS(m->sh_degree) + m->n_motion &&
                    m->n <= (bytes - sizeof *m) / sizeof(float) / m->n_floats;
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

static uint8_t to_byte(float x) { return (uint8_t)(x > 1 ? 255 : x > 0 ? x * 255 + 0.5f : 0); }

static void put_compact(uint8_t *o, const sv_gaussian *g) {
  float n = 0;
  for (int k = 0; k < 4; k++) n += g->quat_wxyz[k] * g->quat_wxyz[k];
  n = n > 0 ? 32767.0f / sqrtf(n) : 0;
  for (int k = 0; k < 3; k++) {
    sv_put_lef32(o + 4 * k, g->mean[k]);
    o[12 + k] = to_byte(0.5f + (float)SV_SH_C0 * g->sh[0][k]);
    uint16_t s = half_of(expf(g->log_scale[k]));
    o[16 + 2 * k] = (uint8_t)s, o[17 + 2 * k] = (uint8_t)(s >> 8);
  }
  o[15] = to_byte(1 / (1 + expf(-g->opacity_logit)));
  for (int k = 0; k < 4; k++) {
    int v = (int)lrintf(g->quat_wxyz[k] * n);
    o[22 + 2 * k] = (uint8_t)v, o[23 + 2 * k] = (uint8_t)((unsigned)v >> 8);
  }
  o[30] = o[31] = 0;
}

pv_blob *pv_model_compact(pv_source *s) {
  const sv_feed_model *m = newest(s);
  if (!m || s->compact) return m ? s->compact : NULL;
  size_t motion = (size_t)m->n * m->n_motion * sizeof(float);
  pv_blob *b = pv_blob_make(HEADER_BYTES + (size_t)m->n * GAUSSIAN_BYTES + motion, s->model_seq);
  if (!b) return NULL;
  memset(b->data, 0, HEADER_BYTES);
  const uint32_t words[8] = {MAGIC,     m->n,           GAUSSIAN_BYTES, m->step, (uint32_t)s->model_seq,
                             m->is_mip, m->motion_kind, m->n_motion};
  const float floats[13] = {m->centre[0], m->centre[1], m->centre[2], m->radius, m->eye[0],
                            m->eye[1],    m->eye[2],    m->up[0],     m->up[1],  m->up[2],
                            m->fov_y,     m->time_min,  m->time_max};
  for (int i = 0; i < 8; i++) sv_put_le32(b->data + 4 * i, words[i]);
  for (int i = 0; i < 13; i++) sv_put_lef32(b->data + 32 + 4 * i, floats[i]);
  uint8_t *o = b->data + HEADER_BYTES, *moving = o + (size_t)m->n * GAUSSIAN_BYTES;
  for (uint32_t i = 0; i < m->n; i++) {
    sv_gaussian g;
    get(m, i, &g);
    put_compact(o + (size_t)i * GAUSSIAN_BYTES, &g);
    const float *row = (const float *)(m + 1) + (size_t)i * m->n_floats + SV_GAUSSIAN_N_FLOATS(m->sh_degree);
    for (uint32_t k = 0; k < m->n_motion; k++, moving += 4) sv_put_lef32(moving, row[k]);
  }
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
  sv_ply_options o = {
      .n = m->n, .sh_degree = (int)m->sh_degree, .is_mip = m->is_mip != 0, .has_normals = true};
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
  if (!packed) return NULL;
  for (uint32_t i = 0; i < m->n; i++) {
    sv_gaussian g;
    get(m, i, &g);
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
