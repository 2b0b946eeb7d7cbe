// SPDX-License-Identifier: Apache-2.0
// What depth cameras' own programs leave -> capture folders with a rig, and measured depth as a
// prior of the camera that it belongs to.
#ifndef SV_TOOLS_IMPORT_DEPTH_CAMERA_H
#define SV_TOOLS_IMPORT_DEPTH_CAMERA_H

#include "tools/import/clips.h"

#ifdef __cplusplus
extern "C" {
#endif

// A folder of `rs-convert -i FILE.bag -p DIR/x -r DIR/x` and `rs-enumerate-devices -c
// >DIR/calibration.txt`: PREFIX_STREAM_MILLISECONDS.png of "Infrared 1", "Infrared 2" and "Color",
// and 16-bit depth as PREFIX_Depth_MILLISECONDS.raw.
sv_status lab_import_realsense(const lab_options *o, lab_session *se, sv_err *err) SV_MUST_USE;

// A folder of DepthAI's recorder: calib.json, and left, right and color as .mp4, .mjpeg, .h264 or
// .h265.
sv_status lab_import_oak(const lab_options *o, lab_session *se, sv_err *err) SV_MUST_USE;

#ifdef __cplusplus
}
#endif
#endif
