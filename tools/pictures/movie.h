// SPDX-License-Identifier: Apache-2.0
// A film of rendered frames.
#ifndef SV_TOOLS_PICTURES_MOVIE_H
#define SV_TOOLS_PICTURES_MOVIE_H

#include "tools/lab/lab.h"

// FOLDER/frame_0000.png and on -> FOLDER/movie.mp4 and FOLDER/sheet.png. Says so where there is no
// ffmpeg.
sv_status lab_movie_make(lab_session *se, const char *folder, int n_frames, double fps,
                         sv_err *err) SV_MUST_USE;

#endif
