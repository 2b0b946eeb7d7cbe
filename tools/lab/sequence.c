// SPDX-License-Identifier: Apache-2.0
#include "tools/lab/sequence.h"

#include <stdlib.h>
#include <string.h>

#include "src/base/str.h"
#include "src/deform/deform_sequence.h"

// --- writing -------------------------------------------------------------------------------------

sv_status lab_write_sequence(lab_model *m, const lab_session *se, const lab_settings *st, int n_frames,
                             const char *path, sv_err *err) {
  sv_sequence_head h = {.n_frames = (uint32_t)n_frames,
                        .is_mip = m->is_mip,
                        .unit = m->unit,
                        .dilation_px2 = m->dilation_px2,
                        .radius = st->radius};
  sv_file f;
  if (!m->deform.kind) return sv_fail(err, SV_E_NOT_FOUND, "the model is static: no motion.bin beside it");
  memcpy(h.centre, st->centre, sizeof h.centre);
  sv_copy(h.up, sizeof h.up, m->up);
  void *scratch = malloc(sv_deform_sequence_bytes(m->g.n, n_frames) + 8);
  if (!scratch) return sv_fail(err, SV_E_NOMEM, "%s: no memory for %d Gaussians", path, m->g.n);
  sv_status s = sv_file_begin(&f, path, err);
  if (s == SV_OK) {
    s = sv_deform_write_sequence(&m->deform, &(sv_compute){&se->k, &se->pool}, &m->g, &h, scratch,
                                 (sv_sink){&f, sv_file_append}, err);
    if (s == SV_OK) s = sv_file_commit(&f, err);
    else sv_file_abandon(&f);
  }
  free(scratch);
  return s;
}

// --- reading -------------------------------------------------------------------------------------

struct lab_sequence {
  sv_sequence_reader r;
  void *file, *state;
  float *moved, *next; // [ceil(n_moving/16)][n_rows][16]; next: of the frame behind
};

bool lab_is_sequence(const void *data, size_t bytes) {
  return bytes >= 12 && !memcmp(data, "SVSECT\r\nSEQN", 12);
}

void lab_sequence_free(lab_sequence *q) {
  if (!q) return;
  free(q->file);
  free(q->state);
  free(q->moved);
  free(q->next);
  free(q);
}

static sv_status make_model(lab_model *m, const sv_sequence_reader *r, sv_err *err) {
  const sv_sequence_head *h = &r->head;
  const size_t bytes = sv_gaussians_bytes((int)h->n, h->sh_degree) + SV_ARENA_ALIGN;
  if (!(m->block = malloc(bytes)))
    return sv_fail(err, SV_E_NOMEM, "%s: no memory for its %u Gaussians", r->sections.name, h->n);
  sv_arena a = sv_arena_make(m->block, bytes);
  sv_status s = sv_gaussians_init(&m->g, (int)h->n, h->sh_degree, &a);
  if (s != SV_OK) return sv_fail(err, s, "%s: cannot hold %u Gaussians", r->sections.name, h->n);
  for (uint32_t i = 0; i < h->n; i++) {
    sv_gaussian g;
    sv_sequence_get(r, i, &g);
    sv_gaussians_put(&m->g, (int)i, &g);
  }
  m->is_mip = h->is_mip;
  m->unit = h->unit;
  m->dilation_px2 = h->dilation_px2;
  sv_copy(m->up, sizeof m->up, h->up);
  return SV_OK;
}

sv_status lab_read_sequence(lab_model *m, const sv_file_data *file, sv_err *err) {
  lab_sequence *q = calloc(1, sizeof *q);
  if (!q) return sv_fail(err, SV_E_NOMEM, "%s: no memory", file->name);
  sv_sequence_reader *r = &q->r;
  sv_status s = sv_sequence_open(r, file, err);
  if (s == SV_OK) {
    const size_t bytes =
        ((size_t)r->head.n_moving + 15) / 16 * 16 * sizeof(float) * (size_t)SV_N_ROWS(r->head.sh_degree);
    q->state = malloc(sv_sequence_reader_bytes(&r->head) + 8);
    q->moved = calloc(1, bytes + sizeof(float));
    q->next = calloc(1, bytes + sizeof(float));
    if (!q->state || !q->moved || !q->next) s = sv_fail(err, SV_E_NOMEM, "%s: no memory", file->name);
  }
  if (s == SV_OK) s = sv_sequence_read_base(r, q->state, err);
  if (s == SV_OK) s = make_model(m, r, err);
  if (s == SV_OK) {
    q->file = (void *)(uintptr_t)file->data;
    r->sections.name = "the sequence"; // the caller's name does not last
    m->sequence = q;
  } else lab_sequence_free(q);
  return s;
}

static sv_status rows_of(lab_sequence *q, uint32_t k, float *out, sv_err *err) {
  const sv_sequence_head *h = &q->r.head;
  const int n_rows = SV_N_ROWS(h->sh_degree);
  sv_status s = sv_sequence_read_frame(&q->r, k, err);
  for (uint32_t i = 0; i < h->n_moving && s == SV_OK; i++) {
    sv_gaussian g;
    float row[SV_GAUSSIAN_FLOATS];
    sv_sequence_get(&q->r, i, &g);
    memcpy(row, &g, sizeof row);
    for (int j = 0; j < n_rows; j++)
      out[((size_t)(i >> 4) * (size_t)n_rows + (size_t)j) * 16 + (i & 15)] = row[j];
  }
  return s;
}

sv_status lab_sequence_at(lab_sequence *q, sv_gaussians *g, float t, sv_err *err) {
  const sv_sequence_head *h = &q->r.head;
  const float at = (t < 0 ? 0 : t > 1 ? 1 : t) * (float)(h->n_frames - 1);
  const uint32_t k = (uint32_t)at < h->n_frames - 1 ? (uint32_t)at : h->n_frames - 2;
  const size_t n = ((size_t)h->n_moving + 15) / 16 * 16 * (size_t)g->n_rows;
  sv_status s = rows_of(q, k, q->moved, err);
  if (s == SV_OK) s = rows_of(q, k + 1, q->next, err);
  // The last block is rendered whole: the Gaussians behind the moving ones are the stored ones.
  for (int i = (int)h->n_moving; i & 15; i++)
    for (int j = 0; j < g->n_rows; j++) {
      const long place = sv_gaussians_at(g, i, j) - g->param;
      q->moved[place] = q->next[place] = g->param[place];
    }
  for (size_t i = 0; i < n; i++) q->moved[i] += (at - (float)k) * (q->next[i] - q->moved[i]);
  g->moved = q->moved;
  g->n_moved = (int)h->n_moving;
  return s;
}
