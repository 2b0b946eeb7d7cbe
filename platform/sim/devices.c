// SPDX-License-Identifier: Apache-2.0
// The rigs. All cameras lie on the sphere of SV_SIM_DISTANCE_M about the scene's centre and look at it.
#include <math.h>

#include "platform/sim/sim.h"
#include "src/base/mathx.h"

#define FOCAL_PER_WIDTH 1.3 // 42 degrees across, so that a sphere of 1.1 m fits a 4:3 image

static sv_sub_view *add(sv_rig *rig, const char *name, int i_camera, int w, int h, double focal_px,
                        const double direction[3]) {
  sv_sub_view *v = &rig->sub_views[rig->n_sub_views++];
  *v = (sv_sub_view){.i_camera = i_camera};
  (void)sv_copy(v->name, sizeof v->name, name);
  v->model = (sv_camera_model){
      .kind = SV_MODEL_PINHOLE, .width_px = w, .height_px = h, .p = {focal_px, focal_px, 0.5 * w, 0.5 * h}};
  double at[3] = {0, 0, SV_SIM_DISTANCE_M}, up[3] = {0, -1, 0}, eye[3], n = sv_norm3(direction);
  for (int i = 0; i < 3; i++) eye[i] = at[i] + SV_SIM_DISTANCE_M * direction[i] / n;
  (void)sv_pose_look_at(&v->cam_from_rig, eye, at, up); // the direction is never along up
  return v;
}

static void stereo(sv_rig *rig, int w, int h, double f, double angle_rad) {
  double s = sv_sin(0.5 * angle_rad), c = sv_cos(0.5 * angle_rad);
  double left[3] = {-s, 0, -c}, right[3] = {s, 0, -c};
  add(rig, "left", 0, w, h, f, left);
  add(rig, "right", 1, w, h, f, right);
}

// Equilateral on the sphere: with polar angle rho, cos(angle) = 1 - 1.5 sin(rho)^2.
static void phone(sv_rig *rig, int w, int h, double f, double angle_rad) {
  static const char *const names[3] = {"wide", "ultrawide", "tele"};
  static const double zoom[3] = {1, 0.5, 3}, place_deg[3] = {150, 30, 270}; // lower left, lower right, top
  double s = sqrt((1 - sv_cos(angle_rad)) / 1.5), c = sqrt(1 - s * s);
  for (int i = 0; i < 3; i++) {
    double a = place_deg[i] * SV_PI / 180, d[3] = {s * sv_cos(a), s * sv_sin(a), -c};
    add(rig, names[i], i, w, h, zoom[i] * f, d);
  }
}

// 4 x 4 lenses, row-major from the top left, the corner-to-corner diagonal = angle. Pitch and size of
// their images: side by side, size = pitch; overlapping, size = 2 pitches, so 4 overlap at most.
static void lenses(sv_rig *rig, int w, int h, double angle_rad, bool is_overlapping) {
  int n = is_overlapping ? 5 : 4, pitch_x = w / n, pitch_y = h / n, size = is_overlapping ? 2 : 1;
  double step = sv_tan(0.5 * angle_rad) / sqrt(2.0) * (2.0 / 3.0);
  for (int i = 0; i < 16; i++) {
    int row = i / 4, col = i % 4;
    char name[8];
    (void)sv_fmt(name, sizeof name, "v%d%d", row, col);
    double d[3] = {(col - 1.5) * step, (row - 1.5) * step, -1};
    int sw = pitch_x * size, sh = pitch_y * size;
    sv_sub_view *v = add(rig, name, 0, sw, sh, FOCAL_PER_WIDTH * sw, d);
    v->footprint =
        (sv_footprint){.x0_px = col * pitch_x, .y0_px = row * pitch_y, .width_px = sw, .height_px = sh};
  }
  rig->forward = is_overlapping ? SV_FORWARD_MULTIPLEXED : SV_FORWARD_LIGHT_FIELD;
}

static const char *const RIG_NAMES[] = {
#define X(id, name, default_angle_deg, text) name,
#include "platform/sim/rigs.inc"
#undef X
};

void sv_sim_build_rig(sv_sim *sim) {
  sv_rig *rig = &sim->rig;
  int w = sim->cfg.width_px, h = sim->cfg.height_px;
  double f = FOCAL_PER_WIDTH * w, angle = sim->cfg.angle_deg * SV_PI / 180, ahead[3] = {0, 0, -1};
  (void)sv_copy(rig->name, sizeof rig->name, RIG_NAMES[sim->cfg.rig]);
  rig->forward = SV_FORWARD_DIRECT;
  switch (sim->cfg.rig) {
  case SV_SIM_RIG_STEREO: stereo(rig, w, h, f, angle); break;
  case SV_SIM_RIG_PHONE: phone(rig, w, h, f, angle); break;
  case SV_SIM_RIG_LIGHTFIELD: lenses(rig, w, h, angle, false); break;
  case SV_SIM_RIG_MULTIPLEXED: lenses(rig, w, h, angle, true); break;
  default: add(rig, "mono", 0, w, h, f, ahead);
  }
}
