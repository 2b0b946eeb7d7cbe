// SPDX-License-Identifier: Apache-2.0
#include "tools/dataset/measurement.h"

#include <stdlib.h>
#include <string.h>

#include "src/base/mathx.h"

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

// Whether the image of a lens is there and tells what it sees through.
static bool has_alpha(lab_frame *f, const char *folder) {
  lab_peek peek;
  sv_err why;
  if (sv_path_join(f->path, sizeof f->path, folder, f->f.file_path, &why) != SV_OK) return false;
  return sv_path_exists(f->path) && lab_picture_peek(f->path, &peek, &why) == SV_OK && peek.n_channels == 4 &&
         peek.width_px == f->f.footprint.width_px && peek.height_px == f->f.footprint.height_px;
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
    lab_measurement *m = &v->measurements[f->i_measurement];
    m->has_alpha = has_alpha(f, folder) && (m->has_alpha || !m->n_lenses);
    m->n_lenses++;
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

// The share of light that a lens leaves on a pixel of its place, 1: all of it.
static float share_at(const lab_frame *f, size_t at) {
  return f->coverage ? (float)f->coverage[at] * (1.0f / 255.0f) : 1.0f;
}

sv_status lab_measurement_clear(const lab_views *v, int i_measurement, uint16_t *dst, sv_err *err) {
  const lab_measurement *m = &v->measurements[i_measurement];
  const size_t n_px = (size_t)m->width_px * (size_t)m->height_px;
  float *sum = calloc(n_px, sizeof *sum);
  sv_status s = sum ? SV_OK : sv_fail(err, SV_E_NOMEM, "%s: no memory for its alpha", m->path);
  for (int i = 0; i < v->n && s == SV_OK; i++) {
    const lab_frame *f = &v->frames[i];
    const sv_footprint *p = &f->f.footprint;
    sv_bitmap b;
    if (f->i_measurement != i_measurement) continue;
    s = sv_bitmap_read(f->path, &b, err);
    if (s == SV_OK) s = sv_bitmap_to_8(&b, err);
    if (s != SV_OK) break;
    for (int y = 0; y < p->height_px; y++)
      for (int x = 0; x < p->width_px; x++) {
        const size_t at = (size_t)y * (size_t)p->width_px + (size_t)x;
        const float clear = 1.0f - (float)b.u8[4 * at + 3] * (1.0f / 255.0f);
        sum[(size_t)(p->y0_px + y) * (size_t)m->width_px + (size_t)(p->x0_px + x)] += share_at(f, at) * clear;
      }
    sv_bitmap_free(&b);
  }
  for (size_t i = 0; i < n_px && s == SV_OK; i++)
    dst[i] = (uint16_t)(sv_minf(sum[i] / (float)m->max_overlap, 1.0f) * 65535.0f + 0.5f);
  free(sum);
  return s;
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
