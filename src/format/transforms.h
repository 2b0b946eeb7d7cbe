// SPDX-License-Identifier: Apache-2.0
// The transforms JSON of Blender, nerfstudio and instant-ngp.
// Their cameras are OpenGL's (+y up, looking along -z) and camera-to-world; results are OpenCV's,
// cam_from_world. Pixel centres agree with ours (cx = w/2 is the middle of the image).
#ifndef SV_FORMAT_TRANSFORMS_H
#define SV_FORMAT_TRANSFORMS_H

#include <stdbool.h>

#include "calib/model.h"
#include "src/base/unit.h"
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

// Estimated depth of unknown scale and offset: file key depth_prior, or disparity_prior for inverse
// depth.
typedef enum { SV_TRANSFORMS_NO_PRIOR = 0, SV_TRANSFORMS_DEPTH, SV_TRANSFORMS_DISPARITY } sv_transforms_prior;

typedef struct {
  // as in the file, without a leading "./"; may lack its extension
  char file_path[SV_TRANSFORMS_CAP_PATH];
  char mask_path[SV_TRANSFORMS_CAP_PATH];  // black where the image is ignored; empty when absent
  char depth_path[SV_TRANSFORMS_CAP_PATH]; // empty when depth_kind is NONE
  bool has_extension;                      // false: the reader tries .png, .jpg, ...
  sv_depth_kind depth_kind;
  // estimated depth; empty when prior_kind is NONE
  char prior_path[SV_TRANSFORMS_CAP_PATH];
  sv_transforms_prior prior_kind;
  double depth_unit; // scene units for one step of the depth image, 0 when absent
  char camera[32];   // empty when absent
  char split[16];    // "train", "test", ...; empty when absent
  int exposure;      // -1 when absent (or, explicitly, for views outside of any exposure)
  int sub_view;      // -1 when absent
  double time;       // 0..1, -1 when absent
  // on the sensor, all zero when absent; its coverage is the caller's to load
  sv_footprint footprint;
  // image of the share of light that the lens leaves on each pixel of its footprint; empty: all
  char coverage_path[SV_TRANSFORMS_CAP_PATH];
  sv_pose cam_from_world;
  // Width, height and parameters are complete after sv_transforms_finish. Before, 0 means absent.
  sv_camera_model model;
  double camera_angle_x_rad, camera_angle_y_rad; // 0 when absent or when fl_x is given
  bool has_cx, has_cy;
} sv_transforms_frame;

typedef struct {
  sv_json json;
  int n_frames;
  char ply_file_path[SV_TRANSFORMS_CAP_PATH]; // the initial points; empty when absent
  // of the poses: our "world_unit": "m" and "world_scale_sigma"
  sv_unit unit;
} sv_transforms;

// Checks the file and its top level. sv_json_count tells how many tokens it takes; the file and
// tok must outlive t. E_NOT_FOUND without frames, E_UNSUPPORTED for models other than PINHOLE,
// OPENCV and OPENCV_FISHEYE.
sv_status sv_transforms_open(sv_transforms *t, const sv_file_data *file, jsmntok_t *tok, int cap_tok,
                             sv_err *err) SV_MUST_USE;
// All frames in the file's order into frames[t->n_frames] (cap is checked). Refused: matrices that
// are not rotations (more than 1e-3 off; smaller errors are corrected), times outside 0..1, an r^8
// term k4.
sv_status sv_transforms_read(const sv_transforms *t, sv_transforms_frame *frames, int cap,
                             sv_err *err) SV_MUST_USE;
// Completes a frame's camera once the image size is known: focal length from camera_angle_x, centre
// in the middle unless given. Where the file states another size of the same shape, the camera is
// scaled; fails at another shape.
sv_status sv_transforms_finish(sv_transforms_frame *f, int width_px, int height_px, sv_err *err) SV_MUST_USE;

// The multiplexed measurement of an exposure ("composites", or "composites_linear": summed in
// linear light): its image and the largest sum of overlapping footprints. SV_END when there is
// none.
typedef struct {
  char file_path[SV_TRANSFORMS_CAP_PATH];
  double max_overlap;
} sv_transforms_measurement;
sv_status sv_transforms_find_measurement(const sv_transforms *t, bool is_linear, int exposure,
                                         sv_transforms_measurement *out, sv_err *err) SV_MUST_USE;

#ifdef __cplusplus
}
#endif
#endif
