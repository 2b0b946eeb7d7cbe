// SPDX-License-Identifier: Apache-2.0
#include "tools/metric/lpips.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "src/format/crc32c.h"
#include "tools/common/fileio.h"
#include "tools/metric/features.h"
#include "tools/metric/lpips_weights.h"

#define HEADER_BYTES 24
#define CAP_LINEAR   2240 // channels of all taps
#define LANES        8
#define EPS          1e-10f

// How the networks of LPIPS see their input, which is in [-1,1]: (x - shift) / scale.
static const float shift[3] = {-0.030f, -0.088f, -0.188f}, scale[3] = {0.458f, 0.448f, 0.450f};

struct sv_lpips {
  sv_net net;
  float linear[CAP_LINEAR];  // of all taps, one after the other
  float *tap_map, *full_map; // [height][width] of the largest tap, and of the image
  size_t cap_tap, cap_full;
};

// --- weights -------------------------------------------------------------------------------------

static uint32_t le32(const uint8_t *p) {
  return (uint32_t)p[0] | (uint32_t)p[1] << 8 | (uint32_t)p[2] << 16 | (uint32_t)p[3] << 24;
}

static size_t n_linear(sv_net_kind kind) {
  size_t n = 0;
  for (int i = 0; i < sv_net_taps(kind); i++) n += (size_t)sv_net_tap_channels(kind, i);
  return n;
}

static sv_status check(const char *name, const uint8_t *p, size_t bytes, size_t n, sv_err *err) {
  if (bytes != HEADER_BYTES + 4 * n || memcmp(p, "SVLPIPS1", 8) != 0 || le32(p + 8) != 4 || le32(p + 12) != n)
    return sv_fail(err, SV_E_FORMAT,
                   "%s: not the expected %zu weights of LPIPS (tools/weights/convert_lpips.py)", name, n);
  if (sv_crc32c(0, p + HEADER_BYTES, 4 * n) != le32(p + 16))
    return sv_fail(err, SV_E_FORMAT, "%s: the weights of LPIPS are damaged (CRC)", name);
  return SV_OK;
}

static sv_status unpack(sv_lpips *l, sv_net_kind kind, const uint8_t *p, sv_err *err) {
  const size_t n = sv_net_floats(kind) + n_linear(kind);
  float *values = malloc(n * sizeof *values);
  sv_status s = values ? SV_OK : SV_E_NOMEM;
  for (size_t i = 0; s == SV_OK && i < n; i++) {
    uint32_t bits = le32(p + HEADER_BYTES + 4 * i);
    memcpy(&values[i], &bits, sizeof bits);
  }
  if (s == SV_OK) s = sv_net_open(&l->net, kind, values);
  if (s == SV_OK) memcpy(l->linear, values + sv_net_floats(kind), n_linear(kind) * sizeof *values);
  free(values);
  return s == SV_OK ? SV_OK : sv_fail(err, s, "no memory for the weights of LPIPS");
}

sv_status sv_lpips_open(sv_lpips **out, const char *vgg, sv_err *err) {
  const sv_net_kind kind = vgg ? SV_NET_VGG : SV_NET_SQUEEZE;
  const uint8_t *p = sv_lpips_weights;
  size_t bytes = sv_lpips_weights_bytes();
  void *file = NULL;
  sv_lpips *l = calloc(1, sizeof *l);
  *out = NULL;
  sv_status s = l ? SV_OK : sv_fail(err, SV_E_NOMEM, "no memory for the weights of LPIPS");
  if (s == SV_OK && vgg) {
    s = sv_file_read(vgg, &file, &bytes, err);
    p = file;
  }
  if (s == SV_OK)
    s = check(vgg ? vgg : "the built-in file", p, bytes, sv_net_floats(kind) + n_linear(kind), err);
  if (s == SV_OK) s = unpack(l, kind, p, err);
  free(file);
  if (s == SV_OK) *out = l;
  else free(l);
  return s;
}

void sv_lpips_close(sv_lpips *l) {
  if (!l) return;
  sv_net_close(&l->net);
  free(l->tap_map);
  free(l->full_map);
  free(l);
}

// --- the distance --------------------------------------------------------------------------------

typedef struct {
  sv_lpips *l;
  const sv_image_pair *im;
  const uint8_t *mask; // NULL: all
  const sv_pool *pool;
  float *map; // [height][width], or NULL when only the sum is wanted
  double sum;
  const sv_act *a, *b; // of the tap at work
  const float *linear;
} compare_job;

static void pixel(const void *arg, int i_picture, int y, int x, float out[3]) {
  const compare_job *j = arg;
  size_t n = (size_t)j->im->width * (size_t)j->im->height;
  size_t i = (size_t)y * (size_t)j->im->width + (size_t)x;
  const float *p = (i_picture ? j->im->b : j->im->a) + i;
  for (size_t c = 0; c < 3; c++) {
    float v = j->mask && !j->mask[i] ? 0.0f : p[c * n];
    out[c] = (2.0f * v - 1.0f - shift[c]) / scale[c];
  }
}

static float fold(const float s[LANES]) {
  return ((s[0] + s[4]) + (s[2] + s[6])) + ((s[1] + s[5]) + (s[3] + s[7]));
}

static float length(const float *p, int n) {
  float s[LANES] = {0};
  for (int c = 0; c < n; c += LANES)
    for (int k = 0; k < LANES; k++) s[k] += p[c + k] * p[c + k];
  return sqrtf(fold(s)) + EPS;
}

// One row of the tap's map: sum over the channels of linear (a / |a| - b / |b|)^2.
static void map_task(void *arg, int y, int i_thread) {
  const compare_job *j = arg;
  int n = j->a->n_channels;
  (void)i_thread;
  for (int x = 0; x < j->a->width; x++) {
    const float *a = sv_act_at(j->a, y, x), *b = sv_act_at(j->b, y, x);
    float la = length(a, n), lb = length(b, n), s[LANES] = {0};
    for (int c = 0; c < n; c += LANES)
      for (int k = 0; k < LANES; k++) {
        float d = a[c + k] / la - b[c + k] / lb;
        s[k] += j->linear[c + k] * (d * d);
      }
    j->l->tap_map[(size_t)y * (size_t)j->a->width + (size_t)x] = fold(s);
  }
}

// Where pixel i of n lies between samples of m: bilinear with aligned areas, the border repeated.
static int between(int i, int n, int m, float *t) {
  double at = (i + 0.5) * m / n - 0.5;
  if (at < 0) at = 0;
  int k = (int)at;
  *t = (float)(at - k);
  return k;
}

static void enlarge_task(void *arg, int y, int i_thread) {
  const compare_job *j = arg;
  int w = j->im->width, mw = j->a->width, mh = j->a->height;
  float ty, tx;
  int y0 = between(y, j->im->height, mh, &ty), y1 = y0 + 1 < mh ? y0 + 1 : y0;
  const float *r0 = j->l->tap_map + (size_t)y0 * (size_t)mw, *r1 = j->l->tap_map + (size_t)y1 * (size_t)mw;
  float *to = j->map + (size_t)y * (size_t)w;
  (void)i_thread;
  for (int x = 0; x < w; x++) {
    int x0 = between(x, w, mw, &tx), x1 = x0 + 1 < mw ? x0 + 1 : x0;
    float top = r0[x0] + tx * (r0[x1] - r0[x0]), bottom = r1[x0] + tx * (r1[x1] - r1[x0]);
    to[x] += top + ty * (bottom - top);
  }
}

static bool grow(float **p, size_t *cap, size_t n) {
  if (n <= *cap) return true;
  free(*p);
  *p = malloc(n * sizeof **p);
  *cap = *p ? n : 0;
  return *p;
}

static sv_status tap(void *arg, int i_tap, const sv_act *a, const sv_act *b) {
  compare_job *j = arg;
  size_t n = (size_t)a->width * (size_t)a->height;
  if (!grow(&j->l->tap_map, &j->l->cap_tap, n)) return SV_E_NOMEM;
  j->a = a;
  j->b = b;
  sv_pool_run(j->pool, map_task, j, a->height);
  j->linear += sv_net_tap_channels(j->l->net.kind, i_tap);
  if (j->map) {
    sv_pool_run(j->pool, enlarge_task, j, j->im->height);
    return SV_OK;
  }
  double sum = 0;
  for (size_t i = 0; i < n; i++) sum += (double)j->l->tap_map[i];
  j->sum += sum / (double)n;
  return SV_OK;
}

static sv_status run(compare_job *j, sv_err *err) {
  const sv_image_pair *im = j->im;
  sv_net_job net = {.width = im->width, .height = im->height, .pixel = pixel, .tap = tap, .arg = j};
  if (im->n_channels != 3 || im->width < SV_LPIPS_MIN_SIDE_PX || im->height < SV_LPIPS_MIN_SIDE_PX)
    return sv_fail(err, SV_E_RANGE,
                   "LPIPS needs RGB images of at least %dx%d pixels, not %dx%d with %d channels",
                   SV_LPIPS_MIN_SIDE_PX, SV_LPIPS_MIN_SIDE_PX, im->width, im->height, im->n_channels);
  j->linear = j->l->linear;
  if (j->map) memset(j->map, 0, (size_t)im->width * (size_t)im->height * sizeof(float));
  sv_status s = sv_net_run(&j->l->net, &net, j->pool);
  return s == SV_OK ? SV_OK
                    : sv_fail(err, s, "no memory for LPIPS of images of %dx%d pixels", im->width, im->height);
}

sv_status sv_lpips_compare(sv_lpips *l, const sv_image_pair *im, const sv_pool *pool, double *out,
                           sv_err *err) {
  compare_job j = {.l = l, .im = im, .pool = pool};
  sv_status s = run(&j, err);
  *out = j.sum;
  return s;
}

sv_status sv_lpips_map(sv_lpips *l, const sv_image_pair *im, const sv_pool *pool, float *map, sv_err *err) {
  compare_job j = {.l = l, .im = im, .pool = pool, .map = map};
  return run(&j, err);
}

sv_status sv_lpips_masked(sv_lpips *l, const sv_image_pair *im, const uint8_t *mask, const sv_pool *pool,
                          double *out, sv_err *err) {
  size_t n = (size_t)im->width * (size_t)im->height, n_used = 0;
  *out = 0;
  if (!grow(&l->full_map, &l->cap_full, n))
    return sv_fail(err, SV_E_NOMEM, "no memory for LPIPS of images of %dx%d pixels", im->width, im->height);
  compare_job j = {.l = l, .im = im, .pool = pool, .map = l->full_map, .mask = mask};
  sv_status s = run(&j, err);
  if (s != SV_OK) return s;
  double sum = 0;
  for (size_t i = 0; i < n; i++)
    if (mask[i]) {
      sum += (double)l->full_map[i];
      n_used++;
    }
  *out = n_used ? sum / (double)n_used : 0;
  return SV_OK;
}
