// SPDX-License-Identifier: Apache-2.0
// Odometry of a rig: where it was for each exposure of a casual, handheld capture, one after the
// other, and the points it saw. The world is the rig's frame at the first exposure that could be
// placed, until it is turned upright; metres come from the rig's own baseline.
//
// Corners (Shi and Tomasi) are tracked from exposure to exposure as patches, coarse to fine, and
// matched between the sub-views of one exposure along their epipolar lines. What a point is, in all
// views and at all times, is said by the one patch with which it was found, seen through an affine
// map: surfaces turn by several degrees from one exposure to the next, and comparing without it
// would slide along them. Points that are known place the rig (sv_pose_find); the last exposures
// are adjusted together each time (sv_bundle), all of them at the end, with points that the rig
// saw again after it had lost them. Everything is carved at
// start and nothing depends on time or threads: the same bits on every machine.
#ifndef SV_TRACK_TRACKER_H
#define SV_TRACK_TRACKER_H

#include "kernels/kernels.h"
#include "src/image/planes.h"
#include "src/rig/rig.h"
#include "src/track/pose.h"

#ifdef __cplusplus
extern "C" {
#endif

#define SV_TRACK_CAP_VIEWS  4  // sub-views in use; of a rig with more, those farthest apart
#define SV_TRACK_LEVELS     4  // of the pyramid: full size to an eighth
#define SV_TRACK_CAP_BUNDLE 96 // exposures that are adjusted together

typedef struct {
  const sv_rig *rig;
  const sv_camera_model *model; // [n_sub_views] of the pictures: pinholes; NULL: the rig's own
                                // models
  const sv_row_time *row_time;  // [n_sub_views] of rolling shutters; NULL: there are none
  int cap_exposures;
  int n_features; // followed at a time in each sub-view
  uint64_t seed;
  bool has_extrinsics;                // correct the calibration softly at the end
  sv_pose_solver solver;              // .absolute may be NULL
  struct sv_heartbeats *heartbeats;   // of the main thread, which runs this; may be NULL
} sv_track_cfg;                       // rig and models must outlive the tracker
sv_track_cfg sv_track_defaults(void); // without cameras: 250 features, calibration taken as it is

typedef struct {
  int32_t i_point, next; // next of the point's observations, -1: none
  int16_t i_exposure, i_view;
  float uv_px[2], sigma_px; // sigma 0: found wrong
} sv_track_obs;

typedef struct {
  double x[3]; // world, with has_depth
  bool has_depth, is_live;
  uint8_t n_tries; // exposures without depth
  uint8_t rgb[3];
  int32_t first_obs, last_obs;
  int32_t now[SV_TRACK_CAP_VIEWS]; // its observations in the exposure last placed, -1: none
  int32_t i_ref;                   // its reference patch while it is live, else -1
  // pixels of a view for one of the patch, row-major, when last seen
  float warp[SV_TRACK_CAP_VIEWS][4];
  float uv0_px[SV_TRACK_CAP_VIEWS][2]; // where the view saw it in exposure 0
  bool has_uv0[SV_TRACK_CAP_VIEWS];
} sv_track_point;

typedef struct { // what a point looked like when it was found
  sv_patch patch;
  double l[36], tp[6],
      tt;         // Cholesky factor of the alignment's system; the patch against its slopes and
                  // itself
  bool is_usable; // false: without structure
} sv_track_ref;

typedef struct sv_track_candidate {
  int32_t i_point;
  int i_view;
  float uv_px[2], sigma_px, warp[4];
} sv_track_candidate;

typedef struct { // grey pyramid of one picture
  float *level[SV_TRACK_LEVELS];
} sv_track_pyramid;

typedef struct {
  int n_exposures, n_placed, n_points; // points with depth
  int n_seen_again;                    // observations of points after they had been lost
  bool is_still;      // nothing moved in the pictures: all poses are the same, and placed is what
                      // tells a way
  double still_px;    // the largest way from exposure 0 that three of ten places keep within, -1:
                      // none tells it
  double rms_px;      // reprojection, one axis
  double scale_sigma; // relative deviation (1 sigma) of the scale, by the part that tells it best;
                      // -1: none
  double path_m;      // sum of the ways between exposures placed
} sv_track_summary;

typedef struct {
  sv_track_cfg cfg;
  const sv_kernels *k;
  int n_views, sub_view[SV_TRACK_CAP_VIEWS]; // in use
  sv_bundle_camera cam[SV_TRACK_CAP_VIEWS];
  int width_px[SV_TRACK_CAP_VIEWS], height_px[SV_TRACK_CAP_VIEWS];
  int n_levels[SV_TRACK_CAP_VIEWS];
  sv_track_pyramid
      // [i_now]: of this exposure; the other: of the one placed last
      pyramid[2][SV_TRACK_CAP_VIEWS];
  int i_now;
  sv_image_u8 image[SV_TRACK_CAP_VIEWS]; // this exposure's
  float *scratch;
  sv_corner *corner; // [cells of the largest picture]
  int32_t *order;    // [the same]
  sv_patch *patch;   // [2] one to compare with, one to compare
  // [cap_refs + 1] what live points looked like when they were found; the last is of no point
  sv_track_ref *ref;
  int32_t *free_ref; // [cap_refs] stack of free ones
  int n_free_refs, cap_refs;
  float *place_x, *place_y, (*sums)[5]; // [SV_TRACK_CAP_PLACES] along an epipolar line
  sv_track_point *point;                // [cap_points]
  int n_points, cap_points;
  int32_t *free_point; // [cap_points] stack of points that died without a depth: their places are
                       // used again
  int n_free_points;
  sv_track_obs *obs; // [cap_obs]
  int n_obs, cap_obs;
  int32_t *live; // [cap_points] points seen in the exposure last placed
  int n_live;
  struct sv_track_candidate *found; // [cap_found] where live points were found in this exposure
  int n_found, cap_found;
  sv_pose_match *match;              // [cap_found] those of points with depth
  int32_t *match_of;                 // [cap_found] their candidates
  float *work;                       // [cap_found] for medians
  sv_pose *pose;                     // [cap_exposures] rig_from_world
  double *time_s;                    // [cap_exposures] of sv_tracker_set_time
  double (*motion)[6];               // [cap_exposures] of the rig. Both only with rolling shutters
  bool *is_placed;                   // [cap_exposures]
  bool *has_way;                     // [cap_exposures] it shares enough with exposure 0 to tell the
                                     // way
  int n_exposures, i_last, i_before; // the exposures placed last, -1: none
  sv_bundle bundle;
  int32_t *bundle_point, *bundle_obs; // [cap] where the bundle's came from
  sv_pose *key_before;                // [SV_TRACK_CAP_BUNDLE] of the keys, before their adjustment
  double still_px;                    // so far, -1: no exposure tells a way
  uint64_t n_full;                    // points or observations that found no room
} sv_tracker;

// E_ARG for a model that is no pinhole or no room for exposures.
sv_status sv_tracker_init(sv_tracker *t, const sv_track_cfg *cfg, const sv_kernels *k, sv_arena *arena,
                          sv_err *err) SV_MUST_USE;
size_t sv_tracker_bytes(const sv_track_cfg *cfg);
int sv_tracker_cap_points(const sv_track_cfg *cfg);
// k-th smallest of v, which is reordered; 0 without values
float sv_track_rank(float *v, int n, int k);

// Time of the next exposure, seconds from any start: with rolling shutters, motion comes from it.
void sv_tracker_set_time(sv_tracker *t, double time_s);

// The next exposure: image[rig->n_sub_views], RGB of the models' sizes, looked at during the call
// only. OK: placed; AGAIN: not found again from the exposure placed last (it stays unplaced, the
// next is tried from there); E_FULL beyond cap_exposures, E_RANGE for a picture of another size.
sv_status sv_tracker_add(sv_tracker *t, const sv_image_u8 *image) SV_MUST_USE;

// The pictures of exposures once more: get returns those of an exposure, [rig->n_sub_views], as
// sv_tracker_add got them, which stay until the next call.
typedef struct {
  void *self;
  const sv_image_u8 *(*get)(void *self, int i_exposure);
} sv_track_pictures;

// Finds places that were seen again (not when `again` is NULL), adjusts everything together and
// sums up.
void sv_tracker_finish(sv_tracker *t, const sv_track_pictures *again, sv_track_summary *out);

// Up in the world of a finished trajectory: the normal of the main plane of the points where
// that is nearly square to the rows of the cameras, else square to these, else the cameras' mean up
// (upright.c). False without exposures that were placed.
bool sv_track_up(const sv_tracker *t, double up[3]);
// Turns the world, poses and points, so that this direction is -y, as in COLMAP's.
void sv_track_turn_upright(sv_tracker *t, const double up[3]);

// --- between the files of this folder ------------------------------------------------------------
#define SV_TRACK_CAP_PLACES 512
#define SV_TRACK_MARGIN_PX  8

typedef struct {
  const float *px;
  int width_px, height_px, stride;
} sv_track_plane;
sv_track_plane sv_track_level(const sv_tracker *t, bool is_now, int i_view, int level);
// pyramids of this exposure (features.c)
void sv_track_build(sv_tracker *t, const sv_image_u8 *image);
// Corners of this exposure in a view, best first, that are not near what is followed there. Returns
// how many; t->order has their cells.
int sv_track_detect(sv_tracker *t, int i_view);
// Moves (x, y), in pixels of the level, to where t->patch fits best. Returns the correlation there,
// -1: lost.
float sv_track_align(sv_tracker *t, const sv_track_plane *p, float *x, float *y);
// Aligns reference patch i_ref with a view of this exposure, place and affine map together, from
// where uv and warp are. Returns the correlation there, -1: lost.
float sv_track_align_affine(sv_tracker *t, int i_ref, int i_view, float uv_px[2], float warp[4]);
void sv_track_prepare_ref(sv_track_ref *ref); // after its patch was taken
float sv_track_spacing(const float warp[4]);  // mean pixels of the view for one of the patch
// Follows all live points from the exposure placed last into t->found, starting where `guess` sees
// them (points.c).
void sv_track_follow(sv_tracker *t, const sv_pose *guess);
// Takes the patch at a position of a view as a reference, one pixel in 2^level. False at a border.
bool sv_track_take_ref(sv_tracker *t, bool is_now, int i_ref, int i_view, const float uv_px[2], int level);
// Aligns coarse to fine from a position in a view's last picture to one in its picture of now, then
// against the reference patch, from warp. False: lost, or in a mask.
bool sv_track_follow_patch(sv_tracker *t, int i_ref, int i_view, const float from_px[2], float uv_px[2],
                           float warp[4]);
// Locates the rig at an exposure from t->found, whose outliers get sigma 0. Returns the number of
// inliers, 0 when there are too few.
int sv_track_place(sv_tracker *t, int i_exposure, sv_pose *pose);
// Points that were lost and seen again get observations. Returns how many (loops.c).
int sv_track_close_loops(sv_tracker *t, const sv_track_pictures *pictures);
// A corner of view a whose depth along its ray is between two bounds, and its match in view b.
typedef struct {
  int i_view;
  float uv_px[2];
  double near_m, far_m;
} sv_track_corner;
typedef struct {
  float uv_px[2];    // position in b
  float step_px;     // resolution at which it was found, in pixels of b
  float b_from_a[4]; // local map of a's pixels to b's, row-major
} sv_track_match;
// Searches view b for a corner along its epipolar line. False when there is no distinct match
// (stereo.c).
bool sv_track_stereo(sv_tracker *t, const sv_track_corner *c, int b, sv_track_match *out);
// Where a camera of a rig at that pose sees a point of the world. False behind it.
bool sv_track_see(const sv_bundle_camera *c, const sv_pose *rig, const double x[3], double uv[2]);
// When a view of an exposure reads a pixel, in seconds after the exposure's time; and the rig's
// pose then. 0 and the exposure's pose with global shutters (shutter.c).
double sv_track_row_s(const sv_tracker *t, int i_view, const float uv_px[2]);
sv_pose sv_track_pose_at(const sv_tracker *t, int i_exposure, int i_view, const float uv_px[2]);
// The two located exposures among [first, first + n) from which the motion at first + i comes,
// counted from first (-1: none near enough), and how.
void sv_track_beside(const sv_tracker *t, int first, int n, int i, int beside[2], double slope[2]);
// Motion at exposures [first, first + n) from all poses.
void sv_track_find_motion(sv_tracker *t, int first, int n);
// in the camera, z = 1
void sv_track_ray(const sv_bundle_camera *c, const float uv_px[2], double ray[3]);
// New points from corners, matched between the sub-views; and known points in views that do not see
// them yet.
void sv_track_new_points(sv_tracker *t);
void sv_track_rematch(sv_tracker *t);
// Depth from all observations of a point. False when they do not tell it.
bool sv_track_triangulate(sv_tracker *t, sv_track_point *p);
int32_t sv_track_add_obs(sv_tracker *t, int32_t i_point, int i_exposure, int i_view, const float uv_px[2],
                         float sigma_px); // -1: full
// Exposures first, first + step, ..., n of them. The first n_fixed of them, those whose number
// divides by key_step (0: none), and unplaced ones are held.
typedef struct {
  int first, n, step, n_fixed, key_step;
} sv_track_part;
// Adjusts a part of the exposures together (window.c).
sv_bundle_result sv_track_adjust(sv_tracker *t, const sv_track_part *part, int max_iterations,
                                 bool is_extrinsics);
// How well a part tells the scale by itself: sv_bundle_scale_sigma.
double sv_track_scale_sigma(sv_tracker *t, const sv_track_part *part);

#ifdef __cplusplus
}
#endif
#endif
