// SPDX-License-Identifier: Apache-2.0
// Recordings of other programs -> capture folders (platform/replay/capture.h) with a rig:
// rig/rig.json and one mrcal .cameramodel a camera (pixel centers at integers, extrinsics
// cam_from_world). Images are hard links where the file system allows, else copies; they are never
// encoded again. Host tools: heap and stdio.
#ifndef SV_TOOLS_IMPORT_RECORDING_H
#define SV_TOOLS_IMPORT_RECORDING_H

#include <stdbool.h>

#include "src/base/status.h"
#include "src/base/time.h"
#include "src/base/vec.h"
#include "src/port/port.h"

#ifdef __cplusplus
extern "C" {
#endif

typedef struct {
  const char *src_dir, *out_dir;
  sv_console console; // Ctrl-C: SV_E_INTERRUPTED without a sentence; capture.json is written last
} sv_import_job;

// Four webcams around a moving board: src/camN/*.jpg, camera_array.toml (K, OpenCV's five
// distortion terms, R and T world to camera, for the size it names) and timestamps.csv
// (sync_index,cam_id,frame_time in seconds; the n-th image of a camera is its n-th row in order of
// time).
int sv_import_4cam_board(const sv_import_job *job, sv_err *err) SV_MUST_USE;

// Qualisys: Calib.qca.txt and src/<serial of the camera>/*.jpg at 30 frames a second. In the file
// lengths are millimeters, pixels are 1/64 of the full sensor's; x, y, z is the camera's center,
// and the rows of r are the camera's axes in the world: right, up, backward.
int sv_import_qca(const sv_import_job *job, sv_err *err) SV_MUST_USE;

// --- shared by the importers ---------------------------------------------------------------------
#define SV_IMPORT_CAP_CAMERAS 16

typedef struct {
  char name[48];
  int calib_width_px, calib_height_px; // the size the intrinsics are for
  double fx, fy, cx, cy, dist[8];      // OpenCV: k1 k2 p1 p2 k3 k4 k5 k6; pixel centers at integers
  sv_pose cam_from_world;              // meters
  int n_times;
  sv_ns *times_ns; // [n_times] in order; made with malloc, freed by sv_import_write
  bool is_made;    // its images were written to OUT/<name>/ already
  char depth[64];  // OUT/<depth>/000000.pfm and on: its depth in meters; empty: it has none
} sv_import_camera;

// Writes the capture: images are SRC/<name>/*.jpg in order of their names, as many as there are
// times (a difference is an error). Intrinsics are scaled to the images' size. Checks that each
// rotation is one and that the aspect ratio agrees. Without intrinsics (fx is 0 of the first
// camera) the capture has no rig.
int sv_import_write(const sv_import_job *job, const char *name, double fps, sv_import_camera *cams,
                    int n_cameras, sv_err *err) SV_MUST_USE;
// Makes OUT and refuses one that is the input or holds an unfinished capture.
int sv_import_begin(const sv_import_job *job, sv_err *err) SV_MUST_USE;
// A camera's name of a file's name: letters, digits, '-' and '_', without the extension.
void sv_import_name(char out[48], const char *file);

// A whole text file, terminated, made with malloc; NULL with a sentence when it cannot be read.
char *sv_import_text(const char *dir, const char *file, sv_err *err);

#ifdef __cplusplus
}
#endif
#endif
