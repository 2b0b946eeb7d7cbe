// SPDX-License-Identifier: Apache-2.0
#include "boards/modes.h"

#include <string.h>

// Two numbers with an 'x' between them, and the rate behind an '@' in tenths; 0: no rate.
typedef struct {
  long long width_px, height_px;
  double fps;
} mode;

static bool parse_mode(const char *word, size_t n, mode *m) {
  const char *x = memchr(word, 'x', n), *at = memchr(word, '@', n), *end = at ? at : word + n;
  *m = (mode){0};
  return x && x < end && sv_parse_int(word, (size_t)(x - word), &m->width_px) &&
         sv_parse_int(x + 1, (size_t)(end - x) - 1, &m->height_px) && m->width_px > 0 && m->height_px > 0 &&
         (!at || (sv_parse_double(at + 1, (size_t)(word + n - at) - 1, &m->fps) && m->fps > 0));
}

static void add(sv_feed_modes *out, const mode *m, double fps) {
  char text[SV_FEED_CAP_MODE_TEXT];
  if (out->n == SV_FEED_CAP_MODES) return;
  if (fps > 0) sv_fmt(text, sizeof text, "%lldx%lld@%.4g", m->width_px, m->height_px, fps);
  else sv_fmt(text, sizeof text, "%lldx%lld", m->width_px, m->height_px);
  for (int i = 0; i < out->n; i++)
    if (sv_str_eq(out->text[i], text)) return;
  sv_copy(out->text[out->n++], sizeof out->text[0], text);
}

static void add_words(sv_feed_modes *out, const char *line, size_t n) {
  for (size_t i = 0; i < n;) {
    const size_t k = strcspn(line + i, " ;\n");
    mode m;
    if (i + k <= n && parse_mode(line + i, k, &m)) {
      add(out, &m, m.fps);
      if (m.fps >= 10) add(out, &m, m.fps / 2);
    }
    i += k + 1;
  }
}

void modes_list(const char *source, sv_feed_modes *out) {
  static char list[32 << 10];
  static const char sim[] = "160x120@30 320x240@30 640x480@30";
  sv_err err;
  sv_str s = sv_str_make(list, sizeof list);
  const char *colon = strchr(source, ':');
  const size_t n_kind = colon ? (size_t)(colon - source) : 0, n_name = strcspn(source, ",");
  *out = (sv_feed_modes){.i_mode = -1};
  list[0] = 0;
  if (n_kind == 3 && !strncmp(source, "sim", 3)) add_words(out, sim, sizeof sim - 1);
  if (n_kind == 4 && !strncmp(source, "v4l2", 4)) {
    const sv_v4l2_sys sys = sv_v4l2_linux();
    (void)sv_v4l2_list(&s, &sys);
  }
  if (n_kind == 9 && !strncmp(source, "libcamera", 9)) (void)sv_libcamera_list(&s, &err);
  for (const char *line = list; *line;) {
    const size_t n = strcspn(line, "\n");
    if (!strncmp(line, source, n_name) && line[n_name] == ' ') add_words(out, line, n);
    line += n + (line[n] == '\n');
  }
}

const char *modes_apply(const char *source, const sv_feed_modes *modes, int i_mode) {
  static char text[1024];
  mode m;
  if (i_mode < 0 || i_mode >= modes->n) return source;
  const char *word = modes->text[i_mode];
  if (!parse_mode(word, strlen(word), &m)) return source;
  sv_str out = sv_str_make(text, sizeof text);
  for (const char *at = source; *at;) {
    const size_t n = strcspn(at, ",");
    if (strncmp(at, "size=", 5) != 0 && strncmp(at, "fps=", 4) != 0)
      sv_str_add(&out, "%s%.*s", out.len ? "," : "", (int)n, at);
    at += n + (at[n] == ',');
  }
  sv_str_add(&out, ",size=%lldx%lld", m.width_px, m.height_px);
  if (m.fps > 0) sv_str_add(&out, ",fps=%g", m.fps);
  return out.is_cut ? source : text;
}
