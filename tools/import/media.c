// SPDX-License-Identifier: Apache-2.0
#include "tools/import/media.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "src/base/str.h"
#include "tools/common/program.h"

#define CAP_TEXT ((size_t)64 << 20)

// --- what a file holds ---------------------------------------------------------------------------

// Days since 1970 of a date in the Gregorian calendar.
static long days_of(int y, int m, int d) {
  y -= m <= 2;
  const long era = y / 400, year = y % 400, day = (153 * (m + (m > 2 ? -3 : 9)) + 2) / 5 + d - 1;
  return era * 146097 + year * 365 + year / 4 - year / 100 + day - 719468;
}

// "2024-05-01T12:34:56.500000Z", the form in which ffprobe prints creation_time.
static bool parse_time(const char *text, double *out) {
  int y, mo, d, h, mi;
  double sec;
  if (sscanf(text, "%4d-%2d-%2d%*1[T ]%2d:%2d:%lf", &y, &mo, &d, &h, &mi, &sec) != 6) return false;
  // 1904 and 1970 mean that the clock was never set.
  if (y < 1971 || y > 9999 || mo < 1 || mo > 12 || d < 1 || d > 31 || h < 0 || h > 23 || mi < 0 || mi > 59 ||
      !(sec >= 0 && sec < 61))
    return false;
  *out = (double)days_of(y, mo, d) * 86400 + h * 3600 + mi * 60 + sec;
  return true;
}

sv_status lab_media_probe(const char *path, lab_media *m, sv_err *err) {
  const char *const argv[] = {
      "ffprobe",      "-v", "error", "-show_entries", "stream=codec_type:format_tags=creation_time", "-of",
      "default=nw=1", path, NULL};
  char *text;
  *m = (lab_media){0};
  sv_status s = sv_program_text(argv, CAP_TEXT, &text, err);
  if (s == SV_E_DEVICE) return sv_fail(err, SV_E_FORMAT, "%s: ffprobe cannot read it", path);
  if (s != SV_OK) return s;
  m->has_video = strstr(text, "codec_type=video") != NULL;
  m->has_sound = strstr(text, "codec_type=audio") != NULL;
  const char *tag = strstr(text, "TAG:creation_time=");
  if (tag) m->has_created = parse_time(strchr(tag, '=') + 1, &m->created_s);
  free(text);
  return m->has_video ? SV_OK : sv_fail(err, SV_E_FORMAT, "%s: holds no video", path);
}

// --- frames --------------------------------------------------------------------------------------

// Times of the file itself (-copyts), so that pictures and sound have one clock; each frame once.
#define FFMPEG_INPUT(path, stream) "ffmpeg", "-v", "error", "-nostdin", "-copyts", "-i", path, "-map", stream
#define EACH_FRAME                 "-fps_mode", "passthrough"

static sv_status cannot_decode(const lab_media_stream *from, sv_err *err) {
  return sv_fail(err, SV_E_FORMAT, "%s: ffmpeg cannot decode its video %s", from->path, from->stream);
}

static bool add_frame(lab_media_frames *f, int *cap, double time_s) {
  if (f->n == *cap) {
    *cap = *cap ? 2 * *cap : 1024;
    double *t = realloc(f->times_s, (size_t)*cap * sizeof *t);
    if (t) f->times_s = t;
    double *b = realloc(f->brightness, (size_t)*cap * sizeof *b);
    if (b) f->brightness = b;
    if (!t || !b) return false;
  }
  f->times_s[f->n] = time_s;
  f->brightness[f->n++] = 0;
  return true;
}

// "frame:12   pts:400   pts_time:0.4", then "lavfi.signalstats.YAVG=81.2".
static sv_status take_line(lab_media_frames *f, int *cap, const char *line) {
  static const char luma[] = "lavfi.signalstats.YAVG=";
  const char *t = strstr(line, "pts_time:");
  if (strncmp(line, luma, sizeof luma - 1) == 0 && f->n > 0)
    f->brightness[f->n - 1] = strtod(line + sizeof luma - 1, NULL);
  if (strncmp(line, "frame:", 6) != 0 || !t) return SV_OK;
  const double time_s = strtod(t + 9, NULL);
  if (!(fabs(time_s) < 1e7)) return SV_E_FORMAT;
  return add_frame(f, cap, time_s) ? SV_OK : SV_E_NOMEM;
}

sv_status lab_media_scan(const lab_media_stream *from, lab_media_frames *f, sv_err *err) {
  char filter[256], line[256];
  sv_program p;
  int cap = 0;
  *f = (lab_media_frames){0};
  snprintf(filter, sizeof filter,
           "%s%sscale=64:36,signalstats,metadata=mode=print:key=lavfi.signalstats.YAVG:file=-",
           from->filter ? from->filter : "", from->filter ? "," : "");
  const char *const argv[] = {
      FFMPEG_INPUT(from->path, from->stream), "-vf", filter, EACH_FRAME, "-f", "null", "/dev/null", NULL};
  sv_status s = sv_program_start(&p, argv, err);
  if (s != SV_OK) return s;
  while (s == SV_OK && fgets(line, sizeof line, p.out)) {
    s = take_line(f, &cap, line);
    if (from->console && from->console->is_stop_requested(from->console->self)) s = SV_E_INTERRUPTED;
  }
  const int code = sv_program_end(&p);
  if (s == SV_E_NOMEM) s = sv_fail(err, s, "%s: no memory for its list of frames", from->path);
  if (s == SV_E_FORMAT || (s == SV_OK && (code != 0 || f->n == 0))) s = cannot_decode(from, err);
  if (s != SV_OK) lab_media_frames_free(f);
  return s;
}

void lab_media_frames_free(lab_media_frames *f) {
  free(f->times_s);
  free(f->brightness);
  *f = (lab_media_frames){0};
}

// --- pictures ------------------------------------------------------------------------------------

// The head of a binary PPM as ffmpeg writes it.
static bool read_head(FILE *f, int *w, int *h) {
  int most = 0;
  return fscanf(f, "P6 %d %d %d", w, h, &most) == 3 && fgetc(f) != EOF && most == 255 && *w > 0 && *h > 0 &&
         *w <= LAB_MEDIA_CAP_SIDE_PX && *h <= LAB_MEDIA_CAP_SIDE_PX;
}

static bool read_picture(FILE *f, sv_bitmap *b, size_t *room) {
  int w, h;
  if (!read_head(f, &w, &h)) return false;
  const size_t bytes = (size_t)w * (size_t)h * 3;
  if (bytes > *room) {
    uint8_t *more = realloc(b->u8, bytes);
    if (!more) return false;
    b->u8 = more;
    *room = bytes;
  }
  *b = (sv_bitmap){.width_px = w, .height_px = h, .n_channels = 3, .bits = 8, .u8 = b->u8};
  return fread(b->u8, 1, bytes, f) == bytes;
}

sv_status lab_media_decode(const lab_media_stream *from, const lab_media_wanted *want, sv_err *err) {
  const char *const argv[] = {FFMPEG_INPUT(from->path, from->stream),
                              "-vf",
                              from->filter ? from->filter : "null",
                              EACH_FRAME,
                              "-f",
                              "image2pipe",
                              "-c:v",
                              "ppm",
                              "-pix_fmt",
                              "rgb24",
                              "-",
                              NULL};
  sv_bitmap b = {0};
  sv_program p;
  size_t room = 0;
  int i = 0;
  sv_status s = sv_program_start(&p, argv, err);
  if (s != SV_OK) return s;
  for (int k = 0; s == SV_OK && i < want->n; k++) {
    if (!read_picture(p.out, &b, &room)) break;
    if (from->console && from->console->is_stop_requested(from->console->self)) s = SV_E_INTERRUPTED;
    else if (k == want->frames[i]) s = want->put(want->self, i++, &b, err);
  }
  sv_program_end(&p);
  free(b.u8);
  return s == SV_OK && i < want->n ? cannot_decode(from, err) : s;
}

static sv_status keep_size(void *self, int i, const sv_bitmap *b, sv_err *err) {
  int *size = self;
  (void)i;
  (void)err;
  size[0] = b->width_px;
  size[1] = b->height_px;
  return SV_OK;
}

sv_status lab_media_size(const lab_media_stream *from, int size_px[2], sv_err *err) {
  const int first = 0;
  const lab_media_wanted want = {&first, 1, size_px, keep_size};
  return lab_media_decode(from, &want, err);
}

// --- sound ---------------------------------------------------------------------------------------

sv_status lab_media_listen(const char *path, int rate_hz, int cap, lab_media_sound *sound, sv_err *err) {
  char rate[16], length[32];
  char *raw;
  snprintf(rate, sizeof rate, "%d", rate_hz);
  snprintf(length, sizeof length, "%d", cap / rate_hz);
  // Silence stands for what is missing before the first sample.
  const char *const argv[] = {FFMPEG_INPUT(path, "0:a:0"),
                              "-af",
                              "aresample=async=1:first_pts=0",
                              "-ac",
                              "1",
                              "-ar",
                              rate,
                              "-t",
                              length,
                              "-f",
                              "f32le",
                              "-",
                              NULL};
  *sound = (lab_media_sound){0};
  sv_program p;
  sv_status s = sv_program_start(&p, argv, err);
  if (s != SV_OK) return s;
  raw = malloc((size_t)cap * sizeof(float));
  const size_t n = raw ? fread(raw, sizeof(float), (size_t)cap, p.out) : 0;
  const int code = sv_program_end(&p);
  if (!raw) return sv_fail(err, SV_E_NOMEM, "%s: no memory for its sound", path);
  sound->samples = (float *)(void *)raw;
  sound->n = (int)n;
  for (size_t i = 0; i < n; i++)
    if (!isfinite(sound->samples[i])) sound->samples[i] = 0;
  if (n > 0 && (code == 0 || n == (size_t)cap)) return SV_OK;
  free(raw);
  *sound = (lab_media_sound){0};
  return sv_fail(err, SV_E_FORMAT, "%s: ffmpeg cannot decode its sound", path);
}

// --- the program itself --------------------------------------------------------------------------

sv_status lab_media_has_views(bool *has, char *version, size_t cap, sv_err *err) {
  const char *const ask[] = {"ffmpeg", "-v", "error", "-h", "decoder=hevc", NULL};
  const char *const name[] = {"ffmpeg", "-version", NULL};
  char *text;
  sv_status s = sv_program_text(ask, CAP_TEXT, &text, err);
  if (s != SV_OK) return s;
  *has = strstr(text, "view_ids") != NULL;
  free(text);
  s = sv_program_text(name, CAP_TEXT, &text, err);
  if (s != SV_OK) return s;
  const char *v = strstr(text, "version ");
  v = v ? v + 8 : "unknown";
  snprintf(version, cap, "%.*s", (int)strcspn(v, " -\n"), v);
  free(text);
  return SV_OK;
}
