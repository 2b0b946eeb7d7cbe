// SPDX-License-Identifier: Apache-2.0
// A moving model as a "delta PLY", as Brush plays it: the base model, and after its vertices for
// each frame k an element delta_vertex_k with what is added to x y z, scale and rot. Behind them
// stand the differences of color and opacity, which Brush skips: for its sake a Gaussian that has
// faded away at a frame is made vanishingly small there, too.
#include <stdlib.h>
#include <string.h>

#include "src/base/str.h"
#include "src/format/bytes.h"
#include "src/splat/model_file.h"
#include "tools/lab/model_formats.h"

#define N_DELTA  14     // floats a vertex: x y z, scale_0..2, rot_0..3, f_dc_0..2, opacity
#define FADED    2.0f   // a logit so far below the stored one is gone
#define VANISHED -12.0f // added to a log-scale

typedef struct {
  uint8_t *data;
  size_t n, cap;
} memory;

static sv_status append(void *self, const void *data, size_t bytes, sv_err *err) {
  memory *m = self;
  if (bytes > m->cap - m->n) return sv_fail(err, SV_E_FULL, "PLY data exceeds its header");
  memcpy(m->data + m->n, data, bytes);
  m->n += bytes;
  return SV_OK;
}

static size_t header_bytes(const memory *m) { // up to the line end_header
  static const char end[] = "end_header\n";
  for (size_t i = 0; i + sizeof end - 1 <= m->n; i++)
    if (memcmp(m->data + i, end, sizeof end - 1) == 0) return i;
  return 0;
}

static sv_status write_header(const memory *base, sv_file *f, int n_gaussians, int n_frames, sv_err *err) {
  static const char *const names[N_DELTA] = {"x",       "y",      "z",      "scale_0", "scale_1",
                                             "scale_2", "rot_0",  "rot_1",  "rot_2",   "rot_3",
                                             "f_dc_0",  "f_dc_1", "f_dc_2", "opacity"};
  char line[64];
  sv_status s = sv_file_append(f, base->data, header_bytes(base), err);
  for (int k = 0; k < n_frames; k++) {
    sv_fmt(line, sizeof line, "element delta_vertex_%d %d\n", k, n_gaussians);
    if (s == SV_OK) s = sv_file_append(f, line, strlen(line), err);
    for (int i = 0; i < N_DELTA && s == SV_OK; i++) {
      sv_fmt(line, sizeof line, "property float %s\n", names[i]);
      s = sv_file_append(f, line, strlen(line), err);
    }
  }
  size_t at = header_bytes(base);
  return s == SV_OK ? sv_file_append(f, base->data + at, base->n - at, err) : s;
}

static void delta_of(const lab_model *m, int i, uint8_t out[4 * N_DELTA]) {
  static const int rows[N_DELTA] = {0, 1, 2, SV_ROW_SCALE, SV_ROW_SCALE + 1, SV_ROW_SCALE + 2, 3,
                                    4, 5, 6, SV_ROW_SH,    SV_ROW_SH + 1,    SV_ROW_SH + 2,    SV_ROW_LOGIT};
  const float *p = sv_gaussians_at(&m->g, i, 0), *q = m->g.moved + (p - m->g.param);
  bool is_moving = i < m->g.n_moved;
  bool is_gone = is_moving && q[16 * SV_ROW_LOGIT] < p[16 * SV_ROW_LOGIT] - FADED;
  for (int k = 0; k < N_DELTA; k++) {
    float d = is_moving ? q[16 * rows[k]] - p[16 * rows[k]] : 0.0f;
    sv_put_lef32(out + 4 * k, is_gone && k >= 3 && k < 6 ? VANISHED : d);
  }
}

static sv_status write_frames(lab_model *m, const lab_session *se, sv_file *f, int n_frames, sv_err *err) {
  uint8_t row[4 * N_DELTA];
  const lab_motion motion = lab_model_motion(m);
  sv_status s = SV_OK;
  for (int k = 0; k < n_frames && s == SV_OK; k++) {
    s = lab_motion_at(&motion, se, &m->g, (float)k / (float)(n_frames - 1), err);
    for (int i = 0; i < m->g.n && s == SV_OK; i++) {
      delta_of(m, i, row);
      s = sv_file_append(f, row, sizeof row, err);
    }
  }
  return s;
}

sv_status lab_write_delta(lab_model *m, const lab_session *se, int n_frames, const char *path, sv_err *err) {
  const sv_ply_options o = {.n = (uint32_t)m->g.n,
                            .sh_degree = m->g.sh_degree,
                            .is_mip = m->is_mip,
                            .dilation_px2 = m->dilation_px2,
                            .up = m->up[0] ? m->up : NULL,
                            .unit = m->unit,
                            .has_normals = true};
  sv_ply_writer w;
  sv_file f;
  if (!m->deform.kind && !m->sequence)
    return sv_fail(err, SV_E_NOT_FOUND, "the model is static: no motion.bin beside it");
  memory base = {.cap = sv_ply_file_bytes(&o) + 64};
  if (!(base.data = malloc(base.cap))) return sv_fail(err, SV_E_NOMEM, "%s: no memory for its base", path);
  const sv_model_notes notes = lab_model_notes(m);
  sv_status s = sv_model_write_ply(&m->g, &notes, (sv_sink){&base, append}, &w, err);
  if (s == SV_OK && (s = sv_file_begin(&f, path, err)) == SV_OK) {
    s = write_header(&base, &f, m->g.n, n_frames, err);
    if (s == SV_OK) s = write_frames(m, se, &f, n_frames, err);
    if (s == SV_OK) s = sv_file_commit(&f, err);
    else sv_file_abandon(&f);
  }
  free(base.data);
  return s;
}
