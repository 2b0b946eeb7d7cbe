// SPDX-License-Identifier: Apache-2.0
// The convolution layers of SqueezeNet 1.1 (Iandola et al. 2016) and VGG16 (Simonyan and Zisserman
// 2014), in the layout of torchvision's `features`, forward only. Images are [y][x][channel]
// floats. Sums run in one order, without fused multiply-add: the same bits on every machine and for
// any number of threads.
#ifndef SV_TOOLS_METRIC_FEATURES_H
#define SV_TOOLS_METRIC_FEATURES_H

#include "src/port/port.h"

#ifdef __cplusplus
extern "C" {
#endif

#define SV_NET_CAP_TAPS  7
#define SV_NET_CAP_CONVS 25

typedef enum { SV_NET_SQUEEZE, SV_NET_VGG } sv_net_kind;

// One activation. There is one pixel of border on all sides; px is the border's first.
typedef struct {
  float *px; // [height + 2][width + 2][n_channels]
  int width, height, n_channels;
} sv_act;
static inline float *sv_act_at(const sv_act *a, int y, int x) { // x, y from -1
  return a->px + ((ptrdiff_t)(y + 1) * (a->width + 2) + (x + 1)) * a->n_channels;
}

typedef struct {
  int n_in, n_out, k, stride;
  const float *weight; // [n_out / 8][k][k][n_in][8]
  const float *bias;   // [n_out]
} sv_conv;

typedef struct {
  sv_net_kind kind;
  sv_conv conv[SV_NET_CAP_CONVS];
  float *weights;      // of all of them, 64-byte aligned
  float *buffer[2][3]; // of the two images; grows
  size_t cap_floats[3];
} sv_net;

// Weights and biases of all convolutions.
size_t sv_net_floats(sv_net_kind kind);
// values [sv_net_floats]: in the network's order, weight [out][in][ky][kx], then bias.
sv_status sv_net_open(sv_net *n, sv_net_kind kind, const float *values) SV_MUST_USE;
void sv_net_close(sv_net *n);

int sv_net_taps(sv_net_kind kind);
int sv_net_tap_channels(sv_net_kind kind, int i);

// Runs two images of the same size through the network side by side; after each layer that is
// compared calls tap(arg, i, a, b). pixel(arg, i_picture, y, x, out[3]) gives the network's input.
// E_NOMEM, E_RANGE (too small), or what tap returns.
typedef struct {
  int width, height;
  void (*pixel)(const void *arg, int i_picture, int y, int x, float out[3]);
  sv_status (*tap)(void *arg, int i_tap, const sv_act *a, const sv_act *b);
  void *arg;
} sv_net_job;
sv_status sv_net_run(sv_net *n, const sv_net_job *job, const sv_pool *pool) SV_MUST_USE;

#ifdef __cplusplus
}
#endif
#endif
