// SPDX-License-Identifier: Apache-2.0
// Guidance: which parts of the scene the exposures kept so far have seen, from which directions,
// and where to go for the next one. Owns the kept places and the coverage derived from them, all in
// one struct of fixed size. Never keeps or drops an exposure, and never looks at a pixel.
//
// The ball around the scene is cut into cubic regions. The directions that are asked for are the
// cells of a dome: sectors of azimuth in bands of elevation. A pair of region and cell is covered
// as well as the best exposure that sees the region from within SV_GUIDANCE_REACH_DEG of the cell.
// Coverage is the weighted mean over the pairs. Weights are the cells' solid angles times, where
// points or Gaussians are known, the share of them that lies in the region.
#ifndef SV_CAPTURE_GUIDANCE_H
#define SV_CAPTURE_GUIDANCE_H

#include "src/base/str.h"
#include "src/base/time.h"
#include "src/rig/bounds.h"
#include "src/rig/rig.h"
#include "src/splat/gaussians.h"

#ifdef __cplusplus
extern "C" {
#endif

#define SV_GUIDANCE_SECTORS   24 // of azimuth, 15 degrees each
#define SV_GUIDANCE_BANDS     4  // of elevation
#define SV_GUIDANCE_CELLS     (SV_GUIDANCE_SECTORS * SV_GUIDANCE_BANDS)
#define SV_GUIDANCE_SIDE      3 // regions along each axis of the ball
#define SV_GUIDANCE_REGIONS   (SV_GUIDANCE_SIDE * SV_GUIDANCE_SIDE * SV_GUIDANCE_SIDE)
#define SV_GUIDANCE_CAP       256  // places that are kept; later ones only add to the coverage
#define SV_GUIDANCE_CAP_VIEWS 4    // sub-views that are asked what they see, spread over the rig
#define SV_GUIDANCE_REACH_DEG 15.0 // an exposure covers directions up to here; 1.5 x: none
#define SV_GUIDANCE_LOWEST    5.0  // degrees of elevation that the dome begins and ends at
#define SV_GUIDANCE_HIGHEST   55.0
#define SV_GUIDANCE_ENOUGH    0.95 // coverage from which on no more exposures are asked for
#define SV_GUIDANCE_DARK      0.05 // mean of the pixels, 0 to 1, below which it is too dark
#define SV_GUIDANCE_CLIPPED   0.15 // share of the pixels at the top from which on it is too bright
#define SV_GUIDANCE_SHARP     0.5  // sharpness, below which an exposure is blurred

typedef enum {
  SV_HINT_NONE,  // nothing is known yet
  SV_HINT_TAKE,  // an exposure from here adds as much as any other would
  SV_HINT_RIGHT, // around the scene
  SV_HINT_LEFT,
  SV_HINT_UP,
  SV_HINT_DOWN,
  SV_HINT_CLOSER,
  SV_HINT_BACK,
  SV_HINT_AIM,   // the middle of the scene is not in the image
  SV_HINT_STILL, // blurred
  SV_HINT_DARK,
  SV_HINT_BRIGHT,
  SV_HINT_ENOUGH,
  SV_N_HINTS
} sv_hint;
const char *sv_hint_name(sv_hint h); // "move right"; "" for NONE

typedef struct {
  // The rig; must outlive the guidance.
  const sv_rig *rig;
  // What is captured lies in this ball; radius 0: not known, it comes from the kept exposures.
  sv_bounds bounds;
  // Direction against gravity in the world; zero: the mean of the cameras' upward directions.
  double up[3];
  // Azimuth around the scene that is asked for, in degrees; 0 or 360: all around.
  double arc_deg;
  // Direction from the scene to the middle of the arc; zero: that of the first exposure.
  double middle[3];
} sv_guidance_cfg;

// One exposure, kept or only looked at.
typedef struct {
  const sv_pose *rig_from_world; // NULL: not known
  double sharpness;              // over the median of those before; 1: as sharp, or not known
  double luma;                   // mean of the pixels, 0 to 1; below 0: not known
  double clipped;                // share of the pixels at the top
} sv_guidance_shot;

typedef struct {
  sv_pose rig_from_world;
  float quality; // 0 to 1
} sv_guidance_place;

typedef struct {
  sv_guidance_cfg cfg;
  int n_views, view[SV_GUIDANCE_CAP_VIEWS]; // sub-views in use
  double half_fov_rad;                      // narrower half of the first one's field
  int n_places;                             // min(n_good, SV_GUIDANCE_CAP)
  sv_guidance_place place[SV_GUIDANCE_CAP];
  sv_view scratch[SV_GUIDANCE_CAP]; // of the places, when the ball comes from them
  bool has_scene;                   // ball and axes below are known
  sv_bounds ball;
  double axes[9]; // world to dome: x to the middle of the arc, z up
  double cell[SV_GUIDANCE_CELLS][3];
  float cell_weight[SV_GUIDANCE_CELLS]; // 0: outside of the arc
  float region_weight[SV_GUIDANCE_REGIONS];
  bool has_points;
  float covered[SV_GUIDANCE_REGIONS][SV_GUIDANCE_CELLS]; // 0 to 1
  // Of the newest exposure that was looked at
  sv_hint hint;
  int i_cell, i_target; // of the dome: where it is, and where the hint leads; -1: not known
  double gain, best_gain;
  // Counts
  int n_kept, n_good; // good: sharp, neither too dark nor too bright
} sv_guidance;

void sv_guidance_init(sv_guidance *g, const sv_guidance_cfg *cfg);
// The scene, when it is found later: its ball (NULL: as it was) and points of it, as odometry or a
// model has them. Coverage is computed again.
void sv_guidance_set_scene(sv_guidance *g, const sv_bounds *ball, const sv_point *point, int n_points);
// Judges an exposure and sets hint, i_cell, i_target, gain and best_gain.
void sv_guidance_look(sv_guidance *g, const sv_guidance_shot *shot);
// The exposure is kept: it counts, and covers what it sees when its pose is known.
void sv_guidance_keep(sv_guidance *g, const sv_guidance_shot *shot);

// 0 to 1: how good an exposure's images are.
double sv_guidance_quality(const sv_guidance_shot *shot);
// What an exposure from there, well lit and sharp, would add to the coverage; 0: nothing is known.
double sv_guidance_gain(const sv_guidance *g, const sv_pose *rig_from_world);
// Share of what is asked for that is covered; below 0: no pose is known.
double sv_guidance_coverage(const sv_guidance *g);
double sv_guidance_cell(const sv_guidance *g, int i_cell);     // of one direction, over all regions
double sv_guidance_region(const sv_guidance *g, int i_region); // of one region, from all directions
// "coverage 62 %  12 good exposures  move left": one line for a console.
void sv_guidance_line(const sv_guidance *g, sv_str *line);

#ifdef __cplusplus
}
#endif
#endif
