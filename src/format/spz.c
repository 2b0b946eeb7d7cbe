// SPDX-License-Identifier: Apache-2.0
#include "src/format/spz.h"

#include <math.h>
#include <string.h>

#include "src/base/mathx.h"
#include "src/base/str.h"
#include "src/format/axes.h"
#include "src/format/bytes.h"

#define MAGIC     0x5053474eu // "NGSP"
#define FLAG_MIP  1
#define FLAG_MORE 2           // version 4: there are extension records
#define UNIT_TYPE 0x53560001u // of ours: float meters of a unit, float sigma of the scale
#define CAP_N     100000000u
#define DC_SCALE  0.15
#define HALF_SQRT 0.70710678118654752

static int n_sh(const sv_spz *z) { return (z->sh_degree + 1) * (z->sh_degree + 1) - 1; }
static int fraction(const sv_spz *z) { return z->fractional_bits ? z->fractional_bits : 12; }

static bool is_good(const sv_spz *z) {
  return z->version >= 2 && z->version <= 4 && z->sh_degree >= 0 && z->sh_degree <= 3 && z->n <= CAP_N &&
         z->fractional_bits >= 0 && z->fractional_bits < 24;
}

void sv_spz_stream(const sv_spz *z, int i, size_t *at, size_t *bytes) {
  const size_t width[SV_SPZ_N_STREAMS] = {9, 1, 3, 3, z->version == 2 ? 3 : 4, 3 * (size_t)n_sh(z)};
  *at = 0;
  for (int k = 0; k < i; k++) *at += width[k] * z->n;
  *bytes = width[i] * z->n;
}

size_t sv_spz_bytes(const sv_spz *z) {
  size_t at, bytes;
  if (!is_good(z)) return 0;
  sv_spz_stream(z, SV_SPZ_N_STREAMS - 1, &at, &bytes);
  return at + bytes;
}

static uint8_t *field(const sv_spz *z, const uint8_t *base, int stream, uint32_t i) {
  size_t at, bytes;
  sv_spz_stream(z, stream, &at, &bytes);
  return (uint8_t *)(uintptr_t)base + at + (z->n ? bytes / z->n * i : 0);
}

// --- numbers -------------------------------------------------------------------------------------

// NaN: lo
static double hold(double x, double lo, double hi) { return x > hi ? hi : x > lo ? x : lo; }
static uint8_t to_byte(double x) { return (uint8_t)floor(hold(x, 0, 255) + 0.5); }

static void put_fixed24(uint8_t *p, double x, int bits) {
  int32_t v = (int32_t)floor(hold(x * (double)(1 << bits), -8388608, 8388607) + 0.5);
  if (v > 8388607) v = 8388607;
  for (int k = 0; k < 3; k++) p[k] = (uint8_t)((uint32_t)v >> (8 * k));
}

static double get_fixed24(const uint8_t *p, int bits) {
  uint32_t v = (uint32_t)p[0] | (uint32_t)p[1] << 8 | (uint32_t)p[2] << 16;
  return ((double)v - (v & 0x800000 ? 16777216.0 : 0)) / (double)(1 << bits);
}

// Rounded to the middle of buckets of the coefficients' precision, which compress better.
static uint8_t sh_byte(float x, int bucket) {
  int q = (int)floor(hold((double)x * 128 + 128, -1024, 1024) + 0.5);
  q = (int)floor((double)(q + bucket / 2) / bucket) * bucket;
  return (uint8_t)sv_clampi(q, 0, 255);
}

static void unit_xyzw(double q[4], const float wxyz[4]) {
  double n = 0;
  for (int k = 0; k < 4; k++) n += (double)wxyz[k] * (double)wxyz[k];
  bool is_usable = n > 1e-30 && n < 1e30;
  n = is_usable ? sqrt(n) : 1;
  for (int k = 0; k < 4; k++) q[k] = is_usable ? (double)wxyz[(k + 1) % 4] / n : k == 3;
}

static void put_rotation(const sv_spz *z, uint8_t *p, const float wxyz[4]) {
  double q[4];
  unit_xyzw(q, wxyz);
  if (z->version == 2) {
    for (int k = 0; k < 3; k++) p[k] = to_byte((q[3] < 0 ? -q[k] : q[k]) * 127.5 + 127.5);
    return;
  }
  int largest = 0;
  for (int k = 1; k < 4; k++)
    if (fabs(q[k]) > fabs(q[largest])) largest = k;
  uint32_t v = (uint32_t)largest;
  bool is_turned = q[largest] < 0; // q and -q are one rotation; the largest is stored positive
  for (int k = 0; k < 4; k++) {
    if (k == largest) continue;
    uint32_t size = (uint32_t)floor(hold(fabs(q[k]) / HALF_SQRT, 0, 1) * 511 + 0.5);
    v = v << 10 | (uint32_t)((q[k] < 0) != is_turned) << 9 | size;
  }
  sv_put_le32(p, v);
}

static void get_rotation(const sv_spz *z, const uint8_t *p, float wxyz[4]) {
  double q[4] = {0}, sum = 0;
  int largest = 3;
  if (z->version == 2) {
    for (int k = 0; k < 3; k++) q[k] = p[k] / 127.5 - 1;
  } else {
    uint32_t v = sv_le32(p);
    largest = (int)(v >> 30);
    for (int k = 3; k >= 0; k--) {
      if (k == largest) continue;
      q[k] = HALF_SQRT * (double)(v & 511) / 511.0 * (v >> 9 & 1 ? -1 : 1);
      v >>= 10;
    }
  }
  for (int k = 0; k < 4; k++) sum += k == largest ? 0 : q[k] * q[k];
  q[largest] = sum < 1 ? sqrt(1 - sum) : 0;
  for (int k = 0; k < 4; k++) wxyz[(k + 1) % 4] = (float)q[k];
}

// --- one Gaussian --------------------------------------------------------------------------------

void sv_spz_put(const sv_spz *z, uint8_t *a, uint32_t i, const sv_gaussian *in) {
  sv_gaussian g = *in;
  sv_gaussian_turn(&g, SV_TURN_X);
  for (int k = 0; k < 3; k++) {
    put_fixed24(field(z, a, 0, i) + 3 * k, (double)g.mean[k], fraction(z));
    field(z, a, 2, i)[k] = to_byte((double)g.sh[0][k] * DC_SCALE * 255 + 127.5);
    field(z, a, 3, i)[k] = to_byte(((double)g.log_scale[k] + 10) * 16);
  }
  *field(z, a, 1, i) = to_byte(255 / (1 + sv_exp(-hold((double)g.opacity_logit, -30, 30))));
  put_rotation(z, field(z, a, 4, i), g.quat_wxyz);
  for (int k = 0; k < n_sh(z); k++)
    for (int c = 0; c < 3; c++) field(z, a, 5, i)[3 * k + c] = sh_byte(g.sh[k + 1][c], k < 3 ? 8 : 16);
}

void sv_spz_get(const sv_spz *z, const uint8_t *a, uint32_t i, sv_gaussian *g) {
  memset(g, 0, sizeof *g);
  for (int k = 0; k < 3; k++) {
    g->mean[k] = (float)get_fixed24(field(z, a, 0, i) + 3 * k, fraction(z));
    g->sh[0][k] = (float)((field(z, a, 2, i)[k] / 255.0 - 0.5) / DC_SCALE);
    g->log_scale[k] = (float)(field(z, a, 3, i)[k] / 16.0 - 10);
  }
  double o = hold(*field(z, a, 1, i) / 255.0, 1e-6, 1 - 1e-6);
  g->opacity_logit = (float)sv_log(o / (1 - o));
  get_rotation(z, field(z, a, 4, i), g->quat_wxyz);
  for (int k = 0; k < n_sh(z); k++)
    for (int c = 0; c < 3; c++) g->sh[k + 1][c] = (float)((field(z, a, 5, i)[3 * k + c] - 128) / 128.0);
  sv_gaussian_turn(g, SV_TURN_X);
}

// --- the unit ------------------------------------------------------------------------------------

static void put_unit(const sv_unit *u, uint8_t o[8]) {
  sv_put_lef32(o, 1);
  sv_put_lef32(o + 4, u->scale_sigma);
}

static void get_unit(sv_unit *u, const uint8_t *d) {
  const float sigma = sv_lef32(d + 4);
  u->is_metric = sv_lef32(d) == 1.0f;
  u->scale_sigma = sigma > 0 && sigma < 1 ? sigma : 0;
}

size_t sv_spz_put_extra(const sv_spz *z, uint8_t o[SV_SPZ_UNIT_BYTES]) {
  if (!z->unit.is_metric) return 0;
  memcpy(o, "SV\x08\x00", 4);
  put_unit(&z->unit, o + 4);
  return SV_SPZ_UNIT_BYTES;
}

void sv_spz_get_extra(sv_spz *z, const uint8_t *d, size_t bytes) {
  for (size_t at = 0; at + 4 <= bytes;) {
    const size_t n = d[at + 2] | (size_t)d[at + 3] << 8;
    if (n > bytes - at - 4) return;
    if (d[at] == 'S' && d[at + 1] == 'V' && n == 8) get_unit(&z->unit, d + at + 4);
    at += 4 + n;
  }
}

// Records from byte 32 to the table. Those of other vendors are skipped, and so is all behind a
// damaged length.
static void get_records(sv_spz *z, const uint8_t *d, size_t table) {
  for (size_t at = 32; at + 8 <= table;) {
    const size_t n = sv_le32(d + at + 4);
    if (n > table - at - 8) return;
    if (sv_le32(d + at) == UNIT_TYPE && n == 8) get_unit(&z->unit, d + at + 8);
    at += 8 + n;
  }
}

// --- headers -------------------------------------------------------------------------------------

void sv_spz_header(const sv_spz *z, uint8_t o[SV_SPZ_HEADER_BYTES]) {
  sv_put_le32(o, MAGIC);
  sv_put_le32(o + 4, (uint32_t)z->version);
  sv_put_le32(o + 8, z->n);
  o[12] = (uint8_t)z->sh_degree;
  o[13] = (uint8_t)fraction(z);
  o[14] = z->is_mip ? FLAG_MIP : 0;
  o[15] = 0;
}

size_t sv_spz_head4(const sv_spz *z, const uint64_t compressed[SV_SPZ_N_STREAMS],
                    uint8_t o[SV_SPZ_HEAD4_BYTES]) {
  memset(o, 0, SV_SPZ_HEAD4_BYTES);
  sv_spz_header(z, o);
  const int n = z->sh_degree > 0 ? SV_SPZ_N_STREAMS : SV_SPZ_N_STREAMS - 1;
  const size_t table = z->unit.is_metric ? 48 : 32;
  o[15] = (uint8_t)n;
  if (z->unit.is_metric) {
    o[14] |= FLAG_MORE;
    sv_put_le32(o + 32, UNIT_TYPE);
    sv_put_le32(o + 36, 8);
    put_unit(&z->unit, o + 40);
  }
  sv_put_le32(o + 16, (uint32_t)table);
  for (int i = 0; i < n; i++) {
    size_t at, bytes;
    sv_spz_stream(z, i, &at, &bytes);
    sv_put_le64(o + table + 16 * (size_t)i, compressed[i]);
    sv_put_le64(o + table + 8 + 16 * (size_t)i, bytes);
  }
  return table + 16 * (size_t)n;
}

bool sv_spz_is_4(const uint8_t *data, size_t bytes) { return bytes >= 4 && sv_le32(data) == MAGIC; }

static sv_status read_header(sv_spz *z, const char *name, const uint8_t *d, sv_err *err) {
  uint32_t version = sv_le32(d + 4);
  *z =
      (sv_spz){.n = sv_le32(d + 8), .sh_degree = d[12], .fractional_bits = d[13], .is_mip = d[14] & FLAG_MIP};
  if (version < 2 || version > 4)
    return sv_fail(err, SV_E_UNSUPPORTED, "%s: SPZ version %u; 2, 3 or 4 was expected", name, version);
  z->version = (int)version;
  if (d[12] > 3) return sv_fail(err, SV_E_UNSUPPORTED, "%s: SH degree %d; 0 to 3 was expected", name, d[12]);
  if (d[13] < 1 || d[13] > 23 || z->n > CAP_N)
    return sv_fail(err, SV_E_FORMAT, "%s: %u Gaussians with %d fractional bits is no SPZ header", name, z->n,
                   d[13]);
  return SV_OK;
}

sv_status sv_spz_open(sv_spz *z, const sv_file_data *stream, sv_err *err) {
  const char *name = stream->name;
  const uint8_t *d = stream->data;
  const size_t bytes = stream->bytes;
  if (bytes < SV_SPZ_HEADER_BYTES || sv_le32(d) != MAGIC)
    return sv_fail(err, SV_E_FORMAT, "%s: not an SPZ file: it does not begin with NGSP", name);
  sv_status s = read_header(z, name, d, err);
  if (s < 0) return s;
  if (z->version == 4) return sv_fail(err, SV_E_FORMAT, "%s: SPZ version 4 inside of gzip", name);
  if (bytes - SV_SPZ_HEADER_BYTES != sv_spz_bytes(z))
    return sv_fail(err, SV_E_FORMAT, "%s: %zu bytes of attributes; %zu were expected for %u Gaussians", name,
                   bytes - SV_SPZ_HEADER_BYTES, sv_spz_bytes(z), z->n);
  return SV_OK;
}

sv_status sv_spz_open4(sv_spz *z, const sv_file_data *file, size_t at[SV_SPZ_N_STREAMS],
                       size_t compressed[SV_SPZ_N_STREAMS], sv_err *err) {
  const char *name = file->name;
  const uint8_t *d = file->data;
  const size_t bytes = file->bytes;
  if (!sv_spz_is_4(d, bytes))
    return sv_fail(err, SV_E_FORMAT, "%s: not an SPZ file: it does not begin with NGSP", name);
  if (bytes < 32) return sv_fail(err, SV_E_FORMAT, "%s: the file ends early, in its header", name);
  sv_status s = read_header(z, name, d, err);
  if (s < 0) return s;
  const uint32_t table = sv_le32(d + 16);
  const int n = d[15], wanted = z->sh_degree > 0 ? SV_SPZ_N_STREAMS : SV_SPZ_N_STREAMS - 1;
  if (z->version != 4 || n < wanted || n > SV_SPZ_N_STREAMS || table < 32)
    return sv_fail(err, SV_E_FORMAT, "%s: the table of %d streams at byte %u is not that of an SPZ file",
                   name, n, table);
  if (table > bytes || 16 * (size_t)n > bytes - table)
    return sv_fail(err, SV_E_FORMAT, "%s: the file ends early, before the end of its table of streams", name);
  if (d[14] & FLAG_MORE) get_records(z, d, table);
  size_t next = table + 16 * (size_t)n;
  for (int i = 0; i < SV_SPZ_N_STREAMS; i++) {
    size_t ignored, raw;
    sv_spz_stream(z, i, &ignored, &raw);
    uint64_t c = i < n ? sv_le64(d + table + 16 * i) : 0, u = i < n ? sv_le64(d + table + 16 * i + 8) : 0;
    if (u != raw)
      return sv_fail(err, SV_E_FORMAT, "%s: stream %d has %llu bytes; %zu were expected", name, i,
                     (unsigned long long)u, raw);
    if (c > bytes - next)
      return sv_fail(err, SV_E_FORMAT,
                     "%s: the file ends early: stream %d takes %llu bytes from byte %zu, and %zu are there",
                     name, i, (unsigned long long)c, next, bytes - next);
    at[i] = next;
    compressed[i] = raw ? (size_t)c : 0;
    next += (size_t)c;
  }
  return SV_OK;
}
