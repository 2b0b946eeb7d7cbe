// SPDX-License-Identifier: Apache-2.0
// Clips of several cameras -> capture folders: which frames are one exposure, and their pictures.
#ifndef SV_TOOLS_IMPORT_CLIPS_H
#define SV_TOOLS_IMPORT_CLIPS_H

#include "tools/import/media.h"
#include "tools/import/recording.h"
#include "tools/lab/lab.h"

#ifdef __cplusplus
extern "C" {
#endif

typedef struct {
  lab_media_stream stream;
  lab_media_frames frames;
  double offset_s; // its time plus this is the common time
  int *kept;       // [n_exposures] the frame of each exposure
} lab_clip;

typedef struct {
  lab_clip *clips; // [n]
  int n, n_exposures;
  double max_skew_s, fps; // of the exposures
} lab_clips;

// Exposures are the frames of the slowest clip, at least every_s apart, with the nearest frame of
// each other clip, which must be less than half of its period away. Fills `kept`. E_NOT_FOUND: the
// clips have no time in common.
sv_status lab_clips_pair(lab_clips *c, double every_s, sv_err *err) SV_MUST_USE;
// Pictures of the exposures as OUT/<camera>/000000.png, and their times in the cameras [n], whose
// names are given. Earlier pictures of these folders are removed.
sv_status lab_clips_write(const sv_import_job *job, const lab_clips *c, sv_import_camera *cams,
                          sv_err *err) SV_MUST_USE;
// The part of it that decodes nothing: the times of clip k, and its folder without pictures.
sv_status lab_clips_set_times(const sv_import_job *job, const lab_clips *c, int k, sv_import_camera *cam,
                              sv_err *err) SV_MUST_USE;
void lab_clips_free(lab_clips *c);

// --rig becomes the rig of the capture OUT; its sub-views must have the names of the cameras.
sv_status lab_clips_take_rig(const lab_options *o, const sv_import_camera *cams, int n,
                             sv_err *err) SV_MUST_USE;

// Makes OUT/<folder> and removes the pictures in it.
sv_status lab_clips_clear(const sv_import_job *job, const char *folder, sv_err *err) SV_MUST_USE;

#ifdef __cplusplus
}
#endif
#endif
