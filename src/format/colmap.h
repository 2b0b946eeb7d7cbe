// SPDX-License-Identifier: Apache-2.0
// COLMAP models over buffers: cameras, images, points3D, rigs and frames, each as .txt or .bin.
// Poses are cam_from_world with OpenCV's axes and pixel centres at 0.5, as everywhere in this
// project. One reader walks one file from front to back: _next gives SV_OK with an entry, SV_END
// after the last, or a failure.
#ifndef SV_FORMAT_COLMAP_H
#define SV_FORMAT_COLMAP_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "calib/model.h"
#include "src/base/vec.h"
#include "src/format/text.h"

#ifdef __cplusplus
extern "C" {
#endif

typedef struct {
  uint32_t id;
  sv_camera_model model; // SIMPLE_PINHOLE and PINHOLE, SIMPLE_RADIAL, RADIAL, OPENCV, FULL_OPENCV,
                         // fisheyes
} sv_colmap_camera;

typedef struct {
  uint32_t id, camera_id;
  char name[200]; // file name of the image
  sv_pose cam_from_world;
} sv_colmap_image;

typedef struct {
  uint64_t id;
  double xyz[3]; // world
  uint8_t rgb[3];
  double error_px; // mean reprojection error
  uint32_t n_track;
} sv_colmap_point;

// COLMAP 3.12 and later: one instant of a rig, and its images.
#define SV_COLMAP_CAP_DATA 256
typedef struct {
  uint32_t id, rig_id;
  sv_pose rig_from_world;
  int n_images;
  struct {
    uint32_t camera_id;
    uint64_t image_id;
  } images[SV_COLMAP_CAP_DATA]; // of cameras; data of other sensors is skipped
} sv_colmap_frame;

// COLMAP 3.12 and later: cameras fixed to one another. The rig's frame is that of its reference
// sensor.
typedef struct {
  uint32_t id;
  int n_cameras;
  struct {
    uint32_t camera_id;
    bool has_pose;               // false: COLMAP does not know it
    sv_pose cam_from_rig;        // the reference camera's is the identity
  } cameras[SV_COLMAP_CAP_DATA]; // other sensors are skipped
} sv_colmap_rig;

typedef struct {
  sv_text text;
  bool is_binary;
  uint64_t n, i; // binary: entries announced and read
} sv_colmap;

// buf and name must outlive c. is_binary: the file's extension is .bin.
sv_status sv_colmap_open(sv_colmap *c, const char *name, const void *buf, size_t bytes, bool is_binary,
                         sv_err *err) SV_MUST_USE;
sv_status sv_colmap_next_camera(sv_colmap *c, sv_colmap_camera *out, sv_err *err) SV_MUST_USE;
sv_status sv_colmap_next_image(sv_colmap *c, sv_colmap_image *out, sv_err *err) SV_MUST_USE;
sv_status sv_colmap_next_point(sv_colmap *c, sv_colmap_point *out, sv_err *err) SV_MUST_USE;
sv_status sv_colmap_next_rig(sv_colmap *c, sv_colmap_rig *out, sv_err *err) SV_MUST_USE;
sv_status sv_colmap_next_frame(sv_colmap *c, sv_colmap_frame *out, sv_err *err) SV_MUST_USE;

#ifdef __cplusplus
}
#endif
#endif
