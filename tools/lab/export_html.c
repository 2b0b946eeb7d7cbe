// SPDX-License-Identifier: Apache-2.0
#include "tools/lab/export_html.h"

#include <stdlib.h>
#include <string.h>

#include "platform/preview/bundle.h"
#include "platform/preview/compact.h"
#include "src/base/str.h"
#include "src/format/axes.h"

#define DISTANCE 2.2f // of the first viewpoint from the centre, in radii
#define FOV_Y    0.8f // radians

// A snapshot as a run publishes it.
static sv_feed_model *snapshot(const lab_model *m, const lab_settings *st) {
  const size_t n_floats = SV_GAUSSIAN_N_FLOATS((size_t)m->g.sh_degree);
  sv_feed_model *f = malloc(sizeof *f + (size_t)m->g.n * n_floats * sizeof(float));
  if (!f) return NULL;
  *f = (sv_feed_model){.n = (uint32_t)m->g.n,
                       .sh_degree = (uint32_t)m->g.sh_degree,
                       .n_floats = (uint32_t)n_floats,
                       .is_mip = m->is_mip,
                       .dilation_px2 = st->dilation_px2,
                       .background = m->background,
                       .radius = st->radius,
                       .is_metric = m->unit.is_metric,
                       .scale_sigma = m->unit.scale_sigma,
                       .fov_y = FOV_Y};
  double up[3] = {0, -1, 0};
  (void)sv_up_axis(*m->up ? m->up : SV_UP_DEFAULT, up);
  const int across = up[0] == 0 ? 0 : 1; // an axis that is level
  for (int k = 0; k < 3; k++) {
    f->up[k] = (float)up[k];
    f->centre[k] = st->centre[k];
    f->eye[k] = st->centre[k] + DISTANCE * st->radius * ((k == across ? 0.92f : 0) + 0.39f * (float)up[k]);
  }
  for (int i = 0; i < m->g.n; i++) {
    sv_gaussian g;
    sv_gaussians_get(&m->g, i, &g);
    memcpy((float *)(f + 1) + (size_t)i * n_floats, &g, n_floats * sizeof(float));
  }
  return f;
}

static char *base64(const uint8_t *in, size_t n) {
  static const char digits[] = "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
  char *out = malloc((n + 2) / 3 * 4 + 1), *o = out;
  for (size_t i = 0; out && i < n; i += 3) {
    const size_t left = n - i;
    const uint32_t v =
        (uint32_t)in[i] << 16 | (left > 1 ? (uint32_t)in[i + 1] << 8 : 0) | (left > 2 ? in[i + 2] : 0);
    for (size_t k = 0; k < 4; k++) *o++ = k > left ? '=' : digits[v >> (18 - 6 * k) & 63];
  }
  if (out) *o = 0;
  return out;
}

static sv_status put_file(sv_file *f, const char *path, sv_err *err) {
  const pv_page *p;
  for (int i = 0; (p = pv_bundle(i)); i++)
    if (sv_str_eq(p->path, path)) return sv_file_append(f, p->text, p->bytes, err);
  return sv_fail(err, SV_E_NOT_FOUND, "%s: not part of this build", path);
}

// Letters, digits and a few signs of a name: what needs no escape.
static sv_status put_title(sv_file *f, const char *path, sv_err *err) {
  char title[64];
  size_t n = 0;
  for (const char *p = sv_path_name(path); *p && n + 1 < sizeof title; p++)
    title[n++] = *p == '<' || *p == '>' || *p == '&' || *p == '"' || *p == '{' ? '_' : *p;
  title[n] = 0;
  sv_make_utf8(title);
  return sv_file_append(f, title, strlen(title), err);
}

static sv_status put_part(sv_file *f, const char *name, const char *path, const char *model, sv_err *err) {
  if (!strncmp(name, "title", 5)) return put_title(f, path, err);
  if (!strncmp(name, "model", 5)) return sv_file_append(f, model, strlen(model), err);
  const bool is_worker = !strncmp(name, "worker", 6);
  sv_status s = put_file(f, is_worker ? "/raster.js" : "/paint.js", err);
  return s == SV_OK ? put_file(f, is_worker ? "/sorter.js" : "/view.js", err) : s;
}

static sv_status write(const char *path, const char *model, sv_err *err) {
  sv_file f;
  sv_status s = sv_file_begin(&f, path, err);
  if (s != SV_OK) return s;
  for (const char *p = pv_viewer(); s == SV_OK && *p;) {
    const char *mark = strstr(p, "{{"), *end = mark ? strstr(mark, "}}") : NULL;
    const size_t n = end ? (size_t)(mark - p) : strlen(p);
    s = sv_file_append(&f, p, n, err);
    if (s == SV_OK && end) s = put_part(&f, mark + 2, path, model, err);
    p = end ? end + 2 : p + n;
  }
  if (s == SV_OK) return sv_file_commit(&f, err);
  sv_file_abandon(&f);
  return s;
}

sv_status lab_write_html(const lab_model *m, const lab_settings *st, const char *path, sv_err *err) {
  if (m->deform.kind || m->sequence)
    return sv_fail(err, SV_E_UNSUPPORTED, "%s: the model moves; --format html is for still ones", path);
  sv_feed_model *f = snapshot(m, st);
  uint8_t *packed = f ? malloc(pv_compact_bytes(f)) : NULL;
  if (packed) pv_compact_put(f, 1, packed);
  char *text = packed ? base64(packed, pv_compact_bytes(f)) : NULL;
  sv_status s = text ? write(path, text, err)
                     : sv_fail(err, SV_E_NOMEM, "%s: no memory for %d Gaussians", path, m->g.n);
  free(text);
  free(packed);
  free(f);
  return s;
}
