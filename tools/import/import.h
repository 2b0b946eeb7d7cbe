// SPDX-License-Identifier: Apache-2.0
// What the importers share: views as they were found, and the dataset that is written from them. On
// Ctrl-C those that write images return SV_E_INTERRUPTED without a sentence. What makes a folder a
// dataset is written last.
#ifndef SV_TOOLS_IMPORT_IMPORT_H
#define SV_TOOLS_IMPORT_IMPORT_H

#include <stdio.h>

#include "src/format/colmap.h"
#include "tools/lab/lab.h"

typedef struct {
  char source[SV_CAP_PATH], depth_source[SV_CAP_PATH]; // depth: empty when there is none
  char mask_source[SV_CAP_PATH];                       // empty when there is none
  // measured depth, a PFM in units of the poses; empty when there is none
  char prior_source[SV_CAP_PATH];
  char name[SV_TRANSFORMS_CAP_PATH];      // in images/, with extension
  char mask_name[SV_TRANSFORMS_CAP_PATH]; // in masks/, the same; views may share it
  sv_camera_model model;
  sv_pose cam_from_world;
  sv_footprint crop; // all zero: the whole image
  sv_depth_kind depth_kind;
  double depth_unit, time;    // time -1: not said
  int exposure, sub_view;     // -1: not said
  uint64_t source_id;         // the image's number in the source
  char camera[32], split[16]; // empty: not said
} lab_import_view;

typedef struct {
  lab_import_view *views;
  int n, cap;
  sv_point *points;
  int n_points, cap_points;
  // views that were placed by their rig only; images of the rig that were not found
  int n_from_rig, n_lost;
  sv_unit unit;      // of the poses: meters for a rig with a baseline
  bool is_rig_known; // relative poses within an exposure are a calibration's
} lab_import;

// Room for one more, cleared ("not said" everywhere); NULL without memory.
lab_import_view *lab_import_add(lab_import *im);
sv_point *lab_import_add_point(lab_import *im);
void lab_import_free(lab_import *im);

// Copies the images and writes transforms.json and points3d.ply into `out`. Names that are not
// UTF-8 become it.
sv_status lab_import_write(lab_import *im, lab_session *s, const char *out, sv_err *err) SV_MUST_USE;
// The same for one of several transforms files of a folder, which share images/. The caller holds
// the folder's lock. Points go beside it: transforms_train_mono.json has points3d_mono.ply.
sv_status lab_import_write_as(lab_import *im, lab_session *s, const char *folder, const char *transforms,
                              sv_err *err) SV_MUST_USE;

// A pose as transforms JSON has it: camera to world, OpenGL's axes (y and z turned).
void lab_put_matrix(FILE *f, const sv_pose *cam_from_world);

// Points as a PLY with colors.
sv_status lab_import_write_points(const lab_import *im, const char *path, sv_err *err) SV_MUST_USE;

// A rig folder: rig.json and lens files. Coverage images are not written.
sv_status lab_rig_write(const sv_rig *rig, const char *folder, sv_err *err) SV_MUST_USE;
// Kalibr's camchain.yaml -> a rig folder.
sv_status lab_import_kalibr(const char *file, const char *out, int *n_cameras, sv_err *err) SV_MUST_USE;

// Views of one camera of a rig (`stream`, a sub-view's name that stands in the paths of its images)
// -> views of all sub-views, by the rig's relative poses. The stream keeps its poses and lenses;
// views of other cameras are dropped; what has no number of its exposure gets one, in order.
// unit_m: meters for one unit of the poses given. n_from_rig and n_lost count. `im` is left alone
// on failure.
sv_status lab_import_propagate(lab_import *im, const char *rig_folder, const char *stream, double unit_m,
                               sv_err *err) SV_MUST_USE;

sv_status lab_import_transforms(lab_import *im, const char *dir, sv_err *err) SV_MUST_USE;
// All frames of one transforms file, marked as of `mark` unless the file says another split. Its
// points, too, unless im has some.
sv_status lab_import_transforms_file(lab_import *im, const char *dir, const char *name, const char *mark,
                                     sv_err *err) SV_MUST_USE;
// Whether DIR holds a COLMAP model, and the path of its list of images.
bool lab_import_colmap_model(const char *dir, char images_path[SV_CAP_PATH]);
sv_status lab_import_colmap(lab_import *im, const char *dir, sv_err *err) SV_MUST_USE;
// A whole dataset from the simulator: SCENE or a source string's part behind `sim:` ->
// transforms_train_RIG.json for each of the five devices (three exposures),
// transforms_test_near.json, transforms_test.json, with depth. Of the scene `moving`: mono, stereo
// and phone stand still and share one camera, 25 times of which every fourth is marked test_time,
// and four held-out cameras over all times.
// Of another scene with rig= in it: that rig's exposures (exposures=N of them) as
// transforms_train.json, and the run's held-out views as transforms_test.json.
sv_status lab_import_sim(const char *spec, const lab_session *s, const char *out, sv_err *err) SV_MUST_USE;
// Raw images and white.png of a lenslet sensor: sub-views are written to out/images, their rig to
// out/rig.
sv_status lab_import_lenslet(lab_import *im, const lab_options *o, lab_session *se, sv_err *err) SV_MUST_USE;
// The folder of the paper's authors (their release and what their `prepare` made of it): static,
// casual, dynamic, multiplexed and synthetic scenes, each a dataset of its own in OUT, with a
// training file a device (tools/import/release.h).
sv_status lab_import_release(const lab_options *o, lab_session *se, sv_err *err) SV_MUST_USE;
// Is it a video, by its name?
bool lab_import_is_clip(const char *name);
// A folder of clips, one a camera -> a capture folder on one clock.
sv_status lab_import_multicam(const lab_options *o, lab_session *se, sv_err *err) SV_MUST_USE;
// A recording of ROS 2 (.mcap, .db3) -> a capture folder, a camera a topic of pictures.
sv_status lab_import_rosbag(const lab_options *o, lab_session *se, sv_err *err) SV_MUST_USE;
// A spatial video (tools/import/spatial.h) -> a capture folder with its rig.
sv_status lab_import_spatial(const lab_options *o, lab_session *se, sv_err *err) SV_MUST_USE;
// A capture folder, or a folder of pictures for each camera (named as the rig's sub-view). rig: a
// rig folder; NULL: that of the capture. Where the capture tells no poses, odometry finds them.
sv_status lab_import_capture(lab_import *im, const char *dir, const char *rig, lab_session *se,
                             sv_err *err) SV_MUST_USE;

#endif
