// SPDX-License-Identifier: Apache-2.0
// Clips through ffmpeg and ffprobe where they are installed: what a file holds, when its frames
// were taken, their pictures and its sound. Owns the lists that it returns until they are freed.
// Never writes files.
#ifndef SV_TOOLS_IMPORT_MEDIA_H
#define SV_TOOLS_IMPORT_MEDIA_H

#include <stdbool.h>

#include "src/base/status.h"
#include "src/port/port.h"
#include "tools/common/fileio.h"
#include "tools/common/imageio.h"

#ifdef __cplusplus
extern "C" {
#endif

#define LAB_MEDIA_CAP_SIDE_PX 16384

typedef struct {
  bool has_video, has_sound, has_created;
  double created_s; // since 1970, as the container says, mostly in whole seconds
} lab_media;

// E_NOT_FOUND: no ffprobe; E_FORMAT: it does not read the file, or finds no video.
sv_status lab_media_probe(const char *path, lab_media *m, sv_err *err) SV_MUST_USE;

// Frames of one video stream, in the order in which they are shown.
typedef struct {
  int n;
  double *times_s;    // [n] in the file's time
  double *brightness; // [n] mean luma
} lab_media_frames;
// A stream of a file, and what is made of its frames; stream: ffmpeg's -map ("0:v:0"); filter: for
// its -vf, NULL for none. console may be NULL; Ctrl-C: E_INTERRUPTED without a sentence.
typedef struct {
  const char *path, *stream, *filter;
  const sv_console *console;
} lab_media_stream;
sv_status lab_media_scan(const lab_media_stream *from, lab_media_frames *f, sv_err *err) SV_MUST_USE;
void lab_media_frames_free(lab_media_frames *f);

// Called with each wanted frame, in their order; i counts the wanted ones. The bitmap (8 bits, RGB)
// is the caller's.
typedef sv_status (*lab_media_sink)(void *self, int i, const sv_bitmap *b, sv_err *err);
typedef struct {
  const int *frames; // [n] numbers of frames, rising
  int n;
  void *self;
  lab_media_sink put;
} lab_media_wanted;
sv_status lab_media_decode(const lab_media_stream *from, const lab_media_wanted *want,
                           sv_err *err) SV_MUST_USE;

// Width and height of the first frame.
sv_status lab_media_size(const lab_media_stream *from, int size_px[2], sv_err *err) SV_MUST_USE;

// Mono samples from time 0 of the file on, at most cap of them. Free with free().
typedef struct {
  float *samples;
  int n;
} lab_media_sound;
sv_status lab_media_listen(const char *path, int rate_hz, int cap, lab_media_sound *sound,
                           sv_err *err) SV_MUST_USE;

// Whether this ffmpeg decodes both views of MV-HEVC; its version in words.
sv_status lab_media_has_views(bool *has, char *version, size_t cap, sv_err *err) SV_MUST_USE;

#ifdef __cplusplus
}
#endif
#endif
