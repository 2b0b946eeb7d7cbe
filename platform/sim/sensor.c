// SPDX-License-Identifier: Apache-2.0
// From linear light to the bytes of a sensor frame: noise, 14-bit quantisation, sRGB
// (src/image/noise.h). The noise of a pixel is a hash of seed, camera, slot and the pixel's place
// on the sensor.
#include <string.h>

#include "platform/sim/sim.h"
#include "src/base/mathx.h"
#include "src/base/rng.h"

typedef struct {
  const sv_sim *sim;
  uint8_t *rgb;   // first pixel, or NULL
  float *depth_m; // the same, or NULL
  float *sum;     // the same: adds linear light instead of writing rgb, or NULL
  int stride_px;
  int x0_px, y0_px; // position on the sensor, for the noise
  bool is_noisy;
  uint32_t camera_seed, slot;
} canvas;

static void add_noise(const canvas *c, int x_px, int y_px, const float in[3], float out[3]) {
  const sv_sim_config *cfg = &c->sim->cfg;
  sv_noise_model m = {.read = (float)cfg->noise_read, .shot = (float)cfg->noise_shot};
  const uint32_t key[2] = {c->camera_seed, c->slot};
  sv_noise_add(&c->sim->noise, &m, key, (uint32_t)(y_px * cfg->width_px + x_px), in, out);
}

static void put(void *self, int x_px, int y_px, int n, const float *rgb, const float *depth_m) {
  const canvas *c = self;
  size_t at = (size_t)y_px * (size_t)c->stride_px + (size_t)x_px;
  if (c->depth_m) memcpy(c->depth_m + at, depth_m, (size_t)n * sizeof *depth_m);
  if (c->sum)
    for (int i = 0; i < 3 * n; i++) c->sum[3 * at + (size_t)i] += rgb[i];
  if (!c->rgb) return;
  uint8_t *out = c->rgb + 3 * at;
  for (int i = 0; i < n; i++) {
    float noisy[3];
    const float *p = rgb + 3 * i;
    if (c->is_noisy) {
      add_noise(c, c->x0_px + x_px + i, c->y0_px + y_px, p, noisy);
      p = noisy;
    }
    for (int k = 0; k < 3; k++) out[3 * i + k] = c->sim->noise.srgb8[sv_noise_quantise(p[k])];
  }
}

static void draw(sv_sim *sim, const sv_view *v, double time_s, canvas *c) {
  sv_sim_sink sink = {c, put};
  sv_sim_shot_prepare(sim->shot, sim->scene, v, time_s);
  sv_sim_shot_rows(sim->shot, 0, v->height_px, &sink);
}

void sv_sim_prepare(const sv_sim *sim, sv_sim_shot *shot, const sv_view *view, double time_s) {
  sv_sim_shot_prepare(shot, sim->scene, view, time_s);
}

void sv_sim_render_rows(const sv_sim *sim, const sv_sim_shot *shot, int y0, int y1, uint8_t *rgb,
                        float *depth_m) {
  canvas c = {.sim = sim, .rgb = rgb, .depth_m = depth_m, .stride_px = shot->view.width_px};
  sv_sim_sink sink = {&c, put};
  sv_sim_shot_rows(shot, y0, y1, &sink);
}

void sv_sim_render(sv_sim *sim, const sv_view *view, double time_s, uint8_t *rgb, float *depth_m) {
  sv_sim_prepare(sim, sim->shot, view, time_s);
  sv_sim_render_rows(sim, sim->shot, 0, view->height_px, rgb, depth_m);
}

// The multiplexed measurement: linear sum over the largest overlap, noise, 14 bits, sRGB in 16
// bits.
static void put_measurement(const sv_sim *sim, const canvas *c, uint8_t *out) {
  float scale = 1.0f / (float)sim->largest_overlap;
  for (int y = 0; y < sim->cfg.height_px; y++)
    for (int x = 0; x < sim->cfg.width_px; x++) {
      size_t at = (size_t)y * (size_t)sim->cfg.width_px + (size_t)x;
      float v[3];
      for (int k = 0; k < 3; k++) v[k] = sim->sum[3 * at + (size_t)k] * scale;
      if (c->is_noisy) add_noise(c, x, y, v, v);
      for (int k = 0; k < 3; k++) {
        uint16_t code = sim->noise.srgb16[sv_noise_quantise(v[k])];
        out[6 * at + 2 * (size_t)k] = (uint8_t)(code & 255);
        out[6 * at + 2 * (size_t)k + 1] = (uint8_t)(code >> 8);
      }
    }
}

void sv_sim_expose(sv_sim *sim, const sv_sim_event *e, uint8_t *out) {
  const sv_sim_config *cfg = &sim->cfg;
  bool is_sum = sim->rig.forward == SV_FORWARD_MULTIPLEXED;
  canvas c = {.sim = sim,
              .stride_px = cfg->width_px,
              .slot = (uint32_t)e->slot,
              .is_noisy = cfg->noise_read > 0 || cfg->noise_shot > 0,
              .camera_seed = sv_hash3(cfg->seed, (uint32_t)e->i_camera, 0x5e50)};
  size_t n_px = (size_t)cfg->width_px * (size_t)cfg->height_px;
  if (is_sum) memset(sim->sum, 0, 3 * n_px * sizeof *sim->sum);
  else memset(out, 0, sim->frame_bytes);
  for (int i = 0; i < sim->rig.n_sub_views; i++) {
    const sv_sub_view *sv = &sim->rig.sub_views[i];
    if (sv->i_camera != e->i_camera) continue;
    sv_view v = sv_sim_sub_view_at(sim, sv, e->true_ns);
    c.x0_px = sv->footprint.x0_px;
    c.y0_px = sv->footprint.y0_px;
    size_t at = 3 * ((size_t)c.y0_px * (size_t)cfg->width_px + (size_t)c.x0_px);
    if (is_sum) c.sum = sim->sum + at;
    else c.rgb = out + at;
    draw(sim, &v, sv_ns_to_s(e->true_ns - SV_SIM_EPOCH_NS), &c);
  }
  if (is_sum) put_measurement(sim, &c, out);
  if (e->is_damaged) memset(out + sim->frame_bytes / 2, 0, sim->frame_bytes - sim->frame_bytes / 2);
}
