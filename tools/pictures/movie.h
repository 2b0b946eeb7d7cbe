// SPDX-License-Identifier: Apache-2.0
// A film of rendered frames.
#ifndef SV_TOOLS_PICTURES_MOVIE_H
#define SV_TOOLS_PICTURES_MOVIE_H

#include "tools/lab/lab.h"

// FOLDER/frame_0000.png and on -> FOLDER/movie.mp4 and FOLDER/sheet.png. Says so where there is no
// ffmpeg.
sv_status lab_movie_make(lab_session *se, const char *folder, int n_frames, double fps,
                         sv_err *err) SV_MUST_USE;

// Frames to one H.264 file, by ffmpeg. All zero: none.
typedef struct {
  char path[SV_CAP_PATH];
  long pid; // of ffmpeg
  int pipe; // to it
  size_t frame_bytes;
} lab_video;
// E_NOT_FOUND: there is no ffmpeg.
sv_status lab_video_begin(lab_video *v, const char *path, const int size_px[2], double fps,
                          sv_err *err) SV_MUST_USE;
// rgb: [height][width][3].
sv_status lab_video_add(lab_video *v, const uint8_t *rgb, sv_err *err) SV_MUST_USE;
sv_status lab_video_end(lab_video *v, sv_err *err) SV_MUST_USE;
// Stops one that was not ended, and removes its file.
void lab_video_abandon(lab_video *v);

#endif
