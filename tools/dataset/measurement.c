// SPDX-License-Identifier: Apache-2.0
#include "tools/dataset/measurement.h"

#include <stdlib.h>
#include <string.h>

// Where measurements are listed. is_white: those of display values are preferred.
typedef struct {
  const sv_transforms *t;
  const char *folder;
  bool is_white;
} listing;

static sv_status find_one(lab_measurement *m, const listing *in, sv_err *err) {
  sv_transforms_measurement c;
  lab_peek peek;
  m->is_linear = !in->is_white;
  sv_status s = sv_transforms_find_measurement(in->t, m->is_linear, m->exposure, &c, err);
  if (s == SV_END) {
    m->is_linear = !m->is_linear;
    s = sv_transforms_find_measurement(in->t, m->is_linear, m->exposure, &c, err);
  }
  if (s != SV_OK) return s;
  m->max_overlap = c.max_overlap;
  s = sv_path_join(m->path, sizeof m->path, in->folder, c.file_path, err);
  if (s == SV_OK && !sv_path_exists(m->path))
    s = sv_fail(err, SV_E_NOT_FOUND, "%s: measurement not found (listed in the transforms file)", m->path);
  if (s == SV_OK) s = lab_picture_peek(m->path, &peek, err);
  if (s != SV_OK) return s;
  m->width_px = peek.width_px;
  m->height_px = peek.height_px;
  return SV_OK;
}

// The measurement of an exposure, made when it is the exposure's first frame; NULL: the file has
// none.
static sv_status measurement_of(lab_views *v, int exposure, const listing *in, int *out, sv_err *err) {
  for (*out = 0; *out < v->n_measurements; ++*out)
    if (v->measurements[*out].exposure == exposure) return SV_OK;
  lab_measurement *m = &v->measurements[v->n_measurements];
  *m = (lab_measurement){.exposure = exposure};
  sv_status s = find_one(m, in, err);
  if (s == SV_OK) v->n_measurements++;
  if (s != SV_END) return s;
  *out = -1;
  return SV_OK;
}

// The share of light that a lens leaves on each pixel of its place.
static sv_status load_coverage(lab_frame *f, const char *folder, sv_err *err) {
  char path[SV_CAP_PATH];
  sv_bitmap b;
  sv_status s = sv_path_join(path, sizeof path, folder, f->f.coverage_path, err);
  if (s == SV_OK) s = sv_bitmap_read(path, &b, err);
  if (s == SV_OK) s = sv_bitmap_to_8(&b, err);
  if (s == SV_OK) s = sv_bitmap_to_channels(&b, 1, err);
  if (s != SV_OK) return s;
  if (b.width_px != f->f.footprint.width_px || b.height_px != f->f.footprint.height_px) {
    s = sv_fail(err, SV_E_FORMAT, "%s: the coverage is %dx%d, its footprint %dx%d pixels", path, b.width_px,
                b.height_px, f->f.footprint.width_px, f->f.footprint.height_px);
    sv_bitmap_free(&b);
    return s;
  }
  f->coverage = b.u8;
  f->f.footprint.coverage = b.u8;
  return SV_OK;
}

sv_status lab_measurements_find(lab_views *v, const sv_transforms *t, const char *folder, bool is_white,
                                sv_err *err) {
  const listing in = {t, folder, is_white};
  v->measurements = calloc((size_t)v->n, sizeof *v->measurements);
  if (!v->measurements) return sv_fail(err, SV_E_NOMEM, "no memory for the measurements");
  for (int i = 0; i < v->n; i++) {
    lab_frame *f = &v->frames[i];
    f->i_measurement = -1;
    if (!f->f.footprint.width_px || f->f.exposure < 0) continue;
    sv_status s = measurement_of(v, f->f.exposure, &in, &f->i_measurement, err);
    if (s != SV_OK) return s;
    if (f->i_measurement < 0) continue;
    v->measurements[f->i_measurement].n_lenses++;
    s = *f->f.coverage_path ? load_coverage(f, folder, err) : SV_OK;
    if (s != SV_OK) return s;
  }
  if (v->n_measurements && v->scale > 1)
    return sv_fail(err, SV_E_UNSUPPORTED, "%s: overlapping lens images cannot be downscaled; omit --scale",
                   v->measurements[0].path);
  return SV_OK;
}

sv_status lab_measurement_lenses(const lab_views *v, int i_measurement, sv_lens *out, sv_multiplexed *model,
                                 sv_err *err) {
  const lab_measurement *m = &v->measurements[i_measurement];
  int n = 0;
  for (int i = 0; i < v->n; i++)
    if (v->frames[i].i_measurement == i_measurement)
      out[n++] = (sv_lens){v->frames[i].view, v->frames[i].f.footprint};
  *model = (sv_multiplexed){.width_px = m->width_px,
                            .height_px = m->height_px,
                            .n_lenses = n,
                            .lenses = out,
                            .max_overlap = (float)m->max_overlap,
                            .is_linear = m->is_linear};
  sv_err why;
  sv_status s = sv_multiplexed_check(model, &why);
  return s == SV_OK ? s : sv_fail(err, s, "%s: %s", m->path, why.text);
}

sv_status lab_measurement_load(const lab_measurement *m, uint16_t *dst, sv_err *err) {
  sv_bitmap b;
  sv_status s = sv_bitmap_read(m->path, &b, err);
  if (s == SV_OK) s = sv_bitmap_to_channels(&b, 3, err);
  if (s != SV_OK) return s;
  size_t n = lab_measurement_values(m);
  for (size_t i = 0; i < n; i++) dst[i] = b.bits == 16 ? b.u16[i] : (uint16_t)(257 * b.u8[i]);
  sv_bitmap_free(&b);
  return SV_OK;
}
