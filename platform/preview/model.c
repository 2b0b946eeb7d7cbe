// SPDX-License-Identifier: Apache-2.0
// The Gaussians for the page, and as files to take home.
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "platform/codec/gzip.h"
#include "platform/preview/compact.h"
#include "platform/preview/preview.h"
#include "src/format/axes.h"
#include "src/format/bytes.h"
#include "src/format/ply.h"
#include "src/format/splat_file.h"
#include "src/format/spz.h"

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
    bool is_whole =
        bytes >= sizeof *m && m->sh_degree <= 3 && m->n_motion <= 256 &&
        m->n_floats == SV_GAUSSIAN_N_FLOATS(m->sh_degree) && m->n_moving <= m->n &&
        m->n_eyes <= SV_FEED_CAP_EYES && m->n_bodies <= SV_FEED_CAP_BODIES &&
        m->n_knots <= SV_FEED_CAP_KNOTS && m->n <= (bytes - sizeof *m) / sizeof(float) / m->n_floats &&
        (uint64_t)m->n * m->n_floats + pv_compact_motion_floats(m) <= (bytes - sizeof *m) / sizeof(float);
    if (!is_whole) memset(s->model, 0, sizeof *m);
  }
  return s->model_seq && m->n > 0 ? m : NULL;
}

static void get(const sv_feed_model *m, uint32_t i, sv_gaussian *g) {
  memset(g, 0, sizeof *g);
  memcpy(g, (const float *)(m + 1) + (size_t)i * m->n_floats,
         SV_GAUSSIAN_N_FLOATS(m->sh_degree) * sizeof(float));
}

pv_blob *pv_model_compact(pv_source *s) {
  const sv_feed_model *m = newest(s);
  if (!m || s->compact) return m ? s->compact : NULL;
  pv_blob *b = pv_blob_make(pv_compact_bytes(m), s->model_seq);
  if (b) pv_compact_put(m, s->model_seq, b->data);
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
                      .unit = {.is_metric = m->is_metric != 0, .scale_sigma = m->scale_sigma},
                      .dilation_px2 = m->dilation_px2,
                      .background = m->background,
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
  z.unit = (sv_unit){.is_metric = m->is_metric != 0, .scale_sigma = m->scale_sigma};
  uint8_t header[SV_SPZ_HEADER_BYTES], extra[SV_SPZ_UNIT_BYTES], *packed = malloc(sv_spz_bytes(&z)),
                                                                 *gz = NULL;
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
  const sv_piece unit = {extra, sv_spz_put_extra(&z, extra)};
  pv_blob *b = NULL;
  if (sv_gzip(pieces, 2, &unit, &gz, &bytes, &err) == SV_OK && (b = pv_blob_make(bytes, 0)))
    memcpy(b->data, gz, bytes);
  free(packed);
  free(gz);
  return b;
}

pv_blob *pv_model_make(const sv_feed_model *m, pv_file kind) {
  static pv_blob *(*const make[PV_N_FILES])(const sv_feed_model *) = {make_ply, make_splat, make_spz};
  return make[kind](m);
}

pv_blob *pv_model_file(pv_source *s, pv_file kind) {
  const sv_feed_model *m = newest(s);
  if (!m) return NULL;
  if (!s->file[kind]) {
    s->file[kind] = pv_model_make(m, kind);
    if (s->file[kind]) s->file[kind]->seq = m->step;
  }
  return s->file[kind];
}
