// SPDX-License-Identifier: Apache-2.0
#include "tools/metric/features.h"

#include <stdlib.h>
#include <string.h>

#define LANES 8 // output channels computed together
#define COLS  4 // pixels computed together

// The compiler maps this to whatever vectors the machine has; lanes never mix, so the bits are the
// same.
typedef float lanes __attribute__((vector_size(LANES * sizeof(float)), may_alias));

// --- the layers ----------------------------------------------------------------------------------

// Fire modules: channels in, squeezed, and out of each of the two expansions.
static const struct {
  int n_in, n_squeeze, n_expand;
} fires[8] = {{64, 16, 64},   {128, 16, 64},  {128, 32, 128}, {256, 32, 128},
              {256, 48, 192}, {384, 48, 192}, {384, 64, 256}, {512, 64, 256}};

// VGG16: 3x3 convolutions in five blocks, with pooling between them.
static const struct { int n_convs, n_out; } blocks[5] = {{2, 64}, {2, 128}, {3, 256}, {3, 512}, {3, 512}};

static const int tap_channels[2][SV_NET_CAP_TAPS] = {{64, 128, 256, 384, 384, 512, 512},
                                                     {64, 128, 256, 512, 512}};
int sv_net_taps(sv_net_kind kind) { return kind == SV_NET_VGG ? 5 : 7; }
int sv_net_tap_channels(sv_net_kind kind, int i) { return tap_channels[kind][i]; }

// [out][in][ky][kx] -> [out / 8][ky][kx][in][8]
static void arrange(const sv_conv *c, const float *src, float *dst) {
  int kk = c->k * c->k;
  for (int o = 0; o < c->n_out; o++)
    for (int i = 0; i < c->n_in; i++)
      for (int t = 0; t < kk; t++)
        dst[(((size_t)(o / LANES) * (size_t)kk + (size_t)t) * (size_t)c->n_in + (size_t)i) * LANES +
            (size_t)(o % LANES)] = *src++;
}

static sv_conv squeeze_conv(int i) {
  // Of the fire module: squeeze, expand 1x1, expand 3x3.
  const int f = (i - 1) / 3, part = (i - 1) % 3;
  if (i == 0) return (sv_conv){.n_in = 3, .n_out = 64, .k = 3, .stride = 2};
  if (part == 0) return (sv_conv){.n_in = fires[f].n_in, .n_out = fires[f].n_squeeze, .k = 1, .stride = 1};
  return (sv_conv){
      .n_in = fires[f].n_squeeze, .n_out = fires[f].n_expand, .k = part == 1 ? 1 : 3, .stride = 1};
}

static sv_conv vgg_conv(int i) {
  int b = 0, n_in = 3;
  for (; i >= blocks[b].n_convs; b++) {
    i -= blocks[b].n_convs;
    n_in = blocks[b].n_out;
  }
  return (sv_conv){.n_in = i ? blocks[b].n_out : n_in, .n_out = blocks[b].n_out, .k = 3, .stride = 1};
}

static int n_convs(sv_net_kind kind) { return kind == SV_NET_VGG ? 13 : SV_NET_CAP_CONVS; }

static sv_conv conv_of(sv_net_kind kind, int i) { return kind == SV_NET_VGG ? vgg_conv(i) : squeeze_conv(i); }

static size_t n_weights_of(const sv_conv *c) { return (size_t)(c->n_in * c->n_out * c->k * c->k); }

size_t sv_net_floats(sv_net_kind kind) {
  size_t n = 0;
  for (int i = 0; i < n_convs(kind); i++) {
    const sv_conv c = conv_of(kind, i);
    n += n_weights_of(&c) + (size_t)c.n_out;
  }
  return n;
}

sv_status sv_net_open(sv_net *n, sv_net_kind kind, const float *values) {
  memset(n, 0, sizeof *n);
  n->kind = kind;
  n->weights = aligned_alloc(64, (sv_net_floats(kind) * sizeof(float) + 63) / 64 * 64);
  if (!n->weights) return SV_E_NOMEM;
  float *to = n->weights;
  for (int i = 0; i < n_convs(kind); i++) {
    sv_conv *c = &n->conv[i];
    *c = conv_of(kind, i);
    const size_t n_weights = n_weights_of(c), n_out = (size_t)c->n_out;
    c->weight = to;
    c->bias = to + n_weights; // all counts are multiples of 8: everything stays aligned
    arrange(c, values, to);
    memcpy(to + n_weights, values + n_weights, n_out * sizeof(float));
    to += n_weights + n_out;
    values += n_weights + n_out;
  }
  return SV_OK;
}

void sv_net_close(sv_net *n) {
  free(n->weights);
  for (int i = 0; i < 6; i++) free(n->buffer[i / 3][i % 3]);
  memset(n, 0, sizeof *n);
}

// --- convolution ---------------------------------------------------------------------------------

typedef struct {
  const sv_conv *conv;
  const sv_act *in, *out; // [2]
  int pad;                // of a 3x3 kernel at stride 1; the border of in is then zero
  int channel0;           // of out, where this convolution's outputs begin
} conv_job;

// COLS neighboring outputs of 8 channels. a: their first inputs; one row of the kernel is
// contiguous in the input.
static void conv_block(const sv_conv *c, size_t row_floats, const float *const a[COLS], const float *w,
                       lanes sum[COLS]) {
  int run = c->k * c->n_in;
  lanes s0 = sum[0], s1 = sum[1], s2 = sum[2], s3 = sum[3];
  for (int ky = 0; ky < c->k; ky++) {
    size_t at = (size_t)ky * row_floats;
    const float *a0 = a[0] + at, *a1 = a[1] + at, *a2 = a[2] + at, *a3 = a[3] + at;
    for (int j = 0; j < run; j++, w += LANES) {
      lanes v = *(const lanes *)w;
      s0 += v * a0[j];
      s1 += v * a1[j];
      s2 += v * a2[j];
      s3 += v * a3[j];
    }
  }
  sum[0] = s0;
  sum[1] = s1;
  sum[2] = s2;
  sum[3] = s3;
}

static void conv_task(void *arg, int i_task, int i_thread) {
  const conv_job *j = arg;
  const sv_conv *c = j->conv;
  const sv_act *in = &j->in[i_task % 2], *out = &j->out[i_task % 2];
  int y = i_task / 2;
  size_t row_floats = (size_t)(in->width + 2) * (size_t)in->n_channels;
  size_t block_floats = (size_t)(c->k * c->k * c->n_in) * LANES;
  (void)i_thread;
  for (int o = 0; o < c->n_out; o += LANES) {
    const float *w = c->weight + (size_t)(o / LANES) * block_floats;
    for (int x = 0; x < out->width; x += COLS) {
      const float *a[COLS];
      lanes sum[COLS];
      for (int i = 0; i < COLS; i++) { // beyond the last column it is done again, and not stored
        int xi = x + i < out->width ? x + i : out->width - 1;
        a[i] = sv_act_at(in, y * c->stride - j->pad, xi * c->stride - j->pad);
        sum[i] = *(const lanes *)(c->bias + o);
      }
      conv_block(c, row_floats, a, w, sum);
      for (int i = 0; i < COLS && x + i < out->width; i++) {
        float *to = sv_act_at(out, y, x + i) + j->channel0 + o;
        for (int k = 0; k < LANES; k++)
          to[k] = sum[i][k] > 0 ? sum[i][k] : 0; // every one is followed by ReLU
      }
    }
  }
}

// --- pooling ------------------------------------------------------------------------------------

// Stride 2. SqueezeNet 3x3, where a last window may stick out (ceil mode); VGG 2x2.
typedef struct {
  const sv_act *in, *out; // [2]
  int side;               // of the window
} pool_job;

static int pooled(int n) { return (n - 2) / 2 + 1; } // ceil((n - 3) / 2) + 1

static void pool_task(void *arg, int i_task, int i_thread) {
  const pool_job *j = arg;
  const sv_act *in = &j->in[i_task % 2], *out = &j->out[i_task % 2];
  int y = i_task / 2;
  (void)i_thread;
  for (int x = 0; x < out->width; x++) {
    float *to = sv_act_at(out, y, x);
    memcpy(to, sv_act_at(in, 2 * y, 2 * x), (size_t)in->n_channels * sizeof(float));
    for (int t = 1; t < j->side * j->side; t++) {
      int yy = 2 * y + t / j->side, xx = 2 * x + t % j->side;
      if (yy >= in->height || xx >= in->width) continue;
      const float *from = sv_act_at(in, yy, xx);
      for (int c = 0; c < in->n_channels; c++) to[c] = from[c] > to[c] ? from[c] : to[c];
    }
  }
}

// --- the network ---------------------------------------------------------------------------------

static size_t act_floats(int w, int h, int c) { return (size_t)(w + 2) * (size_t)(h + 2) * (size_t)c; }

static sv_act act_make(sv_net *n, int i_picture, int i_buffer, int w, int h, int c) {
  return (sv_act){.px = n->buffer[i_picture][i_buffer], .width = w, .height = h, .n_channels = c};
}

static sv_status reserve(sv_net *n, int i_buffer, size_t floats) {
  if (floats <= n->cap_floats[i_buffer]) return SV_OK;
  size_t bytes = (floats * sizeof(float) + 63) / 64 * 64;
  n->cap_floats[i_buffer] = 0;
  for (int p = 0; p < 2; p++) {
    free(n->buffer[p][i_buffer]);
    n->buffer[p][i_buffer] = aligned_alloc(64, bytes);
    if (!n->buffer[p][i_buffer]) return SV_E_NOMEM;
  }
  n->cap_floats[i_buffer] = floats;
  return SV_OK;
}

// Buffers: 0 and 1 take turns as a layer's input and output, 2 holds what a fire module squeezed.
// The first convolution's output is the largest of all but the pooled ones, whose sizes are known
// as well.
static sv_status reserve_all(sv_net *n, int w, int h) {
  int w1 = (w - 3) / 2 + 1, h1 = (h - 3) / 2 + 1, w2 = pooled(w1), h2 = pooled(h1);
  size_t first = act_floats(w1, h1, 64), input = act_floats(w, h, 3), fire = act_floats(w2, h2, 128);
  size_t rest = act_floats(pooled(w2), pooled(h2), 512);
  size_t even = input > fire ? input : fire, odd = first > fire ? first : fire;
  sv_status s = reserve(n, 0, even > rest ? even : rest);
  if (s == SV_OK) s = reserve(n, 1, odd > rest ? odd : rest);
  if (s == SV_OK) s = reserve(n, 2, act_floats(w2, h2, 64));
  return s;
}

static void convolve(const sv_conv *c, const sv_act in[2], const sv_act out[2], int channel0, int pad,
                     const sv_pool *pool) {
  conv_job j = {.conv = c, .in = in, .out = out, .pad = pad, .channel0 = channel0};
  sv_pool_run(pool, conv_task, &j, 2 * out[0].height);
}

// a -> a: the result lies in the other buffer.
static void pool_layer(sv_net *n, sv_act a[2], int *i_buffer, const sv_pool *pool) {
  sv_act out[2];
  *i_buffer ^= 1;
  for (int p = 0; p < 2; p++)
    out[p] = act_make(n, p, *i_buffer, pooled(a[p].width), pooled(a[p].height), a[p].n_channels);
  pool_job j = {.in = a, .out = out, .side = 3};
  sv_pool_run(pool, pool_task, &j, 2 * out[0].height);
  memcpy(a, out, sizeof out);
}

static void fire_layer(sv_net *n, int i_fire, sv_act a[2], int *i_buffer, const sv_pool *pool) {
  const sv_conv *c = &n->conv[1 + 3 * i_fire];
  sv_act squeezed[2], out[2];
  int w = a[0].width, h = a[0].height;
  *i_buffer ^= 1;
  for (int p = 0; p < 2; p++) {
    squeezed[p] = act_make(n, p, 2, w, h, c[0].n_out);
    // its border pads the 3x3
    memset(squeezed[p].px, 0, act_floats(w, h, c[0].n_out) * sizeof(float));
    out[p] = act_make(n, p, *i_buffer, w, h, 2 * c[1].n_out);
  }
  convolve(&c[0], a, squeezed, 0, 0, pool);
  convolve(&c[1], squeezed, out, 0, 0, pool);
  convolve(&c[2], squeezed, out, c[1].n_out, 1, pool);
  memcpy(a, out, sizeof out);
}

static void load_input(sv_net *n, const sv_net_job *job, sv_act a[2]) {
  for (int p = 0; p < 2; p++) {
    a[p] = act_make(n, p, 0, job->width, job->height, 3);
    for (int y = 0; y < job->height; y++)
      for (int x = 0; x < job->width; x++) job->pixel(job->arg, p, y, x, sv_act_at(&a[p], y, x));
  }
}

static sv_status run_squeeze(sv_net *n, const sv_net_job *job, const sv_pool *pool) {
  // What comes after the first convolution: P pools, F runs the next fire module, T is a tap.
  static const char layers[] = "TPFFTPFFTPFTFTFTFT";
  int w = job->width, h = job->height, i_buffer = 1, i_tap = 0, i_fire = 0;
  sv_act a[2], first[2];
  sv_status s = reserve_all(n, w, h);
  if (s != SV_OK) return s;
  load_input(n, job, a);
  for (int p = 0; p < 2; p++) first[p] = act_make(n, p, 1, (w - 3) / 2 + 1, (h - 3) / 2 + 1, 64);
  convolve(&n->conv[0], a, first, 0, 0, pool);
  memcpy(a, first, sizeof a);
  for (const char *l = layers; *l && s == SV_OK; l++) {
    if (*l == 'P') pool_layer(n, a, &i_buffer, pool);
    else if (*l == 'F') fire_layer(n, i_fire++, a, &i_buffer, pool);
    else s = job->tap(job->arg, i_tap++, &a[0], &a[1]);
  }
  return s;
}

// --- VGG16 ---------------------------------------------------------------------------------------

// The border pads the next convolution.
static void clear_border(const sv_act *a) {
  const size_t row = (size_t)(a->width + 2) * (size_t)a->n_channels;
  memset(a->px, 0, row * sizeof(float));
  memset(a->px + row * (size_t)(a->height + 1), 0, row * sizeof(float));
  for (int y = 0; y < a->height; y++) {
    memset(sv_act_at(a, y, -1), 0, (size_t)a->n_channels * sizeof(float));
    memset(sv_act_at(a, y, a->width), 0, (size_t)a->n_channels * sizeof(float));
  }
}

static void halve(sv_net *n, sv_act a[2], int *i_buffer, const sv_pool *pool) {
  sv_act out[2];
  *i_buffer ^= 1;
  for (int p = 0; p < 2; p++)
    out[p] = act_make(n, p, *i_buffer, a[p].width / 2, a[p].height / 2, a[p].n_channels);
  pool_job j = {.in = a, .out = out, .side = 2};
  sv_pool_run(pool, pool_task, &j, 2 * out[0].height);
  memcpy(a, out, sizeof out);
}

static sv_status run_vgg(sv_net *n, const sv_net_job *job, const sv_pool *pool) {
  int w = job->width, h = job->height, i_buffer = 0, i_conv = 0;
  size_t most = 0;
  sv_act a[2], out[2];
  for (int b = 0; b < 5; b++) {
    const size_t floats = act_floats(w >> b, h >> b, blocks[b].n_out);
    if (floats > most) most = floats;
  }
  sv_status s = reserve(n, 0, most);
  if (s == SV_OK) s = reserve(n, 1, most);
  if (s != SV_OK) return s;
  load_input(n, job, a);
  for (int b = 0; s == SV_OK && b < 5; b++) {
    if (b) halve(n, a, &i_buffer, pool);
    for (int i = 0; i < blocks[b].n_convs; i++) {
      i_buffer ^= 1;
      for (int p = 0; p < 2; p++) {
        clear_border(&a[p]);
        out[p] = act_make(n, p, i_buffer, a[p].width, a[p].height, blocks[b].n_out);
      }
      convolve(&n->conv[i_conv++], a, out, 0, 1, pool);
      memcpy(a, out, sizeof a);
    }
    s = job->tap(job->arg, b, &a[0], &a[1]);
  }
  return s;
}

sv_status sv_net_run(sv_net *n, const sv_net_job *job, const sv_pool *pool) {
  if (job->width < 17 || job->height < 17) return SV_E_RANGE;
  return n->kind == SV_NET_VGG ? run_vgg(n, job, pool) : run_squeeze(n, job, pool);
}
