// SPDX-License-Identifier: Apache-2.0
// What a QuickTime or MP4 file says of its two eyes: boxes of ISO/IEC 14496-12 and of Apple's
// "Stereo Video ISOBMFF Extensions" (vexu, hfov). Owns nothing: it reads the caller's bytes. Never
// decodes pictures.
#ifndef SV_TOOLS_IMPORT_SPATIAL_H
#define SV_TOOLS_IMPORT_SPATIAL_H

#include <stdbool.h>

#include "src/base/file_data.h"
#include "src/base/status.h"

#ifdef __cplusplus
extern "C" {
#endif

#define LAB_SPATIAL_CAP_TRACKS 8

typedef enum {
  LAB_PACKING_NONE,
  LAB_PACKING_SIDE, // left and right half
  LAB_PACKING_OVER  // upper and lower half
} lab_packing;

typedef struct {
  bool has_left, has_right; // eyes of this track (stri)
  bool is_reversed;         // the right eye is first
  bool is_layered;          // MV-HEVC: both views are layers of one stream (lhvC)
  bool is_rectilinear;      // prji; also where it is not said
  lab_packing packing;
  double baseline_m; // blin; 0: not said
  double fov_rad;    // hfov, of the width of one eye; 0: not said
} lab_spatial_track;

typedef struct {
  lab_spatial_track tracks[LAB_SPATIAL_CAP_TRACKS]; // of video, in the file's order
  int n;
} lab_spatial;

// moov: the content of that box. E_FORMAT: boxes do not fit into those around them.
sv_status lab_spatial_parse(lab_spatial *s, const sv_file_data *moov, sv_err *err) SV_MUST_USE;
// The same of a file, of which only that box is read.
sv_status lab_spatial_read(lab_spatial *s, const char *path, sv_err *err) SV_MUST_USE;

#ifdef __cplusplus
}
#endif
#endif
