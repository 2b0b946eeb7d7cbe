// SPDX-License-Identifier: Apache-2.0
// A rig: cameras that expose at the same time and are fixed to each other. One camera is a rig,
// too.
// Owns: the description of lenses, poses and views.
// Never: calibrates. `subview-calibrate` measures these numbers.
#ifndef SUBVIEW_RIG_H
#define SUBVIEW_RIG_H

#include "status.h"

#ifdef __cplusplus
extern "C" {
#endif

// A rigid transform: x_a = r x_b + t for a pose a_from_b. r is row-major and orthonormal, t in
// metres. Camera axes are OpenCV's: x right, y down, z forward.
typedef struct {
  double r[9];
  double t[3];
} subview_pose;

subview_pose subview_pose_identity(void);
// a_from_c of a_from_b and b_from_c.
subview_pose subview_pose_mul(const subview_pose *a_from_b, const subview_pose *b_from_c);
// A camera at `eye` that looks at `at` with `up` upwards in its image (all in world coordinates):
// cam_from_world. E_ARG when the three do not define a pose.
subview_status subview_pose_look_at(subview_pose *cam_from_world, const double eye[3], const double at[3],
                                    const double up[3]);

// Lens models with OpenCV's parameters, in this order: fx, fy, cx, cy [px], then the distortion
// terms.
typedef enum {
  SUBVIEW_LENS_PINHOLE, // 4 parameters
  SUBVIEW_LENS_OPENCV4, // 8: and k1, k2, p1, p2
  SUBVIEW_LENS_OPENCV5, // 9: and k3
  SUBVIEW_LENS_OPENCV8, // 12: and k4, k5, k6
  SUBVIEW_LENS_FISHEYE  // 8: and k1..k4 of OpenCV's fisheye model
} subview_lens;

// Layout of a camera's frames in memory.
typedef enum {
  SUBVIEW_PIXELS_RGB8,  // 3 bytes per pixel: R, G, B
  SUBVIEW_PIXELS_BGR8,  // 3 bytes per pixel: B, G, R
  SUBVIEW_PIXELS_RGBX8, // 4 bytes per pixel: R, G, B, ignored
  SUBVIEW_PIXELS_BGRX8, // 4 bytes per pixel: B, G, R, ignored
  SUBVIEW_PIXELS_GREY8, // 1 byte per pixel
  SUBVIEW_PIXELS_YUYV,  // 4:2:2: Y0 Cb Y1 Cr
  SUBVIEW_PIXELS_UYVY,  // 4:2:2: Cb Y0 Cr Y1
  SUBVIEW_PIXELS_NV12   // 4:2:0: a plane of Y, then a plane of Cb, Cr at half size
} subview_pixels;

// How Y'CbCr becomes R'G'B'. Used by YUYV, UYVY and NV12 only.
typedef enum {
  SUBVIEW_YUV_601,      // BT.601, limited range
  SUBVIEW_YUV_601_FULL, // BT.601, full range (JPEG)
  SUBVIEW_YUV_709,      // BT.709, limited range
  SUBVIEW_YUV_709_FULL  // BT.709, full range
} subview_yuv;

// One camera of the rig. subview_camera_defaults fills it in.
typedef struct {
  // Size of its frames, px, 1 to 16384 a side.
  int width_px, height_px;
  // Layout of its frames in memory. Default: RGB8.
  subview_pixels pixels;
  // Colour matrix of Y'CbCr frames. Default: BT.601, limited range.
  subview_yuv yuv;
  // Lens model. Default: pinhole.
  subview_lens lens;
  // Lens parameters, in the order of subview_lens. The centre of the first pixel is at (0.5, 0.5),
  // so OpenCV's cx and cy need 0.5 added. Default: focal length = width, principal point in the
  // middle.
  double p[12];
  // Pose in the rig. Default: identity.
  subview_pose cam_from_rig;
} subview_camera;

subview_camera subview_camera_defaults(int width_px, int height_px);

// A pinhole view without distortion, to be rendered.
typedef struct {
  int width_px, height_px;
  double fx, fy, cx, cy; // px; the centre of the first pixel is at (0.5, 0.5)
  subview_pose cam_from_world;
} subview_view;

#ifdef __cplusplus
}
#endif
#endif
