// SPDX-License-Identifier: Apache-2.0
#include <string.h>

#include "src/base/str.h"
#include "src/format/bytes.h"
#include "src/format/ply.h"

static sv_status flush(sv_ply_writer *w, sv_err *err) {
  size_t n = w->n_buffered;
  w->n_buffered = 0;
  return n ? w->sink.write(w->sink.self, w->buffer, n, err) : SV_OK;
}

// bytes <= the buffer
static sv_status put(sv_ply_writer *w, const void *data, size_t bytes, sv_err *err) {
  if (w->n_buffered + bytes > sizeof w->buffer) {
    sv_status s = flush(w, err);
    if (s != SV_OK) return s;
  }
  memcpy(w->buffer + w->n_buffered, data, bytes);
  w->n_buffered += bytes;
  return SV_OK;
}

static int n_rest(int degree) { return 3 * ((degree + 1) * (degree + 1) - 1); }

// Line i of the header, terminated; false after the last.
static bool header_line(const sv_ply_options *o, int i, char line[80]) {
  static const struct {
    const char *name;
    int n; // 0: not numbered
  } props[] = {{"x", 0},     {"y", 0},        {"z", 0},       {"nx", 0},     {"ny", 0},  {"nz", 0},
               {"f_dc_", 3}, {"f_rest_", -1}, {"opacity", 0}, {"scale_", 3}, {"rot_", 4}};
  switch (i) {
  case 0: return sv_fmt(line, 80, "ply\n") > 0;
  case 1: return sv_fmt(line, 80, "format binary_little_endian 1.0\n") > 0;
  case 2:
    line[0] = 0;
    if (o->vertical) sv_fmt(line, 80, "comment Vertical axis: %.3s\n", o->vertical);
    return true;
  case 3: return sv_fmt(line, 80, "comment SH degree: %d\n", o->sh_degree) > 0;
  case 4: return sv_fmt(line, 80, "comment SplatRenderMode: %s\n", o->is_mip ? "mip" : "default") > 0;
  case 5:
    line[0] = 0;
    if (o->dilation_px2 > 0) sv_fmt(line, 80, "comment SplatDilation: %.4g\n", (double)o->dilation_px2);
    return true;
  case 6:
    line[0] = 0;
    if (o->up) sv_fmt(line, 80, "comment SplatUp: %-2.2s\n", o->up);
    return true;
  case 7:
    line[0] = 0;
    if (o->unit.is_metric) sv_fmt(line, 80, "comment SplatUnit: m\n");
    return true;
  case 8:
    line[0] = 0;
    if (o->unit.scale_sigma > 0)
      sv_fmt(line, 80, "comment SplatScaleSigma: %.3g\n", (double)o->unit.scale_sigma);
    return true;
  case 9:
    line[0] = 0;
    if (o->background) sv_fmt(line, 80, "comment SplatBackground: #%06x\n", o->background);
    return true;
  case 10: return sv_fmt(line, 80, "element vertex %u\n", o->n) > 0;
  default: i -= 11;
  }
  for (size_t k = 0; k < sizeof props / sizeof *props; k++) {
    if (k >= 3 && k < 6 && !o->has_normals) continue;
    int n = props[k].n < 0 ? n_rest(o->sh_degree) : props[k].n;
    if (props[k].n == 0) {
      if (i-- == 0) return sv_fmt(line, 80, "property float %s\n", props[k].name) > 0;
    } else {
      if (i < n) return sv_fmt(line, 80, "property float %s%d\n", props[k].name, i) > 0;
      i -= n;
    }
  }
  return i == 0 && sv_fmt(line, 80, "end_header\n") > 0;
}

static bool are_options_good(const sv_ply_options *o) { return o->sh_degree >= 0 && o->sh_degree <= 3; }

static size_t vertex_bytes(const sv_ply_options *o) {
  return sizeof(float) * (size_t)(14 + n_rest(o->sh_degree) + (o->has_normals ? 3 : 0));
}

size_t sv_ply_file_bytes(const sv_ply_options *o) {
  char line[80];
  size_t n = 0;
  if (!are_options_good(o)) return 0;
  for (int i = 0; header_line(o, i, line); i++) n += strlen(line);
  return n + vertex_bytes(o) * o->n;
}

sv_status sv_ply_write_begin(sv_ply_writer *w, sv_sink sink, const sv_ply_options *options, sv_err *err) {
  if (!are_options_good(options))
    return sv_fail(err, SV_E_ARG, "PLY: SH degree %d; 0 to 3 was expected", options->sh_degree);
  w->sink = sink;
  w->options = *options;
  w->n_written = 0;
  w->n_buffered = 0;
  char line[80];
  for (int i = 0; header_line(options, i, line); i++) {
    sv_status s = put(w, line, strlen(line), err);
    if (s != SV_OK) return s;
  }
  return SV_OK;
}

sv_status sv_ply_write_gaussian(sv_ply_writer *w, const sv_gaussian *g, sv_err *err) {
  uint8_t row[(SV_GAUSSIAN_FLOATS + 3) * sizeof(float)], *o = row;
  if (w->n_written == w->options.n)
    return sv_fail(err, SV_E_FULL, "PLY: more Gaussians than the %u announced", w->options.n);
  w->n_written++;
  for (int c = 0; c < 3; c++, o += 4) sv_put_lef32(o, g->mean[c]);
  if (w->options.has_normals)
    for (int c = 0; c < 3; c++, o += 4) sv_put_lef32(o, 0);
  for (int c = 0; c < 3; c++, o += 4) sv_put_lef32(o, g->sh[0][c]);
  int per_channel = n_rest(w->options.sh_degree) / 3;
  for (int c = 0; c < 3; c++)
    for (int k = 1; k <= per_channel; k++, o += 4) sv_put_lef32(o, g->sh[k][c]);
  sv_put_lef32(o, g->opacity_logit);
  o += 4;
  for (int c = 0; c < 3; c++, o += 4) sv_put_lef32(o, g->log_scale[c]);
  for (int c = 0; c < 4; c++, o += 4) sv_put_lef32(o, g->quat_wxyz[c]);
  return put(w, row, (size_t)(o - row), err);
}

sv_status sv_ply_write_end(sv_ply_writer *w, sv_err *err) {
  if (w->n_written != w->options.n)
    return sv_fail(err, SV_E_ARG, "PLY: %u Gaussians were announced, %u came", w->options.n, w->n_written);
  return flush(w, err);
}
