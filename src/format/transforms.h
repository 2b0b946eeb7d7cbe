// SPDX-License-Identifier: Apache-2.0
// Blender, nerfstudio and instant-ngp "transforms" JSON. Their cameras are OpenGL's (+y up, looking
// along -z) and camera-to-world; what comes out is OpenCV's, cam_from_world. Their pixel centres
// are ours (cx = w/2 is the middle of the image).
#ifndef SV_FORMAT_TRANSFORMS_H
#define SV_FORMAT_TRANSFORMS_H

#include <stdbool.h>

#include "calib/model.h"
#include "src/base/vec.h"
#include "src/format/json.h"
#include "src/rig/rig.h"

#ifdef __cplusplus
extern "C" {
#endif

#define SV_TRANSFORMS_CAP_PATH 200

typedef enum {
  SV_DEPTH_NONE = 0,
  SV_DEPTH_Z,  // along the optical axis
  SV_DEPTH_RAY // along the pixel's ray
} sv_depth_kind;

// Estimated depth, of some scale and offset: file key depth_prior, or disparity_prior for inverse
// depth.
typedef enum { SV_TRANSFORMS_NO_PRIOR = 0, SV_TRANSFORMS_DEPTH, SV_TRANSFORMS_DISPARITY } sv_transforms_prior;

typedef struct {
  // as in the file, without a leading "./"; may lack its extension
  char file_path[SV_TRANSFORMS_CAP_PATH];
  char depth_path[SV_TRANSFORMS_CAP_PATH]; // empty when depth_kind is NONE
  bool has_extension;                      // false: the reader tries .png, .jpg, ...
  sv_depth_kind depth_kind;
  // depth that somebody estimated; empty when prior_kind is NONE
  char prior_path[SV_TRANSFORMS_CAP_PATH];
  sv_transforms_prior prior_kind;
  double depth_unit;      // scene units for one step of the depth image, 0 when not said
  char camera[32];        // empty when not said
  char split[16];         // "train", "test", ...; empty when not said
  int exposure;           // -1 when not said (files say -1, too, for views outside any exposure)
  int sub_view;           // -1 when not said
  double time;            // 0..1, -1 when not said
  sv_footprint footprint; // on the sensor, all zero when not said
  sv_pose cam_from_world;
  // Width, height and parameters are complete after sv_transforms_finish. Before, 0 stands for what
  // the file does not say.
  sv_camera_model model;
  double camera_angle_x_rad, camera_angle_y_rad; // 0 when not said or fl_x is given
  bool has_cx, has_cy;
} sv_transforms_frame;

typedef struct {
  sv_json json;
  int n_frames;
  char ply_file_path[SV_TRANSFORMS_CAP_PATH]; // the initial points, empty when not said
} sv_transforms;

// Checks the file and its top level. sv_json_count tells how many tokens it takes; name, text and
// tok must outlive t. E_NOT_FOUND without frames, E_UNSUPPORTED for models other than PINHOLE,
// OPENCV and OPENCV_FISHEYE.
sv_status sv_transforms_open(sv_transforms *t, const char *name, const char *text, size_t bytes,
                             jsmntok_t *tok, int cap_tok, sv_err *err) SV_MUST_USE;
// All frames in the file's order into frames[t->n_frames] (cap is checked). Refused: matrices that
// are no rotation (more than 1e-3 off; smaller errors are corrected), times outside 0..1, an r^8
// term k4.
sv_status sv_transforms_read(const sv_transforms *t, sv_transforms_frame *frames, int cap,
                             sv_err *err) SV_MUST_USE;
// Completes a frame's camera once its image's size is known: focal length from camera_angle_x,
// centre in the middle unless said. Fails when the file says another size.
sv_status sv_transforms_finish(sv_transforms_frame *f, int width_px, int height_px, sv_err *err) SV_MUST_USE;

// The multiplexed measurement of an exposure ("composites", or "composites_linear": summed in
// linear light): its image and the largest number of overlapping sub-views. SV_END when there is
// none.
typedef struct {
  char file_path[SV_TRANSFORMS_CAP_PATH];
  int max_overlap;
} sv_transforms_measurement;
sv_status sv_transforms_find_measurement(const sv_transforms *t, bool is_linear, int exposure,
                                         sv_transforms_measurement *out, sv_err *err) SV_MUST_USE;

#ifdef __cplusplus
}
#endif
#endif
