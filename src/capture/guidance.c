// SPDX-License-Identifier: Apache-2.0
#include "src/capture/guidance.h"

#include <math.h>
#include <string.h>

#include "src/base/mathx.h"

#define DEG         (SV_PI / 180)
#define NO_REACH    1.5  // x SV_GUIDANCE_REACH_DEG: from there on an exposure covers nothing
#define WORTH       0.8  // of the largest gain: as good as any other
#define SMALL       0.35 // of the field, which the ball should fill at least, or resolution is lost
#define LARGE       1.1  // and at most
#define AIM_SHARE   0.7  // of the half field, in which the middle of the scene should be
#define LEAST_SHARE 0.25 // weight of an empty region, over that of a mean one
#define FLAT_EPS    1e-9

const char *sv_hint_name(sv_hint h) {
  static const char *const names[SV_N_HINTS] = {
      [SV_HINT_NONE] = "",
      [SV_HINT_TAKE] = "good, stay here",
      [SV_HINT_RIGHT] = "move right",
      [SV_HINT_LEFT] = "move left",
      [SV_HINT_UP] = "move up",
      [SV_HINT_DOWN] = "move down",
      [SV_HINT_CLOSER] = "closer",
      [SV_HINT_BACK] = "step back",
      [SV_HINT_AIM] = "aim at the middle of the scene",
      [SV_HINT_STILL] = "hold still",
      [SV_HINT_DARK] = "too dark",
      [SV_HINT_BRIGHT] = "too bright",
      [SV_HINT_ENOUGH] = "enough exposures",
  };
  return (unsigned)h < SV_N_HINTS ? names[h] : "";
}

// --- geometry ------------------------------------------------------------------------------------

static bool unit(double v[3]) {
  const double n = sv_norm3(v);
  if (!(n > FLAT_EPS)) return false;
  for (int i = 0; i < 3; i++) v[i] /= n;
  return true;
}

static void region_centre(const sv_guidance *g, int i, double out[3]) {
  const int at[3] = {i % SV_GUIDANCE_SIDE, i / SV_GUIDANCE_SIDE % SV_GUIDANCE_SIDE,
                     i / (SV_GUIDANCE_SIDE * SV_GUIDANCE_SIDE)};
  // The cube inside the ball: half its edge is the radius over the root of 3.
  const double edge = 2 * (double)g->ball.radius / sqrt(3.0) / SV_GUIDANCE_SIDE;
  for (int k = 0; k < 3; k++)
    out[k] = (double)g->ball.centre[k] + (at[k] - 0.5 * (SV_GUIDANCE_SIDE - 1)) * edge;
}

static int region_of(const sv_guidance *g, const float x[3]) {
  const double edge = 2 * (double)g->ball.radius / sqrt(3.0) / SV_GUIDANCE_SIDE;
  int at[3];
  for (int k = 0; k < 3; k++) {
    const double d = ((double)x[k] - (double)g->ball.centre[k]) / edge + 0.5 * SV_GUIDANCE_SIDE;
    // What lies outside of the cube, but inside of the ball, belongs to the region beside it.
    if (!(fabs(d - 0.5 * SV_GUIDANCE_SIDE) < 0.5 * sqrt(3.0) * SV_GUIDANCE_SIDE)) return -1;
    at[k] = sv_clampi((int)floor(d), 0, SV_GUIDANCE_SIDE - 1);
  }
  return (at[2] * SV_GUIDANCE_SIDE + at[1]) * SV_GUIDANCE_SIDE + at[0];
}

// Whether one of the sub-views in use sees a point of the world.
static bool is_seen(const sv_guidance *g, const sv_pose *rig_from_world, const double x[3]) {
  double in_rig[3], in_cam[3], uv[2];
  sv_pose_apply(in_rig, rig_from_world, x);
  for (int i = 0; i < g->n_views; i++) {
    const sv_sub_view *v = &g->cfg.rig->sub_views[g->view[i]];
    sv_pose_apply(in_cam, &v->cam_from_rig, in_rig);
    if (sv_model_project(&v->model, in_cam, uv, NULL, NULL) && uv[0] >= 0 && uv[1] >= 0 &&
        uv[0] <= v->model.width_px && uv[1] <= v->model.height_px)
      return true;
  }
  return false;
}

// Mean place, optical axis and upward direction of the sub-views in use, in the world.
typedef struct {
  double eye[3], forward[3], up[3];
} stand;

static stand stand_of(const sv_guidance *g, const sv_pose *rig_from_world) {
  stand s = {{0}, {0}, {0}};
  for (int i = 0; i < g->n_views; i++) {
    const sv_pose cam = sv_pose_mul(&g->cfg.rig->sub_views[g->view[i]].cam_from_rig, rig_from_world);
    double c[3];
    sv_pose_centre(c, &cam);
    for (int k = 0; k < 3; k++) {
      s.eye[k] += c[k] / g->n_views;
      s.forward[k] += cam.r[6 + k];
      s.up[k] -= cam.r[3 + k];
    }
  }
  if (!unit(s.forward)) s.forward[2] = 1;
  (void)unit(s.up);
  return s;
}

static void to_eye(const sv_guidance *g, const stand *s, double out[3]) {
  for (int k = 0; k < 3; k++) out[k] = s->eye[k] - (double)g->ball.centre[k];
}

// 1 up to the reach, falling to 0 at NO_REACH times that.
static double nearness(double cos_angle) {
  const double reach = SV_GUIDANCE_REACH_DEG * DEG, angle = sv_acos(sv_mind(1, cos_angle));
  return sv_maxd(0, sv_mind(1, (NO_REACH * reach - angle) / ((NO_REACH - 1) * reach)));
}

// Share of the narrower half of the field that the ball fills from a distance.
static double fill(const sv_guidance *g, double distance) {
  return (double)g->ball.radius / (sv_maxd(distance, FLAT_EPS) * sv_tan(g->half_fov_rad));
}

static double resolution(const sv_guidance *g, double distance) {
  return sv_mind(1, fill(g, distance) / SMALL);
}

// --- coverage ------------------------------------------------------------------------------------

// What a place adds to the coverage, weighted; with `into` it is added.
static double cover(const sv_guidance *g, const sv_pose *rig_from_world, double quality,
                    float (*into)[SV_GUIDANCE_CELLS]) {
  const double no_reach = sv_cos(NO_REACH * SV_GUIDANCE_REACH_DEG * DEG);
  const stand s = stand_of(g, rig_from_world);
  double gain = 0, d[3];
  to_eye(g, &s, d);
  quality *= resolution(g, sv_norm3(d));
  for (int r = 0; r < SV_GUIDANCE_REGIONS; r++) {
    double c[3];
    region_centre(g, r, c);
    if (!is_seen(g, rig_from_world, c)) continue;
    sv_sub3(d, s.eye, c);
    if (!unit(d)) continue;
    for (int i = 0; i < SV_GUIDANCE_CELLS; i++) {
      const double cosine = sv_dot3(d, g->cell[i]);
      if (!(g->cell_weight[i] > 0) || cosine <= no_reach) continue;
      const float now = (float)(quality * nearness(cosine)), before = g->covered[r][i];
      if (now <= before) continue;
      gain += (double)(g->region_weight[r] * g->cell_weight[i] * (now - before));
      if (into) into[r][i] = now;
    }
  }
  return gain;
}

// Weights of one: cells by their solid angle inside of the arc.
static void set_cells(sv_guidance *g) {
  const double band = (SV_GUIDANCE_HIGHEST - SV_GUIDANCE_LOWEST) / SV_GUIDANCE_BANDS,
               sector = 360.0 / SV_GUIDANCE_SECTORS,
               arc = g->cfg.arc_deg > 0 && g->cfg.arc_deg < 360 ? g->cfg.arc_deg : 360;
  double sum = 0;
  for (int i = 0; i < SV_GUIDANCE_CELLS; i++) {
    // Sector 0 is at the middle of the arc.
    const int k = i % SV_GUIDANCE_SECTORS, b = i / SV_GUIDANCE_SECTORS;
    const double az = (k < SV_GUIDANCE_SECTORS / 2 ? k : k - SV_GUIDANCE_SECTORS) * sector,
                 el = SV_GUIDANCE_LOWEST + (b + 0.5) * band, cos_el = sv_cos(el * DEG);
    const double dome[3] = {cos_el * sv_cos(az * DEG), cos_el * sv_sin(az * DEG), sv_sin(el * DEG)};
    for (int j = 0; j < 3; j++)
      g->cell[i][j] = g->axes[j] * dome[0] + g->axes[3 + j] * dome[1] + g->axes[6 + j] * dome[2];
    g->cell_weight[i] = fabs(az) <= 0.5 * arc ? (float)cos_el : 0;
    sum += (double)g->cell_weight[i];
  }
  for (int i = 0; i < SV_GUIDANCE_CELLS; i++) g->cell_weight[i] = (float)((double)g->cell_weight[i] / sum);
}

static bool set_axes(sv_guidance *g) {
  double *x = g->axes, *y = g->axes + 3, *z = g->axes + 6;
  memcpy(z, g->cfg.up, sizeof g->cfg.up);
  memcpy(x, g->cfg.middle, sizeof g->cfg.middle);
  if (!(sv_norm3(z) > 0))
    for (int p = 0; p < g->n_places; p++) {
      const stand s = stand_of(g, &g->place[p].rig_from_world);
      for (int k = 0; k < 3; k++) z[k] += s.up[k];
    }
  if (!unit(z)) return false;
  if (!(sv_norm3(x) > 0)) {
    const stand s = stand_of(g, &g->place[0].rig_from_world);
    to_eye(g, &s, x);
  }
  const double along = sv_dot3(x, z);
  for (int k = 0; k < 3; k++) x[k] -= along * z[k];
  if (!unit(x)) { // straight from above: any azimuth
    const double any[3] = {fabs(z[0]) < 0.9, fabs(z[0]) >= 0.9, 0};
    sv_cross3(x, any, z);
    (void)unit(x);
  }
  sv_cross3(y, z, x);
  return true;
}

static void find_ball(sv_guidance *g) {
  if (g->cfg.bounds.radius > 0) {
    g->ball = g->cfg.bounds;
    return;
  }
  for (int p = 0; p < g->n_places; p++) {
    const sv_sub_view *v = &g->cfg.rig->sub_views[g->view[0]];
    const sv_pose cam = sv_pose_mul(&v->cam_from_rig, &g->place[p].rig_from_world);
    g->scratch[p] = sv_view_make(v->model.width_px, v->model.height_px, v->model.p, &cam);
  }
  g->ball = sv_bounds_of_views(g->scratch, g->n_places);
}

static void equal_regions(sv_guidance *g) {
  for (int r = 0; r < SV_GUIDANCE_REGIONS; r++) g->region_weight[r] = 1.0f / SV_GUIDANCE_REGIONS;
}

static void recompute(sv_guidance *g) {
  const bool is_given = g->cfg.bounds.radius > 0 && sv_norm3(g->cfg.up) > 0 && sv_norm3(g->cfg.middle) > 0;
  g->has_scene = false;
  memset(g->covered, 0, sizeof g->covered);
  if (!g->n_places && !is_given) return;
  find_ball(g);
  if (!(g->ball.radius > 0) || !set_axes(g)) return;
  set_cells(g);
  g->has_scene = true;
  for (int p = 0; p < g->n_places; p++)
    (void)cover(g, &g->place[p].rig_from_world, (double)g->place[p].quality, g->covered);
}

void sv_guidance_init(sv_guidance *g, const sv_guidance_cfg *cfg) {
  memset(g, 0, sizeof *g);
  g->cfg = *cfg;
  g->i_cell = g->i_target = -1;
  const int n = cfg->rig ? cfg->rig->n_sub_views : 0;
  g->n_views = sv_mini(n, SV_GUIDANCE_CAP_VIEWS);
  for (int i = 0; i < g->n_views; i++)
    g->view[i] = g->n_views > 1 ? (int)((int64_t)i * (n - 1) / (g->n_views - 1)) : 0;
  equal_regions(g);
  if (!n) return;
  const sv_camera_model *m = &cfg->rig->sub_views[0].model;
  const double edge[2][2] = {{0.5 * m->width_px, 0}, {0, 0.5 * m->height_px}};
  double middle[3], ray[3];
  g->half_fov_rad = 0.5;
  for (int i = 0; i < 2; i++)
    if (sv_model_unproject(m, (double[]){0.5 * m->width_px, 0.5 * m->height_px}, middle) &&
        sv_model_unproject(m, edge[i], ray)) {
      const double half = sv_mind(sv_angle_between(middle, ray), 1.2);
      g->half_fov_rad = i ? sv_mind(half, g->half_fov_rad) : half;
    }
  recompute(g);
}

void sv_guidance_set_scene(sv_guidance *g, const sv_bounds *ball, const sv_point *point, int n_points) {
  int n_in = 0, count[SV_GUIDANCE_REGIONS] = {0};
  if (ball) g->cfg.bounds = *ball;
  if (g->cfg.bounds.radius > 0) g->ball = g->cfg.bounds;
  for (int i = 0; point && g->ball.radius > 0 && i < n_points; i++) {
    const int r = region_of(g, point[i].mean);
    if (r < 0) continue;
    count[r]++;
    n_in++;
  }
  g->has_points = n_in > 0;
  equal_regions(g);
  for (int r = 0; n_in && r < SV_GUIDANCE_REGIONS; r++)
    g->region_weight[r] =
        (float)(((double)count[r] / n_in + LEAST_SHARE / SV_GUIDANCE_REGIONS) / (1 + LEAST_SHARE));
  recompute(g);
}

// --- hints ---------------------------------------------------------------------------------------

// The exposure that a person would take from a cell's middle, at a distance, aimed at the scene.
static bool pose_at(const sv_guidance *g, int i_cell, double distance, sv_pose *rig_from_world) {
  double eye[3], at[3];
  for (int k = 0; k < 3; k++) {
    at[k] = (double)g->ball.centre[k];
    eye[k] = at[k] + distance * g->cell[i_cell][k];
  }
  return sv_pose_look_at(rig_from_world, eye, at, g->axes + 6);
}

static int nearest_cell(const sv_guidance *g, const double d[3]) {
  int best = -1;
  for (int i = 0; i < SV_GUIDANCE_CELLS; i++)
    if (best < 0 || sv_dot3(d, g->cell[i]) > sv_dot3(d, g->cell[best])) best = i;
  return best;
}

// The nearest of the cells from which an exposure adds about as much as from the best one.
static void find_target(sv_guidance *g, const double d[3], double distance) {
  double gain[SV_GUIDANCE_CELLS];
  g->best_gain = 0;
  g->i_target = -1;
  for (int i = 0; i < SV_GUIDANCE_CELLS; i++) {
    sv_pose pose;
    gain[i] = g->cell_weight[i] > 0 && pose_at(g, i, distance, &pose) ? cover(g, &pose, 1, NULL) : 0;
    g->best_gain = sv_maxd(g->best_gain, gain[i]);
  }
  for (int i = 0; i < SV_GUIDANCE_CELLS; i++)
    if (g->best_gain > 0 && gain[i] >= WORTH * g->best_gain &&
        (g->i_target < 0 || sv_dot3(d, g->cell[i]) > sv_dot3(d, g->cell[g->i_target])))
      g->i_target = i;
}

// Around the scene to the target: the larger of the two ways first.
static sv_hint way_to(const sv_guidance *g, const double d[3]) {
  const double *t = g->cell[g->i_target], *x = g->axes, *y = g->axes + 3, *z = g->axes + 6;
  // Above 0: the target is higher.
  const double el = sv_acos(sv_dot3(d, z)) - sv_acos(sv_dot3(t, z));
  double az = sv_atan2(sv_dot3(t, y), sv_dot3(t, x)) - sv_atan2(sv_dot3(d, y), sv_dot3(d, x));
  if (az > SV_PI) az -= 2 * SV_PI;
  if (az < -SV_PI) az += 2 * SV_PI;
  const double along = sqrt(sv_maxd(0, 1 - sv_dot3(t, z) * sv_dot3(t, z)));
  if (fabs(az) * along >= fabs(el)) return az > 0 ? SV_HINT_RIGHT : SV_HINT_LEFT;
  return el > 0 ? SV_HINT_UP : SV_HINT_DOWN;
}

double sv_guidance_quality(const sv_guidance_shot *shot) {
  double q = sv_mind(1, sv_maxd(0, shot->sharpness));
  if (q >= SV_GUIDANCE_SHARP) q = 1;
  if (shot->luma >= 0 && shot->luma < SV_GUIDANCE_DARK) q *= shot->luma / SV_GUIDANCE_DARK;
  if (shot->clipped > SV_GUIDANCE_CLIPPED) q *= 0.5 * (1 - sv_mind(1, shot->clipped));
  return q;
}

static sv_hint place_hint(sv_guidance *g, const sv_guidance_shot *shot) {
  const stand s = stand_of(g, shot->rig_from_world);
  double d[3];
  to_eye(g, &s, d);
  const double distance = sv_norm3(d), far = (double)g->ball.radius / (SMALL * sv_tan(g->half_fov_rad)),
               near = (double)g->ball.radius / (LARGE * sv_tan(g->half_fov_rad));
  const double back[3] = {-d[0], -d[1], -d[2]};
  if (!unit(d)) return SV_HINT_BACK;
  g->i_cell = nearest_cell(g, d);
  g->gain = sv_guidance_gain(g, shot->rig_from_world);
  find_target(g, d, sv_maxd(near, sv_mind(far, distance)));
  if (sv_guidance_coverage(g) >= SV_GUIDANCE_ENOUGH || g->i_target < 0) return SV_HINT_ENOUGH;
  if (g->gain >= WORTH * g->best_gain) return SV_HINT_TAKE;
  if (distance > 1.1 * far) return SV_HINT_CLOSER;
  if (distance < 0.9 * near) return SV_HINT_BACK;
  if (sv_angle_between(back, s.forward) > AIM_SHARE * g->half_fov_rad) return SV_HINT_AIM;
  // At the target, and yet less is gained: its neighbours' share is what is missing.
  return g->i_target == g->i_cell ? SV_HINT_TAKE : way_to(g, d);
}

void sv_guidance_look(sv_guidance *g, const sv_guidance_shot *shot) {
  g->hint = SV_HINT_NONE;
  g->i_cell = g->i_target = -1;
  g->gain = g->best_gain = 0;
  if (shot->rig_from_world && g->has_scene) g->hint = place_hint(g, shot);
  // The first one has nothing to be compared with.
  else if (shot->rig_from_world && g->cfg.rig) g->hint = SV_HINT_TAKE;
  if (g->hint == SV_HINT_ENOUGH) return;
  if (shot->luma >= 0 && shot->luma < SV_GUIDANCE_DARK) g->hint = SV_HINT_DARK;
  else if (shot->clipped > SV_GUIDANCE_CLIPPED) g->hint = SV_HINT_BRIGHT;
  else if (shot->sharpness < SV_GUIDANCE_SHARP) g->hint = SV_HINT_STILL;
}

void sv_guidance_keep(sv_guidance *g, const sv_guidance_shot *shot) {
  const double quality = sv_guidance_quality(shot);
  g->n_kept++;
  g->n_good += quality >= SV_GUIDANCE_SHARP;
  if (!shot->rig_from_world || !g->n_views) return;
  const bool is_listed = g->n_places < SV_GUIDANCE_CAP;
  if (is_listed) g->place[g->n_places++] = (sv_guidance_place){*shot->rig_from_world, (float)quality};
  const bool is_fixed = g->has_scene && g->cfg.bounds.radius > 0 && sv_norm3(g->cfg.up) > 0;
  if (is_fixed || !is_listed) (void)cover(g, shot->rig_from_world, quality, g->covered);
  else recompute(g);
}

// --- results -------------------------------------------------------------------------------------

double sv_guidance_gain(const sv_guidance *g, const sv_pose *rig_from_world) {
  return g->has_scene ? cover(g, rig_from_world, 1, NULL) : 0;
}

double sv_guidance_cell(const sv_guidance *g, int i_cell) {
  double sum = 0;
  for (int r = 0; r < SV_GUIDANCE_REGIONS; r++) sum += (double)(g->region_weight[r] * g->covered[r][i_cell]);
  return sum;
}

double sv_guidance_region(const sv_guidance *g, int i_region) {
  double sum = 0;
  for (int i = 0; i < SV_GUIDANCE_CELLS; i++) sum += (double)(g->cell_weight[i] * g->covered[i_region][i]);
  return sum;
}

double sv_guidance_coverage(const sv_guidance *g) {
  double sum = 0;
  if (!g->has_scene) return -1;
  for (int i = 0; i < SV_GUIDANCE_CELLS; i++) sum += (double)g->cell_weight[i] * sv_guidance_cell(g, i);
  return sum;
}

void sv_guidance_line(const sv_guidance *g, sv_str *line) {
  const double coverage = sv_guidance_coverage(g);
  sv_str_add(line, "%d good exposure%s", g->n_good, g->n_good == 1 ? "" : "s");
  if (coverage >= 0) sv_str_add(line, "  coverage %.0f %%", 100 * coverage);
  if (g->hint != SV_HINT_NONE) sv_str_add(line, "  %s", sv_hint_name(g->hint));
}
