// SPDX-License-Identifier: Apache-2.0
#include "src/deform/deform_sequence.h"

static sv_sequence_head head_of(const sv_deform *d, const sv_gaussians *g, const sv_sequence_head *h) {
  sv_sequence_head out = *h;
  out.n = (uint32_t)g->n;
  out.n_moving = (uint32_t)sv_deform_n_moving(d);
  out.sh_degree = g->sh_degree;
  if (!out.group) out.group = h->n_frames < SV_SEQUENCE_GROUP ? h->n_frames : SV_SEQUENCE_GROUP;
  return out;
}

size_t sv_deform_sequence_bytes(int n, int n_frames) {
  const sv_sequence_head h = {
      .n = (uint32_t)n, .n_moving = (uint32_t)n, .n_frames = (uint32_t)n_frames, .group = 1, .radius = 1};
  return sv_sequence_writer_bytes(&h);
}

static float base_value(const void *self, uint32_t i, int row) { return *sv_gaussians_at(self, (int)i, row); }

static float moved_value(const void *self, uint32_t i, int row) {
  const sv_gaussians *g = self;
  return g->moved[sv_gaussians_at(g, (int)i, row) - g->param];
}

sv_status sv_deform_write_sequence(sv_deform *d, const sv_compute *c, sv_gaussians *g,
                                   const sv_sequence_head *h, void *scratch, sv_sink sink, sv_err *err) {
  const sv_sequence_head head = head_of(d, g, h);
  const sv_sequence_source source = {g, base_value, moved_value};
  sv_sequence_writer w;
  sv_status s = sv_sequence_begin(&w, &head, &source, scratch, sink, err);
  for (uint32_t k = 0; k < head.n_frames && s == SV_OK; k++) {
    sv_deform_at(d, c, g, (float)k / (float)(head.n_frames - 1));
    s = sv_sequence_frame(&w, err);
  }
  return s == SV_OK ? sv_sequence_end(&w, err) : s;
}
