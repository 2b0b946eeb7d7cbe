// SPDX-License-Identifier: Apache-2.0
// From linear light to the bytes of a sensor frame: noise, 14-bit quantisation, sRGB
// (src/image/noise.h). The noise of a pixel is a hash of seed, camera, slot and the pixel's place
// on the sensor.
#include <math.h>
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
  // Through optics: adds this share of the light of columns [x0, x1), after the lens's falloff, to
  // sum
  const sv_view *lens;
  float weight;
  int x0, x1;
  bool is_noisy;
  uint32_t camera_seed, slot;
} canvas;

static void add_noise(const canvas *c, int x_px, int y_px, const float in[3], float out[3]) {
  const sv_sim_config *cfg = &c->sim->cfg;
  sv_noise_model m = {.read = (float)cfg->noise_read, .shot = (float)cfg->noise_shot};
  const uint32_t key[2] = {c->camera_seed, c->slot};
  sv_noise_add(&c->sim->noise, &m, key, (uint32_t)(y_px * cfg->width_px + x_px), in, out);
}

static void add_light(const canvas *c, int x_px, int y_px, int n, const float *rgb) {
  float *row = c->sum + 3 * ((size_t)y_px * (size_t)c->stride_px);
  for (int x = sv_maxi(x_px, c->x0); x < sv_mini(x_px + n, c->x1); x++) {
    const float light =
        c->weight * sv_sim_optics_falloff(&c->sim->cfg.optics, c->lens, (float)x + 0.5f, (float)y_px + 0.5f);
    for (int k = 0; k < 3; k++) row[3 * x + k] += light * rgb[3 * (x - x_px) + k];
  }
}

static void put(void *self, int x_px, int y_px, int n, const float *rgb, const float *depth_m) {
  const canvas *c = self;
  size_t at = (size_t)y_px * (size_t)c->stride_px + (size_t)x_px;
  if (c->depth_m) memcpy(c->depth_m + at, depth_m, (size_t)n * sizeof *depth_m);
  if (c->lens) {
    add_light(c, x_px, y_px, n, rgb);
    return;
  }
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

// --- through optics
// --------------------------------------------------------------------------------

// Lines that are read at one time; with a global shutter all.
#define ROWS_A_BAND    2
#define COLUMNS_A_BAND 8

// One sample of a sub-view: band after band, each at its time.
static void draw_sample(sv_sim *sim, const sv_sub_view *sv, sv_ns mid_ns, const double lens_m[2], canvas *c) {
  const sv_sim_optics_cfg *o = &sim->cfg.optics;
  const bool is_across = o->shutter >= SV_SHUTTER_RIGHT,
             is_back = o->shutter == SV_SHUTTER_UP || o->shutter == SV_SHUTTER_LEFT;
  const int width_px = sv->model.width_px, height_px = sv->model.height_px;
  const int n = is_across ? width_px : height_px,
            band = o->readout_ms > 0 ? is_across ? COLUMNS_A_BAND : ROWS_A_BAND : n;
  sv_sim_sink sink = {c, put};
  for (int from = 0; from < n; from += band) {
    const int to = sv_mini(from + band, n);
    // Lines are read over the whole sensor: a lens's image has its place among them.
    const double side = is_across ? sim->cfg.width_px : sim->cfg.height_px,
                 at = (0.5 * (from + to) + (is_across ? c->x0_px : c->y0_px)) / side - 0.5;
    const sv_ns ns = mid_ns + (sv_ns)floor(1e6 * o->readout_ms * (is_back ? -at : at) + 0.5);
    const sv_view v = sv_sim_sub_view_at(sim, sv, ns), moved = sv_sim_optics_through(o, &v, lens_m);
    c->lens = &v;
    c->x0 = is_across ? from : 0;
    c->x1 = is_across ? to : width_px;
    sv_sim_shot_prepare(sim->shot, sim->scene, &moved, sv_ns_to_s(ns - SV_SIM_EPOCH_NS));
    for (int k = 0; k < 2 && v.fisheye; k++) sim->shot->lean[k] = (float)(lens_m[k] / o->focus_m);
    sv_sim_shot_rows(sim->shot, is_across ? 0 : from, is_across ? height_px : to, &sink);
  }
  c->lens = NULL;
}

// A field of even light, through the lens.
static void draw_flat(const sv_sim *sim, const sv_sub_view *sv, sv_ns mid_ns, canvas *c) {
  const sv_view v = sv_sim_sub_view_at(sim, sv, mid_ns);
  const float light = (float)sim->cfg.optics.flat, rgb[3] = {light, light, light};
  c->lens = &v;
  c->weight = 1;
  for (int y = 0; y < v.height_px; y++)
    for (int x = 0; x < v.width_px; x++) {
      c->x0 = x;
      c->x1 = x + 1;
      add_light(c, x, y, 1, rgb);
    }
  c->lens = NULL;
}

static void draw_through(sv_sim *sim, const sv_sub_view *sv, sv_ns mid_ns, canvas *c) {
  const sv_sim_optics_cfg *o = &sim->cfg.optics;
  const int n = sv_sim_optics_n_samples(o);
  c->weight = 1.0f / (float)n;
  for (int i = 0; i < n; i++) {
    double late, lens_m[2];
    sv_sim_optics_sample(o, i, &late, lens_m);
    draw_sample(sim, sv, mid_ns + (sv_ns)floor(late * 1e3 * sim->cfg.shutter_us + 0.5), lens_m, c);
  }
}

// --- from the sum to the frame
// ---------------------------------------------------------------------

typedef struct {
  float m[9], black, scale;
  const uint16_t *display; // [16384] of 65535
} development;

static development development_of(const sv_sim *sim, const sv_sim_event *e) {
  const sv_sim_optics_cfg *o = &sim->cfg.optics;
  const int n = sim->cfg.n_exposures;
  development d = {
      .black = (float)o->black,
      .scale = sim->rig.forward == SV_FORWARD_MULTIPLEXED ? 1.0f / (float)sim->largest_overlap : 1.0f,
      .display = sim->optics.response && e->i_camera > 0 ? sim->optics.response : sim->noise.srgb16};
  sv_sim_optics_matrix(o, e->i_camera, n > 1 ? (double)(e->slot % n) / (n - 1) : 0, d.m);
  const float exposure = (float)(sim->exposure[e->i_camera] * sv_sim_optics_exposure(o, e->slot));
  for (int i = 0; i < 9; i++) d.m[i] *= exposure;
  return d;
}

static void develop(const development *d, const float in[3], float out[3]) {
  float v[3];
  for (int k = 0; k < 3; k++) v[k] = in[k] * d->scale;
  for (int k = 0; k < 3; k++)
    out[k] = d->m[3 * k] * v[0] + d->m[3 * k + 1] * v[1] + d->m[3 * k + 2] * v[2] + d->black;
}

static void put_value(uint8_t *out, bool is_16_bit, int at, uint16_t v) {
  if (is_16_bit) {
    out[2 * at] = (uint8_t)(v & 255);
    out[2 * at + 1] = (uint8_t)(v >> 8);
  } else out[at] = (uint8_t)((v + 128) / 257);
}

// The sensor's sum of light, developed; noise, 14 bits, and display values in 8 or 16 bits. A
// multiplexed measurement is over the largest overlap.
static void put_sum(const sv_sim *sim, const sv_sim_event *e, const canvas *c, uint8_t *out) {
  const bool is_16_bit = sv_sim_is_deep(&sim->cfg);
  const development d = development_of(sim, e);
  for (int y = 0; y < sim->cfg.height_px; y++)
    for (int x = 0; x < sim->cfg.width_px; x++) {
      const int at = 3 * (y * sim->cfg.width_px + x);
      float v[3];
      if (sim->optics.is_on) develop(&d, sim->sum + at, v);
      else
        for (int k = 0; k < 3; k++) v[k] = sim->sum[at + k] * d.scale;
      if (c->is_noisy) add_noise(c, x, y, v, v);
      for (int k = 0; k < 3; k++) put_value(out, is_16_bit, at + k, d.display[sv_noise_quantise(v[k])]);
    }
  for (int i = 0; i < sim->cfg.optics.n_hot; i++) {
    const uint32_t place =
        sv_hash3(c->camera_seed, (uint32_t)i, 0x407) % (uint32_t)(sim->cfg.width_px * sim->cfg.height_px);
    for (int k = 0; k < 3; k++) put_value(out, is_16_bit, 3 * (int)place + k, UINT16_MAX);
  }
}

// The light of a camera's sub-views, into sum or, where there is none, as a picture to out.
static void draw_camera(sv_sim *sim, const sv_sim_event *e, canvas *c, uint8_t *out) {
  const sv_sim_config *cfg = &sim->cfg;
  const size_t n_px = (size_t)cfg->width_px * (size_t)cfg->height_px;
  if (sim->sum) memset(sim->sum, 0, 3 * n_px * sizeof *sim->sum);
  else memset(out, 0, sim->frame_bytes);
  for (int i = 0; i < sim->rig.n_sub_views; i++) {
    const sv_sub_view *sv = &sim->rig.sub_views[i];
    if (sv->i_camera != e->i_camera) continue;
    c->x0_px = sv->footprint.x0_px;
    c->y0_px = sv->footprint.y0_px;
    size_t at = 3 * ((size_t)c->y0_px * (size_t)cfg->width_px + (size_t)c->x0_px);
    if (sim->sum) c->sum = sim->sum + at;
    else c->rgb = out + at;
    if (sim->optics.is_on) {
      if (cfg->optics.flat > 0) draw_flat(sim, sv, e->true_ns, c);
      else draw_through(sim, sv, e->true_ns, c);
      continue;
    }
    sv_view v = sv_sim_sub_view_at(sim, sv, e->true_ns);
    draw(sim, &v, sv_ns_to_s(e->true_ns - SV_SIM_EPOCH_NS), c);
  }
}

void sv_sim_expose(sv_sim *sim, const sv_sim_event *e, uint8_t *out) {
  const sv_sim_config *cfg = &sim->cfg;
  canvas c = {.sim = sim,
              .stride_px = cfg->width_px,
              .slot = (uint32_t)e->slot,
              .is_noisy = cfg->noise_read > 0 || cfg->noise_shot > 0,
              .camera_seed = sv_hash3(cfg->seed, (uint32_t)e->i_camera, 0x5e50)};
  draw_camera(sim, e, &c, out);
  if (sim->sum) put_sum(sim, e, &c, out);
  if (cfg->jpeg_quality > 0) sv_sim_jpeg(out, cfg->width_px, cfg->height_px, cfg->jpeg_quality);
  if (e->is_damaged) memset(out + sim->frame_bytes / 2, 0, sim->frame_bytes - sim->frame_bytes / 2);
}

// --- automatic exposure
// --------------------------------------------------------------------------

#define METER_GREEN 0.18 // mean of a picture that is well exposed
#define METER_MOST  64.0 // times the given exposure time, and its inverse

// Of the first slot, as the camera sees it without noise.
static double meter(sv_sim *sim, int i_camera) {
  const sv_sim_event first = {.i_camera = i_camera, .true_ns = sv_sim_slot_ns(sim, 0)};
  const int n_px = sim->cfg.width_px * sim->cfg.height_px;
  canvas c = {.sim = sim, .stride_px = sim->cfg.width_px};
  double green = 0;
  draw_camera(sim, &first, &c, NULL);
  const development d = development_of(sim, &first);
  for (int i = 0; i < n_px; i++) {
    float v[3];
    develop(&d, sim->sum + 3 * i, v);
    green += (double)v[1] / n_px;
  }
  return sv_mind(sv_maxd(METER_GREEN / green, 1 / METER_MOST), METER_MOST);
}

void sv_sim_meter(sv_sim *sim) {
  const sv_sim_lock lock = sim->cfg.optics.lock;
  const float *response = sim->cfg.response;
  for (int i = 0; i < sim->n_cameras && lock != SV_SIM_LOCK_GIVEN; i++) {
    const bool follows = lock == SV_SIM_LOCK_SHARED && i > 0;
    const double share = follows && response ? (double)response[0] / (double)response[i] : 1;
    sim->exposure[i] = follows ? sim->exposure[0] * share : meter(sim, i);
  }
  sim->is_metered = true;
}
