// SPDX-License-Identifier: Apache-2.0
// Poses made better by what the pictures show: points matched between views (SIFT, by a
// module that has OpenCV), the scale that a rig's baseline gives, and
// bundle adjustment with rig constraints. Owns its matches; never touches pictures.
#ifndef SV_TOOLS_IMPORT_REFINE_H
#define SV_TOOLS_IMPORT_REFINE_H

#include "calib/solve/structure.h"
#include "tools/import/import.h"

#ifdef __cplusplus
extern "C" {
#endif

// --- matches (matches.c) -------------------------------------------------------------------------

// Whether the module subview-matches.so, which has OpenCV, is beside this program or in
// ../lib/subview, and loads.
bool lab_has_matcher(void);

// Points seen in at least three views, in pixels of the views.
typedef struct {
  sv_array_observation *obs; // by point; view: index in im->views
  int n_obs, n_points;
  int *first; // [n_points + 1]
} lab_matches;

// E_UNSUPPORTED without a matcher, E_INTERRUPTED without a sentence after Ctrl-C.
sv_status lab_matches_find(lab_matches *m, const lab_import *im, lab_session *se, sv_err *err) SV_MUST_USE;
void lab_matches_free(lab_matches *m);
// The point that has the least sum of squared distances to the rays of n observations, each in
// units of its distance from the camera. False when rays are parallel to a tenth of a degree, or
// when it is behind a camera.
typedef struct {
  sv_pose cam_from_world;
  double ray[2]; // on z = 1
} lab_ray;
bool lab_triangulate(const lab_ray *rays, int n, double x[3]);

// --- scale (scale.c) -----------------------------------------------------------------------------

typedef struct {
  double unit_m; // meters for one unit of the poses
  double sigma;  // its relative standard deviation
  int n_points;  // that tell it
} lab_scale;

// The views of `im` are those of one rig, placed by poses of camera `i_stream` with unit 1
// (lab_import_propagate): points triangulated from the stream alone must lie where the rig's other
// cameras see them. E_NOT_FOUND: fewer than 20 points tell it.
sv_status lab_scale_find(lab_scale *out, const lab_import *im, const lab_matches *m, int i_stream,
                         sv_err *err) SV_MUST_USE;

// Poses, points and depth units of such views with that unit in the place of 1.
void lab_scale_apply(lab_import *im, int i_stream, double unit_m);

// --- bundle adjustment (refine.c) ----------------------------------------------------------------

typedef struct {
  bool is_rig;             // sub-views of one exposure keep their relative poses
  bool is_rig_known;       // these are a calibration's; else their means, and refined
  const char *free_lenses; // names of the cameras whose lens is refined, with commas; "all"; NULL
} lab_refine_options;

typedef struct {
  int n_placed, n_poses, n_points, n_obs; // n_placed: views with enough matches
  // Parts without common points: nothing tells how one lies to the other.
  int n_parts;
  double rms_before_px, rms_px; // of the same observations
  double moved_deg, moved;      // means; moved: in units of the poses
  // The given poses explain the matches as well, so nothing was changed.
  bool is_kept;
} lab_refined;

// Changes poses (and lenses) of `im`, unless the given ones explain the matches as well (residuals
// within a half): noise of the matches would take their place. The world stays: the poses as a
// whole are where they were, and as large, unless the rig's calibration tells their size. Views
// that share fewer than 8 points with any other keep their poses.
sv_status lab_import_refine(lab_import *im, const lab_matches *m, const lab_refine_options *o,
                            lab_refined *out, sv_err *err) SV_MUST_USE;

#ifdef __cplusplus
}
#endif
#endif
