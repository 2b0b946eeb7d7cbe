// SPDX-License-Identifier: Apache-2.0
// Datasets: transforms JSON and images -> views of one split, as the renderer wants them. Splits:
//   train      the training file without what is held out
//   test       transforms_test.json if it is there, else the frames that the training file marks
//              so; without such marks all held-out frames, and held-out times (test_time) only if
//              there are no others
//   test_near  transforms_test_near.json, else the frames that the training file marks so, else
//              the LAB_N_NEAR views of test nearest to the mean position of the training cameras
//   all        every frame of the training file
//   others     frames of the training file so marked, else transforms_<name>.json
// Held out are frames whose "split" is not train; without any such mark, without
// transforms_test.json and unless the file is transforms_train.json: every 8th frame, from the
// first.
#ifndef SV_TOOLS_DATASET_DATASET_H
#define SV_TOOLS_DATASET_DATASET_H

#include "calib/lens_view.h"
#include "calib/remap.h"
#include "src/format/transforms.h"
#include "src/image/planes.h"
#include "src/port/port.h"
#include "src/splat/gaussians.h"
#include "tools/common/fileio.h"
#include "tools/common/imageio.h"

#define LAB_N_NEAR 6 // as many as the paper scores one exposure on
// of depth files whose unit is not said: nerfstudio's default, millimeters
#define LAB_DEPTH_UNIT 0.001
// Nothing is learned from smaller images, and a 1-pixel image is a mistake.
#define LAB_MIN_SIDE_PX 8

typedef struct {
  sv_transforms_frame f; // camera complete; its size is that of the file
  char path[SV_CAP_PATH], depth_path[SV_CAP_PATH];
  char mask_path[SV_CAP_PATH]; // empty: all pixels count
  int n_channels;              // 3, or 4 with alpha
  int i_lens;                  // frames of one lens share it
  sv_lens_view lens;           // full size
  sv_view view;                // 1/scale of it
  // some pixels do not count: by mask_path, or outside a fisheye's range
  bool is_masked;
  uint8_t *coverage; // of a lens of a measurement: that of f.footprint, or NULL
  // the measurement that the frame is a lens of, -1: it has an image of its own
  int i_measurement;
} lab_frame;

// What one sensor with overlapping lens images measured in one exposure (measurement.h).
typedef struct {
  char path[SV_CAP_PATH];
  int exposure, n_lenses;
  double max_overlap;
  int width_px, height_px; // of the sensor
  bool is_linear;
  bool has_alpha; // each of its lenses has an image of its own, with alpha
} lab_measurement;

typedef struct {
  const char *folder;
  const char *transforms; // NULL or empty: by the rule
  // the file that `transforms` is from, which may be gone by now: then by the rule. NULL or empty:
  // the user said it
  const char *told_by;
  // the training file with other poses (train --refine-poses), which is read in its place; its
  // pictures are in `folder`. NULL or empty: none
  const char *refined;
  const char *split;
  const char *camera; // only frames of this camera; NULL: all
  // trained on, for the splits train and test_near; below 1: all. Frames with exposure
  int n_exposures;
  // numbers: those of the lowest; else each frame is one, and the most dispersed are taken
  // where the file has measurements, lenses are known by them, else by their own images
  bool is_multiplexed;
  bool is_white; // of two measurements, the one over white
  // Folder of masks, which go before those that the file names (lab_mask_find); NULL: those.
  const char *masks;
  bool has_all_masks; // an image without one in that folder is refused
  int scale;
} lab_source;

typedef struct {
  lab_frame *frames;
  // [n] all frames, lens by lens: loading in this order builds each undistortion table once
  int *by_lens;
  int n, scale;
  lab_measurement *measurements; // [n_measurements]
  int n_measurements;
  int cap_width_px, cap_height_px;
  size_t cap_floats; // largest padded plane
  bool is_undistorted, has_depth;
  sv_unit unit;                            // of the poses, as the file says
  int n_masked;                            // views with a mask
  char transforms[SV_TRANSFORMS_CAP_PATH]; // name of the file that was read
  char points[SV_CAP_PATH];                // its points, empty when it names none
} lab_views;

// A transforms file in memory; lab_transforms_free.
typedef struct {
  char path[SV_CAP_PATH], folder[SV_CAP_PATH]; // folder: that its paths are relative to
  void *text;
  jsmntok_t *tok;
  sv_transforms t;
  sv_transforms_frame *frames; // [t.n_frames]
} lab_transforms_file;
sv_status lab_transforms_open(lab_transforms_file *f, const char *folder, const char *name,
                              sv_err *err) SV_MUST_USE;
void lab_transforms_free(lab_transforms_file *f);

// Selects the frames, finds the files and reads their sizes; no image is decoded. Free with
// lab_views_free.
sv_status lab_views_open(lab_views *v, const lab_source *src, const sv_pool *pool, sv_err *err) SV_MUST_USE;
void lab_views_free(lab_views *v);
// A name for view i, without extension: that of its image; with the camera's folder when two images
// share one.
void lab_view_name(const lab_views *v, int i, char *out, size_t cap);
// What a model is scored on: the paper's protocol is test_near for one exposure, which cannot see
// all of a scene, and test for more.
static inline const char *lab_default_split(int n_exposures) {
  return n_exposures == 1 ? "test_near" : "test";
}
static inline size_t lab_frame_bytes(const lab_frame *f) {
  return (size_t)f->view.width_px * (size_t)f->view.height_px * (size_t)f->n_channels;
}

// --- exposures (exposures.c) ---------------------------------------------------------------------
// Each frame with is_in is an exposure: leaves n_wanted of them, by max-min dispersion about the
// scene's center.
sv_status lab_disperse_frames(const sv_transforms_frame *frames, int n_frames, int n_wanted, bool *is_in,
                              sv_err *err) SV_MUST_USE;
void lab_mean_centre(const sv_transforms_frame *frames, int n_frames, const bool *is_in, double centre[3]);
// Leaves the n_wanted frames whose cameras are nearest to center.
void lab_keep_nearest(const sv_transforms_frame *frames, int n_frames, const double centre[3], int n_wanted,
                      bool *is_in);

// --- images (picture.c) ------------------------------------------------------------------------
typedef struct {
  int width_px, height_px, n_channels; // channels as loaded: 3 or 4
} lab_peek;
// Size and channels from the file's header.
sv_status lab_picture_peek(const char *path, lab_peek *out, sv_err *err) SV_MUST_USE;

// What one loading thread keeps between images: the table of the last lens.
typedef struct {
  sv_remap map;
  sv_camera_model lens;
} lab_loader;
void lab_loader_free(lab_loader *l);

// Decodes, undistorts and reduces one image into dst[lab_frame_bytes].
sv_status lab_picture_load(lab_loader *l, const lab_frame *f, int scale, uint8_t *dst,
                           sv_err *err) SV_MUST_USE;
// All images of a split on all threads; dst[i] as above, mask[i] as lab_mask_load, unless it is
// NULL.
sv_status lab_pictures_load(const lab_views *v, uint8_t *const *dst, uint8_t *const *mask,
                            const sv_pool *pool, sv_err *err) SV_MUST_USE;
// True depth in scene units, along the optical axis, of a fisheye the distance; 0 where there is
// none; dst[height][width] of f->view.
sv_status lab_depth_load(lab_loader *l, const lab_frame *f, int scale, float *dst, sv_err *err) SV_MUST_USE;
// Area average of K x K pixels, alpha-weighted for 4 channels. dst may be src.
void lab_reduce(const uint8_t *src, int width_px, int height_px, int n_channels, int k, uint8_t *dst);

// --- masks (mask.c) ------------------------------------------------------------------------------
// Fills in mask_path of a frame whose image was found, and checks that the mask has its size.
// Folder src->masks has the image's path in the dataset (f.file_path), or an end of it, with the
// same extension, with .png in its place, or with .png after it. E_NOT_FOUND, E_FORMAT.
sv_status lab_mask_find(lab_frame *f, const lab_source *src, const char *folder, sv_err *err) SV_MUST_USE;
// The mask of a frame with is_masked, as its view sees it: dst[height][width] of f->view, 0 where
// one of the pixels behind it is black (0 of 255) or outside a fisheye's range, else 1.
sv_status lab_mask_load(lab_loader *l, const lab_frame *f, int scale, uint8_t *dst, sv_err *err) SV_MUST_USE;

// --- undistortion (undistort.c) ------------------------------------------------------------------
bool lab_is_same_lens(const sv_camera_model *a, const sv_camera_model *b);
// The table for f's lens, kept in the loader until another lens comes.
sv_status lab_undistort_map(lab_loader *l, const lab_frame *f, sv_err *err) SV_MUST_USE;

// --- scene (scene.c) -----------------------------------------------------------------------------
typedef struct {
  float centre[3], radius; // the sphere that random starts fill
  float distance;          // median distance of the cameras to the center
  float up[3];             // mean of the images' up
} lab_scene;
lab_scene lab_scene_of(const lab_views *v);
// Different times of the views; places that the cameras were at, for rigs that stand still while
// the scene moves.
int lab_n_times(const lab_views *v);
int lab_n_places(const lab_views *v);

// Points of a PLY, malloc'ed; radius: 1.5 x the median distance to their centroid.
sv_status lab_points_read(const char *path, sv_point **points, int *n, float centre[3], float *radius,
                          sv_err *err) SV_MUST_USE;

#endif
