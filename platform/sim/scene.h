// SPDX-License-Identifier: Apache-2.0
// Analytic scenes: convex primitives with solid procedural textures, one sun, a sky, and motions.
// Scenes are centred at the origin, z is up, lengths are metres. Objects fit a sphere of about 1
// m.
#ifndef SV_SIM_SCENE_H
#define SV_SIM_SCENE_H

#include <stdbool.h>
#include <stdint.h>

#include "src/base/vec.h"

#ifdef __cplusplus
extern "C" {
#endif

#define SV_SIM_CAP_PRIMS   64 // one bit each in the shadow grid's masks
#define SV_SIM_CAP_MOTIONS 8

typedef enum {
  SV_SIM_ELLIPSOID, // size_m: three radii
  SV_SIM_BOX,       // size_m: three half sides
  SV_SIM_CAPSULE,   // size_m: radius, half length of the axis (local z) without the caps
  SV_SIM_CYLINDER   // size_m: radius, half height (local z)
} sv_sim_shape;

typedef enum { SV_SIM_NOISE, SV_SIM_CHECKER, SV_SIM_STRIPES, SV_SIM_SPOTS, SV_SIM_BOARD } sv_sim_pattern;

// A chessboard about the origin of its primitive, printed on white without other detail.
#define SV_SIM_BOARD_COLS 10 // squares along x
#define SV_SIM_BOARD_ROWS 7  // and y

// Linear-light reflectances in [0,1]. The pattern mixes a and b, a slow noise tints towards c, and
// three octaves of value noise modulate the brightness, so that no surface is without detail.
typedef struct {
  sv_sim_pattern pattern;
  float cell_m; // size of one pattern cell
  float a[3], b[3], c[3];
  float gloss; // strength of the view-dependent highlight, 0 = matte
} sv_sim_material;

// A motion as a function of time in seconds; angles follow the right-hand rule about axis.
typedef enum { SV_SIM_SWING, SV_SIM_SPIN, SV_SIM_SLIDE } sv_sim_motion_kind;
typedef struct {
  sv_sim_motion_kind kind;
  double pivot_m[3], axis[3]; // unit axis; SLIDE: direction
  double amplitude;           // SWING: rad, SLIDE: m, SPIN: unused
  double hz, phase_rad;
} sv_sim_motion;

typedef struct {
  sv_sim_shape shape;
  float size_m[3];
  double r[9], centre_m[3]; // world_from_local at rest, r row-major
  int i_motion;             // -1: at rest
  bool is_stage;            // floor or wall with all objects on its sunny side: needs no shadow
                            // test
  sv_sim_material material;
} sv_sim_prim;

typedef struct {
  int n_prims, n_motions;
  sv_sim_prim prims[SV_SIM_CAP_PRIMS];
  sv_sim_motion motions[SV_SIM_CAP_MOTIONS];
  double to_sun[3]; // unit, world
  float sun, sky;   // irradiance factors; a white surface facing the sun shows sun + sky
  double radius_m;  // of the sphere about the origin that bounds the scene
} sv_sim_scene;

typedef enum {
#define X(id, name, arc_deg, distance_m, text) SV_SIM_SCENE_##id,
#include "platform/sim/scenes.inc"
#undef X
  SV_SIM_N_SCENES
} sv_sim_scene_id;

void sv_sim_scene_build(sv_sim_scene *scene, sv_sim_scene_id id);

// Pose of a primitive at a time: world_from_local.
void sv_sim_prim_pose(const sv_sim_scene *scene, int i_prim, double time_s, sv_pose *world_from_local);

#ifdef __cplusplus
}
#endif
#endif
