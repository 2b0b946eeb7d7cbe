// SPDX-License-Identifier: Apache-2.0
// Lenses of the simulator: fisheyes, and for comparison the same field in ideal pinholes with the
// same pixels.
#include <math.h>

#include "platform/sim/sim.h"
#include "src/base/mathx.h"

// k1 to k4 of all fisheyes: those of an ordinary 180 degree lens.
static const double K[4] = {-0.02, 0.005, -0.002, 0.0003};
#define N_TILES 2    // a side
#define OVERLAP 1.15 // of tiles, as their edges do not meet exactly

int sv_sim_n_sub_views(const sv_sim_config *cfg) {
  const sv_device_params device = sv_sim_device(cfg);
  return sv_device_n_sub_views(&device) * (cfg->lens == SV_SIM_LENS_TILES ? N_TILES * N_TILES : 1);
}

static sv_camera_model kb4(const sv_camera_model *pinhole, double focal_px) {
  sv_camera_model m = *pinhole;
  m.kind = SV_MODEL_KB4;
  m.p[0] = m.p[1] = focal_px;
  for (int i = 0; i < 4; i++) m.p[4 + i] = K[i];
  return m;
}

// One that sees this field across a picture's diagonal, with a device's zoom.
static sv_camera_model fisheye_of(const sv_sim *sim, const sv_camera_model *pinhole) {
  const double w = pinhole->width_px, h = pinhole->height_px, half = 0.5 * sim->cfg.lens_deg * SV_PI / 180;
  const sv_camera_model unit = kb4(pinhole, 1);
  double uv[2] = {0}, x[3] = {sv_sin(half), 0, sv_cos(half)};
  const double zoom = pinhole->p[0] / (sv_sim_device(&sim->cfg).focal_per_width * w);
  (void)sv_model_project(&unit, x, uv, NULL, NULL);
  return kb4(pinhole, zoom * 0.5 * sqrt(w * w + h * h) / (uv[0] - unit.p[2]));
}

// The angle at the middle of an edge of the picture.
static double angle_at(const sv_camera_model *m, double u_px, double v_px) {
  const double uv[2] = {u_px, v_px};
  double ray[3] = {0, 0, 1};
  (void)sv_model_unproject(m, uv, ray);
  return sv_acos(ray[2]);
}

// The sub-view's sensor becomes tiles, each of which looks to its part of the field.
static void tile(const sv_sub_view *whole, const sv_camera_model *m, sv_sub_view *out) {
  const int w = m->width_px / N_TILES, h = m->height_px / N_TILES;
  const double yaw = angle_at(m, m->width_px, m->p[3]) / N_TILES,
               pitch = angle_at(m, m->p[2], m->height_px) / N_TILES;
  for (int i = 0; i < N_TILES * N_TILES; i++) {
    const int row = i / N_TILES, col = i % N_TILES;
    const double a = (2 * col - 1) * yaw, b = (2 * row - 1) * pitch;
    const double at[3] = {sv_sin(a) * sv_cos(b), sv_sin(b), sv_cos(a) * sv_cos(b)}, eye[3] = {0},
                 up[3] = {0, -1, 0};
    sv_pose turn;
    out[i] = *whole;
    (void)sv_pose_look_at(&turn, eye, at, up);
    (void)sv_fmt(out[i].name, sizeof out[i].name, "%.24s_%d%d", whole->name, row, col);
    out[i].cam_from_rig = sv_pose_mul(&turn, &whole->cam_from_rig);
    out[i].footprint = (sv_footprint){.x0_px = col * w, .y0_px = row * h, .width_px = w, .height_px = h};
    out[i].model = (sv_camera_model){
        .kind = SV_MODEL_PINHOLE,
        .width_px = w,
        .height_px = h,
        .p = {0.5 * w / (OVERLAP * sv_tan(yaw)), 0.5 * h / (OVERLAP * sv_tan(pitch)), 0.5 * w, 0.5 * h}};
  }
}

sv_status sv_sim_set_lenses(sv_sim *sim, sv_err *err) {
  sv_rig *rig = &sim->rig;
  if (sim->cfg.lens == SV_SIM_LENS_PINHOLE) return SV_OK;
  const int n = rig->n_sub_views;
  for (int i = n - 1; i >= 0; i--) { // from the last, as tiles take four places
    const sv_sub_view whole = rig->sub_views[i];
    const sv_camera_model m = fisheye_of(sim, &whole.model);
    rig->sub_views[i].model = m;
    if (sim->cfg.lens == SV_SIM_LENS_TILES) tile(&whole, &m, rig->sub_views + N_TILES * N_TILES * i);
    else if (!sv_fisheye_make(&sim->fisheye[i], &m))
      return sv_fail(err, SV_E_RANGE, "sim: no fisheye of %g degrees on %dx%d pixels", sim->cfg.lens_deg,
                     m.width_px, m.height_px);
  }
  if (sim->cfg.lens == SV_SIM_LENS_TILES) rig->n_sub_views = N_TILES * N_TILES * n;
  return SV_OK;
}
