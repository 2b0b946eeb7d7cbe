// SPDX-License-Identifier: Apache-2.0
// Prepares a shot: poses, screen bounds and the shadow grid. Runs once a frame, in double.
#include <math.h>
#include <string.h>

#include "platform/sim/trace.h"
#include "src/base/rng.h"

#define NEAR_M    0.05 // a primitive closer than this is taken to cover the whole image
#define FINE_PX   2.0  // parts with a smaller half width can fall between pixel centres
#define MARGIN_PX 1.5

static void extents(const sv_sim_prim *p, double e[3]) { // half sides of the box around it, local
  for (int i = 0; i < 3; i++) e[i] = (double)p->size_m[i];
  if (p->shape == SV_SIM_CAPSULE || p->shape == SV_SIM_CYLINDER) {
    e[0] = e[1] = (double)p->size_m[0];
    e[2] = (double)p->size_m[1] + (p->shape == SV_SIM_CAPSULE ? e[0] : 0);
  }
}

static void corner(double out[3], const sv_pose *cam_from_local, const double e[3], int i) {
  double x[3] = {i & 1 ? e[0] : -e[0], i & 2 ? e[1] : -e[1], i & 4 ? e[2] : -e[2]};
  sv_pose_apply(out, cam_from_local, x);
}

static int to_px(double x, int limit) { return x < 0 ? 0 : x > limit ? limit : (int)x; }

// Bounds of the projected box: exact enough, since perspective keeps convex hulls.
static void bound(sv_sim_seen *s, const sv_view *v, const sv_pose *pose, const double e[3]) {
  double lo[3] = {1e30, 1e30, 1e30}, hi[3] = {-1e30, -1e30, -1e30};
  for (int i = 0; i < 8; i++) {
    double x[3];
    corner(x, pose, e, i);
    if (x[2] < lo[2]) lo[2] = x[2];
    if (x[2] > hi[2]) hi[2] = x[2];
    double z = x[2] > NEAR_M ? x[2] : NEAR_M;
    double u[2] = {(double)v->fx * x[0] / z + (double)v->cx, (double)v->fy * x[1] / z + (double)v->cy};
    for (int k = 0; k < 2; k++) {
      if (u[k] < lo[k]) lo[k] = u[k];
      if (u[k] > hi[k]) hi[k] = u[k];
    }
  }
  s->near_m = (float)lo[2];
  s->x0_px = s->y0_px = 0;
  s->x1_px = v->width_px;
  s->y1_px = v->height_px;
  if (hi[2] <= NEAR_M) s->x1_px = s->y1_px = 0; // behind the camera
  else if (lo[2] > NEAR_M) {
    s->x0_px = to_px(lo[0] - MARGIN_PX, v->width_px);
    s->x1_px = to_px(hi[0] + MARGIN_PX + 1, v->width_px);
    s->y0_px = to_px(lo[1] - MARGIN_PX, v->height_px);
    s->y1_px = to_px(hi[1] + MARGIN_PX + 1, v->height_px);
  }
}

// Of a fisheye: the distance to the box, anywhere in the picture.
static void bound_wide(sv_sim_seen *s, const sv_view *v, const double e[3]) {
  double d2 = 0;
  for (int i = 0; i < 3; i++) {
    const double beyond = fabs((double)s->o[i]) - e[i];
    if (beyond > 0) d2 += beyond * beyond;
  }
  s->near_m = (float)sqrt(d2);
  s->x0_px = s->y0_px = 0;
  s->x1_px = v->width_px;
  s->y1_px = v->height_px;
}

// A part whose half width is below FINE_PX also gets a widened shape that marks the pixels around
// it.
static void widen(sv_sim_seen *s, const sv_sim_prim *p, const sv_view *v) {
  double z = (double)s->near_m > NEAR_M ? (double)s->near_m : NEAR_M, px_m = z / (double)v->fx;
  int n = p->shape == SV_SIM_ELLIPSOID || p->shape == SV_SIM_BOX ? 3 : 1;
  for (int i = 0; i < 3; i++) {
    s->half[i] = p->size_m[i];
    s->wide[i] = p->size_m[i] + (float)(1.2 * px_m);
    if (i < n && (double)p->size_m[i] < FINE_PX * px_m) s->is_fine = true;
  }
}

static void order_by_depth(sv_sim_shot *shot) {
  shot->n_order = 0;
  for (int i = 0; i < shot->n_prims; i++) {
    const sv_sim_seen *s = &shot->seen[i];
    if (s->x0_px >= s->x1_px || s->y0_px >= s->y1_px) continue;
    int k = shot->n_order++;
    for (; k > 0 && shot->seen[shot->order[k - 1]].near_m > s->near_m; k--)
      shot->order[k] = shot->order[k - 1];
    shot->order[k] = (uint8_t)i;
  }
}

// A box seen along the sun's rays is a hexagon, the sum of its three half axes. It misses a cell
// when one of its edge directions separates the two.
typedef struct {
  double centre[2], axis[3][2];
} footprint;

static footprint project(const sv_sim_shot *shot, const sv_pose *pose, const double e[3]) {
  footprint f;
  const float *rows[2] = {shot->grid_u, shot->grid_v};
  for (int k = 0; k < 2; k++) {
    double r[3] = {(double)rows[k][0], (double)rows[k][1], (double)rows[k][2]};
    f.centre[k] = sv_dot3(r, pose->t) + (double)rows[k][3];
    for (int j = 0; j < 3; j++)
      f.axis[j][k] = (r[0] * pose->r[j] + r[1] * pose->r[3 + j] + r[2] * pose->r[6 + j]) * e[j];
  }
  return f;
}

static bool meets(const footprint *f, double u, double v) {
  for (int k = 0; k < 3; k++) {
    double n[2] = {-f->axis[k][1], f->axis[k][0]};
    double reach = 0.51 * (fabs(n[0]) + fabs(n[1])); // half a cell, and a little for rounding
    for (int j = 0; j < 3; j++) reach += fabs(f->axis[j][0] * n[0] + f->axis[j][1] * n[1]);
    if (fabs((u - f->centre[0]) * n[0] + (v - f->centre[1]) * n[1]) > reach) return false;
  }
  return true;
}

// Marks the cells that primitive i covers when seen along the sun's rays.
static void mark(sv_sim_shot *shot, int i, const sv_pose *pose, const double e[3]) {
  double lo[3] = {1e30, 1e30, 1e30}, hi[3] = {-1e30, -1e30, -1e30};
  const float *rows[3] = {shot->grid_u, shot->grid_v, shot->grid_w};
  for (int c = 0; c < 8; c++) {
    double x[3];
    corner(x, pose, e, c);
    for (int k = 0; k < 3; k++) {
      const float *r = rows[k];
      double w = (double)r[0] * x[0] + (double)r[1] * x[1] + (double)r[2] * x[2] + (double)r[3];
      if (w < lo[k]) lo[k] = w;
      if (w > hi[k]) hi[k] = w;
    }
  }
  shot->seen[i].sunward_m = (float)hi[2];
  int u0 = to_px(lo[0] - 0.01, SV_SIM_GRID - 1), u1 = to_px(hi[0] + 0.01, SV_SIM_GRID - 1);
  int v0 = to_px(lo[1] - 0.01, SV_SIM_GRID - 1), v1 = to_px(hi[1] + 0.01, SV_SIM_GRID - 1);
  footprint f = project(shot, pose, e);
  for (int v = v0; v <= v1; v++)
    for (int u = u0; u <= u1; u++) {
      bool is_border = u == 0 || v == 0 || u == SV_SIM_GRID - 1 || v == SV_SIM_GRID - 1;
      if (is_border || meets(&f, u + 0.5, v + 0.5)) shot->grid[v * SV_SIM_GRID + u] |= 1ull << i;
    }
}

// Two axes across the sun's direction; the grid spans a little more than the scene's sphere, and
// its border cells also stand for everything beyond them.
static void set_grid(sv_sim_shot *shot, const sv_pose *cam_from_world) {
  double up[3] = {0, 0, 1}, u[3], v[3];
  const double *sun = shot->scene->to_sun;
  sv_cross3(u, up, sun);
  double n = sv_norm3(u), span = 2.6 * shot->scene->radius_m;
  for (int i = 0; i < 3; i++) u[i] /= n;
  sv_cross3(v, sun, u);
  float *rows[3] = {shot->grid_u, shot->grid_v, shot->grid_w};
  const double *axes[3] = {u, v, sun};
  for (int k = 0; k < 3; k++) {
    double c[3], scale = k < 2 ? SV_SIM_GRID / span : 1, shift = k < 2 ? 0.5 * SV_SIM_GRID : 0;
    sv_apply33(c, cam_from_world->r, axes[k]);
    for (int i = 0; i < 3; i++) rows[k][i] = (float)(c[i] * scale);
    rows[k][3] = (float)(shift - sv_dot3(c, cam_from_world->t) * scale);
  }
  memset(shot->grid, 0, sizeof shot->grid);
}

static void see_prim(sv_sim_shot *shot, int i, const sv_pose *cam_from_world, double time_s) {
  const sv_sim_prim *p = &shot->scene->prims[i];
  sv_sim_seen *s = &shot->seen[i];
  sv_pose world_from_local, cam_from_local, local_from_cam;
  double sun[3], up[3] = {0, 0, 1}, cam[3], e[3];
  *s = (sv_sim_seen){0};
  sv_sim_prim_pose(shot->scene, i, time_s, &world_from_local);
  cam_from_local = sv_pose_mul(cam_from_world, &world_from_local);
  local_from_cam = sv_pose_inv(&cam_from_local);
  sv_apply33(cam, cam_from_world->r, shot->scene->to_sun);
  sv_apply33(sun, local_from_cam.r, cam);
  sv_apply33(cam, cam_from_world->r, up);
  sv_apply33(up, local_from_cam.r, cam);
  for (int k = 0; k < 9; k++) s->m[k] = (float)local_from_cam.r[k];
  for (int k = 0; k < 3; k++) {
    s->o[k] = (float)local_from_cam.t[k];
    s->sun[k] = (float)sun[k];
    s->up[k] = (float)up[k];
    s->texture_origin[k] = 16.0f + (float)(sv_hash3((uint32_t)i, (uint32_t)k, 77) & 63) + 0.37f;
    if (p->material.pattern == SV_SIM_BOARD) s->texture_origin[k] = k == 0 ? 0.5f : 0.0f;
  }
  extents(p, e);
  if (shot->view.fisheye) bound_wide(s, &shot->view, e);
  else bound(s, &shot->view, &cam_from_local, e);
  widen(s, p, &shot->view);
  if (!p->is_stage) mark(shot, i, &cam_from_local, e);
}

void sv_sim_shot_prepare(sv_sim_shot *shot, const sv_sim_scene *scene, const sv_view *view, double time_s) {
  sv_pose cam_from_world;
  for (int i = 0; i < 9; i++) cam_from_world.r[i] = (double)view->r[i];
  for (int i = 0; i < 3; i++) cam_from_world.t[i] = (double)view->t[i];
  shot->scene = scene;
  shot->view = *view;
  shot->lean[0] = shot->lean[1] = 0;
  shot->n_prims = scene->n_prims;
  set_grid(shot, &cam_from_world);
  for (int i = 0; i < scene->n_prims; i++) see_prim(shot, i, &cam_from_world, time_s);
  order_by_depth(shot);
}
