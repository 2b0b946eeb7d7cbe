// SPDX-License-Identifier: Apache-2.0
// PlayCanvas's compressed PLY (developer.playcanvas.com, "Compressed PLY"): chunks of 256 Gaussians
// with the ranges of their values, then 16 bytes a Gaussian, then its SH in bytes.
#include <math.h>
#include <stdlib.h>

#include "src/base/mathx.h"
#include "src/base/str.h"
#include "src/format/bytes.h"
#include "tools/lab/curve.h"
#include "tools/lab/model_formats.h"

#define CHUNK        256
#define N_RANGES     9 // x y z, scale x y z, r g b
#define CHUNK_BYTES  (4 * 2 * N_RANGES)
#define VERTEX_BYTES 16
#define CAP_HEADER   4096
#define MAX_SCALE    20.0f // of logarithms, as readers expect
#define SH_RANGE     8.0   // -4 to 4

static float value(const sv_gaussian *g, int k) {
  if (k < 3) return g->mean[k];
  if (k < 6) return sv_clampf(g->log_scale[k - 3], -MAX_SCALE, MAX_SCALE);
  return 0.5f + (float)SV_SH_C0 * g->sh[0][k - 6];
}

static unsigned quantize(double u, int bits) {
  const double most = (1 << bits) - 1;
  return (unsigned)fmin(fmax(floor(u * most + 0.5), 0), most);
}

typedef struct {
  float lo[N_RANGES], hi[N_RANGES];
} ranges;

static ranges ranges_of(const sv_gaussian *v, int n) {
  ranges r;
  for (int k = 0; k < N_RANGES; k++) {
    r.lo[k] = r.hi[k] = value(&v[0], k);
    for (int i = 1; i < n; i++) {
      r.lo[k] = sv_minf(r.lo[k], value(&v[i], k));
      r.hi[k] = sv_maxf(r.hi[k], value(&v[i], k));
    }
  }
  return r;
}

// Three values from the k-th in 11, 10 and 11 bits of their ranges.
static uint32_t pack_three(const sv_gaussian *g, const ranges *r, int k) {
  static const int bits[3] = {11, 10, 11};
  uint32_t out = 0;
  for (int i = 0; i < 3; i++) {
    const double lo = (double)r->lo[k + i], span = (double)r->hi[k + i] - lo;
    out = out << bits[i] | quantize(span > 0 ? ((double)value(g, k + i) - lo) / span : 0, bits[i]);
  }
  return out;
}

// Which component is the largest, and the other three in 10 bits each.
static uint32_t pack_rotation(const float q[4]) {
  const double norm = sqrt((double)(q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3]));
  int largest = 0;
  for (int k = 1; k < 4; k++)
    if (fabsf(q[k]) > fabsf(q[largest])) largest = k;
  const double scale = (q[largest] < 0 ? -1 : 1) * sqrt(0.5) / (norm > 0 ? norm : 1);
  uint32_t out = (uint32_t)largest;
  for (int k = 0; k < 4; k++)
    if (k != largest) out = out << 10 | quantize((double)q[k] * scale + 0.5, 10);
  return out;
}

static uint32_t pack_color(const sv_gaussian *g, const ranges *r) {
  uint32_t out = 0;
  for (int k = 6; k < N_RANGES; k++) {
    const double lo = (double)r->lo[k], span = (double)r->hi[k] - lo;
    out = out << 8 | quantize(span > 0 ? ((double)value(g, k) - lo) / span : 0, 8);
  }
  // 0 and 255 would be read as infinite logits.
  const unsigned opacity = quantize(1.0 / (1.0 + exp(-(double)g->opacity_logit)), 8);
  return out << 8 | (opacity < 1 ? 1 : opacity > 254 ? 254 : opacity);
}

static void put_chunk(uint8_t *to, const ranges *r) {
  for (int part = 0; part < 3; part++)
    for (int k = 0; k < 3; k++) {
      sv_put_lef32(to + 4 * (6 * part + k), r->lo[3 * part + k]);
      sv_put_lef32(to + 4 * (6 * part + 3 + k), r->hi[3 * part + k]);
    }
}

static void put_sh(uint8_t *to, const sv_gaussian *g, int n_rest) {
  for (int c = 0; c < 3; c++)
    for (int k = 0; k < n_rest; k++) {
      const double u = floor(((double)g->sh[1 + k][c] / SH_RANGE + 0.5) * 256);
      *to++ = (uint8_t)fmin(fmax(u, 0), 255);
    }
}

static void add_names(sv_str *t, const char *const *names, int n, const char *type) {
  for (int i = 0; i < n; i++) sv_str_add(t, "property %s %s\n", type, names[i]);
}

static size_t put_header(char out[CAP_HEADER], const sv_gaussians *g, int n_rest,
                         const sv_model_notes *notes) {
  static const char *const of_chunk[] = {
      "min_x",       "min_y",       "min_z",       "max_x",       "max_y",       "max_z",
      "min_scale_x", "min_scale_y", "min_scale_z", "max_scale_x", "max_scale_y", "max_scale_z",
      "min_r",       "min_g",       "min_b",       "max_r",       "max_g",       "max_b"};
  static const char *const of_vertex[] = {"packed_position", "packed_rotation", "packed_scale",
                                          "packed_color"};
  sv_str t = sv_str_make(out, CAP_HEADER);
  sv_str_add(&t, "ply\nformat binary_little_endian 1.0\n");
  if (notes->unit.is_metric) sv_str_add(&t, "comment SplatUnit: m\n");
  if (notes->unit.scale_sigma > 0)
    sv_str_add(&t, "comment SplatScaleSigma: %.3g\n", (double)notes->unit.scale_sigma);
  sv_str_add(&t, "element chunk %d\n", (g->n + CHUNK - 1) / CHUNK);
  add_names(&t, of_chunk, 2 * N_RANGES, "float");
  sv_str_add(&t, "element vertex %d\n", g->n);
  add_names(&t, of_vertex, VERTEX_BYTES / 4, "uint");
  if (n_rest) sv_str_add(&t, "element sh %d\n", g->n);
  for (int i = 0; i < 3 * n_rest; i++) sv_str_add(&t, "property uchar f_rest_%d\n", i);
  sv_str_add(&t, "end_header\n");
  return t.len;
}

sv_status lab_write_compressed_ply(const sv_gaussians *g, const sv_model_notes *notes, const char *path,
                                   sv_err *err) {
  const int n_rest = (g->sh_degree + 1) * (g->sh_degree + 1) - 1, n_chunks = (g->n + CHUNK - 1) / CHUNK;
  const size_t sh_bytes = 3 * (size_t)n_rest, n = (size_t)g->n;
  const size_t cap = CAP_HEADER + (size_t)n_chunks * CHUNK_BYTES + n * (VERTEX_BYTES + sh_bytes);
  uint8_t *file = malloc(cap);
  sv_gaussian *v = lab_curve_order(g, NULL);
  sv_status s = file && v ? SV_OK : sv_fail(err, SV_E_NOMEM, "%s: no memory for %d Gaussians", path, g->n);
  if (s == SV_OK) {
    uint8_t *chunk = file + put_header((char *)file, g, n_rest, notes);
    uint8_t *vertex = chunk + (size_t)n_chunks * CHUNK_BYTES, *sh = vertex + n * VERTEX_BYTES;
    ranges r = {{0}, {0}};
    for (int i = 0; i < g->n; i++) {
      if (i % CHUNK == 0) {
        r = ranges_of(v + i, sv_mini(CHUNK, g->n - i));
        put_chunk(chunk + (size_t)(i / CHUNK) * CHUNK_BYTES, &r);
      }
      uint8_t *to = vertex + (size_t)i * VERTEX_BYTES;
      sv_put_le32(to, pack_three(&v[i], &r, 0));
      sv_put_le32(to + 4, pack_rotation(v[i].quat_wxyz));
      sv_put_le32(to + 8, pack_three(&v[i], &r, 3));
      sv_put_le32(to + 12, pack_color(&v[i], &r));
      put_sh(sh + (size_t)i * sh_bytes, &v[i], n_rest);
    }
    s = sv_file_write(path, file, (size_t)(sh - file) + n * sh_bytes, err);
  }
  free(file);
  free(v);
  return s;
}
