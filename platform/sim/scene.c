// SPDX-License-Identifier: Apache-2.0
#include "platform/sim/scene.h"

#include <string.h>

#include "src/base/mathx.h"

// Reflectances stay between 0.02 and 0.9: black pixels are then background, and nothing saturates.
static const sv_sim_material
    brick = {SV_SIM_CHECKER,        0.16f, {0.75f, 0.16f, 0.08f}, {0.85f, 0.72f, 0.50f},
             {0.30f, 0.05f, 0.10f}, 0.0f},
    ocean = {SV_SIM_NOISE, 0.14f, {0.03f, 0.12f, 0.55f}, {0.55f, 0.85f, 0.85f}, {0.05f, 0.45f, 0.25f}, 0.10f},
    moss = {SV_SIM_SPOTS, 0.11f, {0.10f, 0.42f, 0.06f}, {0.88f, 0.80f, 0.12f}, {0.03f, 0.20f, 0.18f}, 0.0f},
    wood = {SV_SIM_STRIPES, 0.08f, {0.46f, 0.24f, 0.09f}, {0.72f, 0.50f, 0.26f}, {0.30f, 0.12f, 0.04f}, 0.0f},
    violet = {SV_SIM_STRIPES,        0.11f, {0.42f, 0.08f, 0.55f}, {0.90f, 0.62f, 0.70f},
              {0.12f, 0.10f, 0.60f}, 0.08f},
    stone = {SV_SIM_NOISE, 0.15f, {0.22f, 0.22f, 0.24f}, {0.78f, 0.74f, 0.68f}, {0.45f, 0.36f, 0.28f}, 0.0f},
    amber = {SV_SIM_SPOTS, 0.12f, {0.88f, 0.40f, 0.04f}, {0.40f, 0.08f, 0.03f}, {0.90f, 0.75f, 0.15f}, 0.12f},
    steel = {SV_SIM_STRIPES,        0.10f, {0.55f, 0.58f, 0.62f}, {0.20f, 0.24f, 0.32f},
             {0.70f, 0.62f, 0.50f}, 0.15f},
    copper = {SV_SIM_NOISE,          0.08f, {0.80f, 0.35f, 0.16f}, {0.35f, 0.55f, 0.42f},
              {0.90f, 0.60f, 0.30f}, 0.10f},
    leaf = {SV_SIM_STRIPES, 0.06f, {0.12f, 0.55f, 0.10f}, {0.45f, 0.78f, 0.20f}, {0.70f, 0.70f, 0.10f}, 0.0f},
    tile = {SV_SIM_CHECKER, 0.25f, {0.70f, 0.68f, 0.62f}, {0.16f, 0.24f, 0.34f}, {0.50f, 0.32f, 0.20f}, 0.0f},
    paper = {SV_SIM_SPOTS, 0.20f, {0.80f, 0.74f, 0.55f}, {0.28f, 0.48f, 0.52f}, {0.85f, 0.55f, 0.45f}, 0.0f},
    plaster = {SV_SIM_NOISE,          0.22f, {0.48f, 0.58f, 0.66f}, {0.85f, 0.86f, 0.80f},
               {0.62f, 0.44f, 0.50f}, 0.0f},
    board = {.pattern = SV_SIM_BOARD, .cell_m = 0.12f, .a = {0.8f, 0.8f, 0.8f}, .b = {0.03f, 0.03f, 0.03f}};

typedef struct {
  double x, y, z;
} xyz;

static sv_sim_prim *add(sv_sim_scene *s, sv_sim_shape shape, const sv_sim_material *m, xyz centre_m,
                        xyz size_m) {
  sv_sim_prim *p = &s->prims[s->n_prims++];
  *p = (sv_sim_prim){.shape = shape,
                     .material = *m,
                     .i_motion = -1,
                     .r = {1, 0, 0, 0, 1, 0, 0, 0, 1},
                     .size_m = {(float)size_m.x, (float)size_m.y, (float)size_m.z},
                     .centre_m = {centre_m.x, centre_m.y, centre_m.z}};
  return p;
}

static sv_sim_prim *ball(sv_sim_scene *s, const sv_sim_material *m, double x, double y, double z, double r) {
  return add(s, SV_SIM_ELLIPSOID, m, (xyz){x, y, z}, (xyz){r, r, r});
}

static void turn(sv_sim_prim *p, double wx_rad, double wy_rad, double wz_rad) {
  double w[3] = {wx_rad, wy_rad, wz_rad};
  sv_rodrigues(p->r, w);
}

// A rod with round ends from a to b; its local z axis runs along it.
static sv_sim_prim *rod(sv_sim_scene *s, const sv_sim_material *m, const double a[3], const double b[3],
                        double radius_m) {
  double mid[3], z[3], x[3], y[3];
  for (int i = 0; i < 3; i++) mid[i] = 0.5 * (a[i] + b[i]);
  sv_sub3(z, b, a);
  double len = sv_norm3(z);
  for (int i = 0; i < 3; i++) z[i] /= len;
  double helper[3] = {z[2] > 0.9 || z[2] < -0.9, 0, !(z[2] > 0.9 || z[2] < -0.9)};
  sv_cross3(x, helper, z);
  double nx = sv_norm3(x);
  for (int i = 0; i < 3; i++) x[i] /= nx;
  sv_cross3(y, z, x);
  sv_sim_prim *p = add(s, SV_SIM_CAPSULE, m, (xyz){mid[0], mid[1], mid[2]}, (xyz){radius_m, 0.5 * len, 0});
  for (int i = 0; i < 3; i++) {
    p->r[i * 3] = x[i];
    p->r[i * 3 + 1] = y[i];
    p->r[i * 3 + 2] = z[i];
  }
  return p;
}

static void on_circle(double out[3], double radius_m, double angle_rad, double z) {
  out[0] = radius_m * sv_cos(angle_rad);
  out[1] = radius_m * sv_sin(angle_rad);
  out[2] = z;
}

// A ring of n rods.
typedef struct {
  int n;
  double radius_m, z_m, tilt_rad, thick_m;
} ring_size;

static void ring(sv_sim_scene *s, const sv_sim_material *m, const ring_size *g) {
  for (int i = 0; i < g->n; i++) {
    double a[3], b[3], r[9], w[3] = {g->tilt_rad, 0, 0};
    on_circle(a, g->radius_m, 2 * SV_PI * i / g->n, 0);
    on_circle(b, g->radius_m, 2 * SV_PI * (i + 1) / g->n, 0);
    sv_rodrigues(r, w);
    sv_apply33(a, r, a);
    sv_apply33(b, r, b);
    a[2] += g->z_m;
    b[2] += g->z_m;
    rod(s, m, a, b, g->thick_m);
  }
}

static void build_textured(sv_sim_scene *s) {
  add(s, SV_SIM_CYLINDER, &stone, (xyz){0, 0, -0.70}, (xyz){0.72, 0.10, 0})->is_stage = true;
  ball(s, &ocean, 0.16, 0.10, -0.14, 0.46);
  turn(add(s, SV_SIM_BOX, &brick, (xyz){-0.44, -0.20, -0.32}, (xyz){0.22, 0.22, 0.28}), 0, 0, 0.5);
  add(s, SV_SIM_CYLINDER, &violet, (xyz){0.42, -0.44, -0.34}, (xyz){0.19, 0.26, 0});
  turn(add(s, SV_SIM_ELLIPSOID, &amber, (xyz){-0.26, 0.48, -0.38}, (xyz){0.30, 0.20, 0.22}), 0, 0, 0.7);
  turn(add(s, SV_SIM_BOX, &moss, (xyz){0.10, 0.08, 0.48}, (xyz){0.24, 0.20, 0.16}), 0.25, 0.2, 0.9);
  double a[3] = {-0.62, -0.24, 0.08}, b[3] = {-0.28, -0.16, 0.52};
  rod(s, &copper, a, b, 0.12);
  ball(s, &brick, 0.06, 0.06, 0.80, 0.15);
}

static void build_thin(sv_sim_scene *s) {
  add(s, SV_SIM_CYLINDER, &wood, (xyz){0, 0, -0.80}, (xyz){0.55, 0.06, 0})->is_stage = true;
  double foot[3] = {0, 0, -0.74}, top[3] = {0, 0, 0.86};
  rod(s, &steel, foot, top, 0.035);
  ring(s, &copper, &(ring_size){16, 0.62, 0.30, 0.0, 0.022});
  ring(s, &amber, &(ring_size){12, 0.38, 0.62, 0.5, 0.018});
  for (int i = 0; i < 6; i++) { // spokes of the large ring, and stays down to the base
    double hub[3] = {0, 0, 0.30}, rim[3], low[3];
    on_circle(rim, 0.62, 2 * SV_PI * i / 6, 0.30);
    on_circle(low, 0.46, 2 * SV_PI * i / 6 + 0.9, -0.74);
    rod(s, i & 1 ? &steel : &ocean, hub, rim, 0.014);
    rod(s, i & 1 ? &violet : &amber, rim, low, 0.012);
  }
  for (int i = 0; i < 7; i++) { // leaves on a spiral round the mast
    double c[3];
    on_circle(c, 0.24, 2.4 * i, -0.60 + 0.12 * i);
    turn(add(s, SV_SIM_ELLIPSOID, &leaf, (xyz){c[0], c[1], c[2]}, (xyz){0.20, 0.09, 0.018}), 0, 0, 2.4 * i);
  }
  for (int i = 0; i < 4; i++) {
    double c[3];
    on_circle(c, 0.42, 2 * SV_PI * i / 4 + 0.4, -0.66);
    ball(s, i & 1 ? &moss : &brick, c[0], c[1], c[2], 0.085);
  }
  ball(s, &violet, 0, 0, 0.90, 0.08);
}

static void build_occlusion(sv_sim_scene *s) {
  add(s, SV_SIM_CYLINDER, &tile, (xyz){0, 0, -0.66}, (xyz){0.76, 0.06, 0})->is_stage = true;
  add(s, SV_SIM_CYLINDER, &stone, (xyz){0, 0, 0.52}, (xyz){0.64, 0.05, 0});
  for (int i = 0; i < 9; i++) { // outer pillars
    double c[3];
    on_circle(c, 0.62, 2 * SV_PI * i / 9, -0.065);
    const sv_sim_material *m = i % 3 == 0 ? &brick : i % 3 == 1 ? &steel : &wood;
    if (i & 1) add(s, SV_SIM_CYLINDER, m, (xyz){c[0], c[1], c[2]}, (xyz){0.06, 0.535, 0});
    else
      turn(add(s, SV_SIM_BOX, m, (xyz){c[0], c[1], c[2]}, (xyz){0.055, 0.055, 0.535}), 0, 0,
           2 * SV_PI * i / 9);
  }
  for (int i = 0; i < 5; i++) { // inner slats, turned against the outer ring
    double c[3];
    on_circle(c, 0.38, 2 * SV_PI * i / 5 + 0.3, -0.24);
    turn(add(s, SV_SIM_BOX, i & 1 ? &violet : &copper, (xyz){c[0], c[1], c[2]}, (xyz){0.02, 0.09, 0.36}), 0,
         0, 2 * SV_PI * i / 5 + 0.3);
  }
  ball(s, &ocean, 0, 0, -0.36, 0.24);
  turn(add(s, SV_SIM_BOX, &amber, (xyz){0, 0, 0.10}, (xyz){0.16, 0.16, 0.16}), 0.6, 0.6, 0);
  ball(s, &moss, 0.0, 0.0, 0.74, 0.19);
}

static int motion(sv_sim_scene *s, sv_sim_motion m) {
  s->motions[s->n_motions] = m;
  return s->n_motions++;
}

static void build_moving(sv_sim_scene *s) {
  add(s, SV_SIM_CYLINDER, &tile, (xyz){0, 0, -0.82}, (xyz){1.05, 0.06, 0})->is_stage = true;
  int swing = motion(s, (sv_sim_motion){SV_SIM_SWING, {-0.35, 0, 0.80}, {0, 1, 0}, 0.55, 0.6, 0.0});
  int spin = motion(s, (sv_sim_motion){SV_SIM_SPIN, {0.40, 0.15, 0}, {0, 0, 1}, 0, 0.35, 0.3});
  int lift = motion(s, (sv_sim_motion){SV_SIM_SLIDE, {0, 0, 0}, {0, 0, 1}, 0.20, 0.8, 1.0});
  double gallows[4][3] = {{-0.35, 0.55, -0.78}, {-0.35, 0.55, 0.84}, {-0.35, -0.12, 0.84}, {-0.35, 0, 0.80}};
  rod(s, &wood, gallows[0], gallows[1], 0.06);
  rod(s, &wood, gallows[1], gallows[2], 0.05);
  double bob[3] = {-0.35, 0, -0.28};
  rod(s, &steel, gallows[3], bob, 0.022)->i_motion = swing;
  ball(s, &amber, -0.35, 0, -0.36, 0.21)->i_motion = swing;
  add(s, SV_SIM_CYLINDER, &stone, (xyz){0.40, 0.15, -0.62}, (xyz){0.10, 0.14, 0});
  add(s, SV_SIM_CYLINDER, &violet, (xyz){0.40, 0.15, -0.42}, (xyz){0.42, 0.05, 0})->i_motion = spin;
  for (int i = 0; i < 3; i++) {
    double c[3];
    on_circle(c, 0.29, 2 * SV_PI * i / 3, 0);
    const sv_sim_material *m = i == 0 ? &ocean : i == 1 ? &moss : &brick;
    double x = 0.40 + c[0], y = 0.15 + c[1];
    if (i == 1) add(s, SV_SIM_BOX, m, (xyz){x, y, -0.24}, (xyz){0.10, 0.10, 0.13})->i_motion = spin;
    else ball(s, m, x, y, -0.24, 0.13)->i_motion = spin;
  }
  turn(add(s, SV_SIM_BOX, &copper, (xyz){0.10, -0.55, -0.35}, (xyz){0.14, 0.14, 0.14}), 0, 0, 0.6);
  s->prims[s->n_prims - 1].i_motion = lift;
  double low[3] = {0.10, -0.55, -0.78}, high[3] = {0.10, -0.55, 0.20};
  rod(s, &steel, low, high, 0.035);
}

// The open side looks along +x and +y: the default arc stays inside it.
static void build_room(sv_sim_scene *s) {
  add(s, SV_SIM_BOX, &tile, (xyz){0.4, 0.4, -0.86}, (xyz){2.6, 2.6, 0.06})->is_stage = true;
  add(s, SV_SIM_BOX, &paper, (xyz){-1.36, 0.4, 0.7}, (xyz){0.06, 2.6, 1.56})->is_stage = true;
  add(s, SV_SIM_BOX, &plaster, (xyz){0.4, -1.36, 0.7}, (xyz){2.6, 0.06, 1.56})->is_stage = true;
  add(s, SV_SIM_BOX, &wood, (xyz){0.15, 0.15, -0.22}, (xyz){0.55, 0.42, 0.035}); // table
  for (int i = 0; i < 4; i++)
    add(s, SV_SIM_BOX, &steel, (xyz){0.15 + (i & 1 ? 0.48 : -0.48), 0.15 + (i & 2 ? 0.35 : -0.35), -0.53},
        (xyz){0.035, 0.035, 0.28});
  ball(s, &amber, 0.30, 0.30, -0.03, 0.155);
  add(s, SV_SIM_CYLINDER, &ocean, (xyz){-0.15, 0.25, -0.06}, (xyz){0.10, 0.125, 0});
  turn(add(s, SV_SIM_BOX, &brick, (xyz){0.02, -0.06, -0.10}, (xyz){0.16, 0.10, 0.085}), 0, 0, 0.4);
  turn(add(s, SV_SIM_BOX, &moss, (xyz){0.04, -0.05, 0.05}, (xyz){0.13, 0.09, 0.06}), 0, 0, 0.9);
  add(s, SV_SIM_BOX, &violet, (xyz){-0.98, -0.70, -0.10}, (xyz){0.26, 0.40, 0.70}); // cupboard
  ball(s, &copper, -0.98, -0.70, 0.76, 0.16);
  double lamp[2][3] = {{0.85, -0.95, -0.80}, {0.85, -0.95, 0.55}};
  rod(s, &steel, lamp[0], lamp[1], 0.035);
  add(s, SV_SIM_ELLIPSOID, &amber, (xyz){0.85, -0.95, 0.62}, (xyz){0.26, 0.26, 0.20});
  turn(add(s, SV_SIM_BOX, &brick, (xyz){-0.55, 0.85, -0.55}, (xyz){0.24, 0.24, 0.25}), 0, 0,
       0.5); // crate
  ball(s, &leaf, -0.55, 0.85, -0.08, 0.22);
  add(s, SV_SIM_BOX, &amber, (xyz){0.10, -1.28, 0.75}, (xyz){0.40, 0.03, 0.28}); // picture
  add(s, SV_SIM_CYLINDER, &leaf, (xyz){0.95, 0.75, -0.68}, (xyz){0.22, 0.12, 0});
}

// Walls, floor and ceiling around the rig's path, for lenses that see to the side and behind.
static void build_hall(sv_sim_scene *s) {
  static const double wall[4][2] = {{6.1, 0}, {-6.1, 0}, {0, 6.1}, {0, -6.1}};
  const sv_sim_material *const covers[4] = {&paper, &plaster, &brick, &stone};
  sv_sim_material big[6] = {tile, wood, *covers[0], *covers[1], *covers[2], *covers[3]};
  for (int i = 0; i < 6; i++) big[i].cell_m *= 4;
  add(s, SV_SIM_BOX, &big[0], (xyz){0, 0, -1.4}, (xyz){6.2, 6.2, 0.1})->is_stage = true;
  add(s, SV_SIM_BOX, &big[1], (xyz){0, 0, 4.6}, (xyz){6.2, 6.2, 0.1})->is_stage = true;
  for (int i = 0; i < 4; i++)
    add(s, SV_SIM_BOX, &big[2 + i], (xyz){wall[i][0], wall[i][1], 1.6},
        i < 2 ? (xyz){0.1, 6.2, 3.1} : (xyz){6.2, 0.1, 3.1})
        ->is_stage = true;
  for (int i = 0; i < 8; i++) { // along the walls, behind the rig's path
    double c[3];
    on_circle(c, 5.3, 2 * SV_PI * (i + 0.5) / 8, -0.5);
    const sv_sim_material *m = i % 3 == 0 ? &violet : i % 3 == 1 ? &amber : &moss;
    if (i & 1) add(s, SV_SIM_CYLINDER, m, (xyz){c[0], c[1], c[2]}, (xyz){0.35, 0.8, 0});
    else turn(add(s, SV_SIM_BOX, m, (xyz){c[0], c[1], c[2]}, (xyz){0.4, 0.4, 0.8}), 0, 0, 0.7 * i);
  }
  add(s, SV_SIM_CYLINDER, &stone, (xyz){0, 0, -1.0}, (xyz){1.2, 0.3, 0});
  ball(s, &ocean, 0.3, 0.2, 0.0, 0.7);
  turn(add(s, SV_SIM_BOX, &copper, (xyz){-0.6, -0.3, -0.35}, (xyz){0.32, 0.32, 0.35}), 0, 0, 0.5);
  add(s, SV_SIM_CYLINDER, &violet, (xyz){0.5, -0.7, -0.4}, (xyz){0.25, 0.3, 0});
  ball(s, &amber, -0.4, 0.75, -0.4, 0.3);
}

// Things of the size of a hand on a stand high above a yard: nothing is between them and 10 m.
static void build_field(sv_sim_scene *s) {
  static const sv_sim_material *const covers[6] = {&brick, &plaster, &moss, &stone, &wood, &paper};
  const double down_m = -8;
  sv_sim_material ground = stone, hill[3] = {moss, stone, plaster}, cover, small[3] = {ocean, amber, brick};
  ground.cell_m = 1.6f;
  add(s, SV_SIM_BOX, &ground, (xyz){0, 0, down_m - 0.5}, (xyz){90, 90, 0.5})->is_stage = true;
  for (int i = 0; i < 12; i++) { // around the yard
    double c[3];
    on_circle(c, 70, 2 * SV_PI * i / 12, 12);
    cover = hill[i % 3];
    cover.cell_m = 3.0f;
    turn(add(s, SV_SIM_BOX, &cover, (xyz){c[0], c[1], c[2]}, (xyz){1, 20, 20 + 2.0 * (i % 4)}), 0, 0,
         2 * SV_PI * i / 12);
    s->prims[s->n_prims - 1].is_stage = true;
  }
  for (int i = 0; i < 24; i++) { // in it
    double c[3], half_m = 1.2 + 0.4 * (i % 4), high_m = 1.5 + 0.7 * (i % 5);
    on_circle(c, 12 + 1.6 * i, 2.4 * i, down_m + high_m);
    cover = *covers[i % 6];
    cover.cell_m *= 5;
    if (i % 3 == 2) add(s, SV_SIM_CYLINDER, &cover, (xyz){c[0], c[1], c[2]}, (xyz){half_m, high_m, 0});
    else
      turn(add(s, SV_SIM_BOX, &cover, (xyz){c[0], c[1], c[2]}, (xyz){half_m, half_m, high_m}), 0, 0, 0.9 * i);
    s->prims[s->n_prims - 1].is_stage = true;
  }
  for (int i = 0; i < 3; i++) small[i].cell_m *= 0.35f;
  cover = wood;
  cover.cell_m *= 0.4f;
  add(s, SV_SIM_CYLINDER, &cover, (xyz){0, 0, -0.17}, (xyz){0.2, 0.03, 0})->is_stage = true;
  ball(s, &small[0], 0.06, 0.05, -0.04, 0.10);
  turn(add(s, SV_SIM_BOX, &small[2], (xyz){-0.09, -0.05, -0.06}, (xyz){0.06, 0.05, 0.08}), 0, 0, 0.5);
  add(s, SV_SIM_CYLINDER, &small[1], (xyz){0.07, -0.11, -0.07}, (xyz){0.04, 0.07, 0});
}

// Faces the middle of the default trajectories.
static void build_board(sv_sim_scene *s) {
  const double az = SV_PI / 4, el = SV_PI / 6,
               z[3] = {sv_cos(el) * sv_cos(az), sv_cos(el) * sv_sin(az), sv_sin(el)},
               x[3] = {-sv_sin(az), sv_cos(az), 0};
  double y[3];
  sv_sim_prim *p = add(s, SV_SIM_BOX, &board, (xyz){0, 0, 0}, (xyz){0.80, 0.62, 0.01});
  sv_cross3(y, z, x);
  for (int i = 0; i < 3; i++) {
    p->r[3 * i] = x[i];
    p->r[3 * i + 1] = y[i];
    p->r[3 * i + 2] = z[i];
  }
}

void sv_sim_scene_build(sv_sim_scene *s, sv_sim_scene_id id) {
  memset(s, 0, sizeof *s);
  double sun[3] = {0.45, 0.30, 0.84}, n = sv_norm3(sun);
  for (int i = 0; i < 3; i++) s->to_sun[i] = sun[i] / n;
  s->sun = 0.62f;
  s->sky = 0.38f;
  s->radius_m = id == SV_SIM_SCENE_ROOM    ? 2.2
                : id == SV_SIM_SCENE_HALL  ? 6.0
                : id == SV_SIM_SCENE_FIELD ? 0.3
                                           : 1.1;
  switch (id) {
  case SV_SIM_SCENE_THIN: build_thin(s); break;
  case SV_SIM_SCENE_OCCLUSION: build_occlusion(s); break;
  case SV_SIM_SCENE_MOVING: build_moving(s); break;
  case SV_SIM_SCENE_ROOM: build_room(s); break;
  case SV_SIM_SCENE_HALL: build_hall(s); break;
  case SV_SIM_SCENE_BOARD: build_board(s); break;
  case SV_SIM_SCENE_FIELD: build_field(s); break;
  default: build_textured(s);
  }
}

void sv_sim_prim_pose(const sv_sim_scene *s, int i_prim, double time_s, sv_pose *out) {
  const sv_sim_prim *p = &s->prims[i_prim];
  memcpy(out->r, p->r, sizeof out->r);
  memcpy(out->t, p->centre_m, sizeof out->t);
  if (p->i_motion < 0) return;
  const sv_sim_motion *m = &s->motions[p->i_motion];
  double turns = m->hz * time_s, phase = 2 * SV_PI * (turns - floor(turns)) + m->phase_rad;
  if (m->kind == SV_SIM_SLIDE) {
    double d = m->amplitude * sv_sin(phase);
    for (int i = 0; i < 3; i++) out->t[i] += d * m->axis[i];
    return;
  }
  double angle = m->kind == SV_SIM_SWING ? m->amplitude * sv_sin(phase) : phase, w[3], rel[3];
  sv_pose turn_about = sv_pose_identity();
  for (int i = 0; i < 3; i++) w[i] = angle * m->axis[i];
  sv_rodrigues(turn_about.r, w);
  sv_sub3(rel, out->t, m->pivot_m);
  sv_apply33(rel, turn_about.r, rel);
  sv_mul33(out->r, turn_about.r, out->r);
  for (int i = 0; i < 3; i++) out->t[i] = m->pivot_m[i] + rel[i];
}
