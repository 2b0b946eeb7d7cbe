// SPDX-License-Identifier: Apache-2.0
// Trajectory of the rig: once around the scene in n_exposures slots (or back and forth on a shorter
// arc), between 10 and 50 degrees of elevation.
#include <math.h>

#include "platform/sim/sim.h"
#include "src/base/mathx.h"

#define START_DEG     20.0 // azimuth of slot 0 of a full circle
#define ELEVATION_DEG 30.0
#define RISE_DEG      20.0
// oscillations per round: a small number of stops never repeats an elevation
#define WAVES       2.6
#define GOLDEN      0.618 // a second round falls between the stops of the first
#define HELDOUT_DEG 3.0
#define SWAY_M      0.04 // sway of the hand, per axis
#define AIM_M       0.08 // sway of the target point
#define ROLL        0.03
#define SWAY_PER_S  1.404 // RMS slope of sway()

sv_ns sv_sim_slot_ns(const sv_sim *sim, int64_t slot) {
  return SV_SIM_EPOCH_NS + slot * sim->period_ns + sim->period_ns / 2;
}

double sv_sim_slot_time_s(const sv_sim *sim, int64_t slot) {
  return sv_ns_to_s(sv_sim_slot_ns(sim, slot) - SV_SIM_EPOCH_NS);
}

static int64_t slot_of(const sv_sim *sim, sv_ns host_ns) {
  sv_ns t = host_ns - SV_SIM_EPOCH_NS;
  return t < 0 ? 0 : t / sim->period_ns;
}

// Motion of a hand: sums of slow oscillations, different for each axis.
static double sway(double t_s, double phase) {
  static const double hz[3] = {0.29, 0.71, 1.13}, share[3] = {0.55, 0.3, 0.15};
  double s = 0;
  for (int i = 0; i < 3; i++) {
    double turns = hz[i] * t_s + phase * (i + 1);
    s += share[i] * sv_sin(2 * SV_PI * (turns - floor(turns)));
  }
  return s;
}

typedef struct {
  double eye_m, aim_m, roll;
} amplitudes;

// Of three axes that sway alike, and of the two across the line of sight.
static amplitudes amplitudes_of(const sv_sim_config *c) {
  const double rad_s = c->turn_deg_s * SV_PI / 180;
  if (!c->is_swaying) return (amplitudes){SWAY_M, AIM_M, ROLL};
  return (amplitudes){c->move_m_s / (SWAY_PER_S * sqrt(3)),
                      rad_s * sv_sim_distance_m(c) / (SWAY_PER_S * sqrt(2)), ROLL};
}

static void sway_all(double t_s, const amplitudes *a, double eye[3], double at[3], double up[3]) {
  for (int i = 0; i < 3; i++) {
    eye[i] += a->eye_m * sway(t_s, 0.17 + 0.31 * i);
    at[i] += a->aim_m * sway(t_s, 0.59 + 0.23 * i);
    up[i] += a->roll * sway(t_s, 0.83 + 0.13 * i);
  }
}

void sv_sim_rig_pose(const sv_sim *sim, sv_ns host_ns, sv_pose *rig_from_world) {
  int64_t slot = slot_of(sim, host_ns);
  double n = sim->cfg.n_exposures, arc = sim->cfg.arc_deg, s = (double)slot, az;
  if (sim->cfg.is_smooth) s += (double)(host_ns - sv_sim_slot_ns(sim, slot)) / (double)sim->period_ns;
  if (arc >= 360) {
    az = START_DEG + 360 * s / n * (1 + GOLDEN / n);
  } else {
    double x = (s + 0.5) / n, round = floor(x);
    x -= round;
    if (round - 2 * floor(0.5 * round) != 0) x = 1 - x;
    az = SV_SIM_ARC_MIDDLE_DEG + arc * (x - 0.5);
  }
  const double rise_deg = sim->cfg.is_swaying ? 0 : RISE_DEG;
  double el = (ELEVATION_DEG + rise_deg * sv_sin(2 * SV_PI * WAVES * s / n - SV_PI / 6)) * SV_PI / 180;
  const double distance_m = sv_sim_distance_m(&sim->cfg);
  double c = sv_cos(el) * distance_m, a = (az - 360 * floor(az / 360)) * SV_PI / 180;
  double eye[3] = {c * sv_cos(a), c * sv_sin(a), sv_sin(el) * distance_m}, at[3] = {0}, up[3] = {0, 0, 1};
  const amplitudes hand = amplitudes_of(&sim->cfg);
  if (sim->cfg.is_handheld || sim->cfg.is_swaying)
    sway_all(sv_ns_to_s(host_ns - SV_SIM_EPOCH_NS), &hand, eye, at, up);
  (void)sv_pose_look_at(rig_from_world, eye, at, up); // elevation stays below 90 degrees
}

static sv_view view_of(const sv_sim *sim, const sv_sub_view *sv, const sv_pose *cam_from_world,
                       sv_ns host_ns) {
  const sv_camera_model *m = &sv->model;
  sv_view v = sv_view_make(m->width_px, m->height_px, m->p, cam_from_world);
  if (sim->fisheye) v.fisheye = &sim->fisheye[sv - sim->rig.sub_views];
  double clip = (double)(sim->cfg.n_exposures > 1 ? sim->cfg.n_exposures - 1 : 1) * (double)sim->period_ns;
  double x = (double)(host_ns - sv_sim_slot_ns(sim, 0)) / clip;
  v.time = (float)(x < 0 ? 0 : x > 1 ? 1 : x);
  return v;
}

sv_view sv_sim_sub_view_at(const sv_sim *sim, const sv_sub_view *sv, sv_ns host_ns) {
  sv_pose rig, cam;
  sv_sim_rig_pose(sim, host_ns, &rig);
  cam = sv_pose_mul(&sv->cam_from_rig, &rig);
  return view_of(sim, sv, &cam, host_ns);
}

void sv_sim_view(const sv_sim *sim, int64_t slot, int i_sub_view, sv_view *view, double *time_s) {
  *view = sv_sim_sub_view_at(sim, &sim->rig.sub_views[i_sub_view], sv_sim_slot_ns(sim, slot));
  view->i_exposure = (int)slot;
  view->i_sub_view = i_sub_view;
  *time_s = sv_sim_slot_time_s(sim, slot);
}

void sv_sim_heldout_view_at(const sv_sim *sim, int i, sv_ns host_ns, sv_view *view) {
  const double distance_m = sv_sim_distance_m(&sim->cfg);
  double f = i * GOLDEN, phi = ((i & 1 ? 270 : 90) + 100 * (f - floor(f) - 0.5)) * SV_PI / 180;
  double rho = HELDOUT_DEG * SV_PI / 180, s = sv_sin(rho), at[3] = {0, 0, distance_m}, up[3] = {0, -1, 0};
  double d[3] = {s * sv_cos(phi), s * sv_sin(phi), -sv_cos(rho)}, eye[3];
  for (int k = 0; k < 3; k++) eye[k] = at[k] + distance_m * d[k];
  sv_pose rig, cam;
  (void)sv_pose_look_at(&cam, eye, at, up);
  sv_sim_rig_pose(sim, host_ns, &rig);
  cam = sv_pose_mul(&cam, &rig);
  *view = view_of(sim, &sim->rig.sub_views[0], &cam, host_ns);
  view->i_exposure = (int)slot_of(sim, host_ns);
  view->i_sub_view = -1;
}

void sv_sim_heldout_view(const sv_sim *sim, int i, int n, sv_view *view, double *time_s) {
  const int64_t slot = n > 0 ? (int64_t)i * sim->cfg.n_exposures / n : 0;
  sv_sim_heldout_view_at(sim, i, sv_sim_slot_ns(sim, slot), view);
  *time_s = sv_sim_slot_time_s(sim, slot);
}
