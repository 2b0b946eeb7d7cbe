// SPDX-License-Identifier: Apache-2.0
#include "tools/prior/network.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

typedef struct {
  const char *file;
  int line;
  sv_network *out;
} parser;

static sv_status bad(const parser *p, sv_err *err, const char *key, const char *expected) {
  return sv_fail(err, SV_E_FORMAT, "%s:%d: '%s' expects %s", p->file, p->line, key, expected);
}

static sv_status take_numbers(const parser *p, const char *key, const char *text, double *three,
                              sv_err *err) {
  double v[3];
  int end = 0;
  if (sscanf(text, "%lf %lf %lf %n", &v[0], &v[1], &v[2], &end) != 3 || text[end])
    return bad(p, err, key, "three numbers: red, green, blue");
  const bool is_mean = three == p->out->mean;
  for (int c = 0; c < 3; c++)
    if (!isfinite(v[c]) || (!is_mean && !(v[c] > 0)))
      return bad(p, err, key, "finite numbers, and positive ones for 'std'");
  memcpy(three, v, sizeof v);
  return SV_OK;
}

static sv_status take_size(const parser *p, const char *text, sv_err *err) {
  int w = 0, h = 0, end = 0;
  if (sscanf(text, "%dx%d %n", &w, &h, &end) != 2 || text[end] || w < 1 || h < 1 ||
      w > SV_NETWORK_CAP_SIDE_PX || h > SV_NETWORK_CAP_SIDE_PX)
    return bad(p, err, "size", "WIDTHxHEIGHT of 1 to 4096 pixels");
  p->out->width_px = w;
  p->out->height_px = h;
  return SV_OK;
}

static sv_status take_choice(const parser *p, const char *key, const char *text, const char *const names[2],
                             bool *is_first, sv_err *err) {
  char expected[64];
  snprintf(expected, sizeof expected, "%s or %s", names[0], names[1]);
  *is_first = strcmp(text, names[0]) == 0;
  return *is_first || strcmp(text, names[1]) == 0 ? SV_OK : bad(p, err, key, expected);
}

static sv_status take(const parser *p, const char *key, const char *text, sv_err *err) {
  static const char *const orders[] = {"bgr", "rgb"}, *const outputs[] = {"disparity", "depth"};
  char folder[SV_CAP_PATH];
  if (strcmp(key, "size") == 0) return take_size(p, text, err);
  if (strcmp(key, "mean") == 0) return take_numbers(p, key, text, p->out->mean, err);
  if (strcmp(key, "std") == 0) return take_numbers(p, key, text, p->out->deviation, err);
  if (strcmp(key, "order") == 0) return take_choice(p, key, text, orders, &p->out->is_bgr, err);
  if (strcmp(key, "output") == 0) return take_choice(p, key, text, outputs, &p->out->is_disparity, err);
  if (strcmp(key, "network") == 0) {
    sv_path_folder(folder, sizeof folder, p->file);
    return *text ? sv_path_join(p->out->path, sizeof p->out->path, folder, text, err)
                 : bad(p, err, key, "a file");
  }
  if (strcmp(key, "layer") == 0) {
    if (!*text || strlen(text) >= sizeof p->out->layer)
      return bad(p, err, key, "a name of 1 to 127 characters");
    memcpy(p->out->layer, text, strlen(text) + 1);
    return SV_OK;
  }
  return sv_fail(err, SV_E_FORMAT,
                 "%s:%d: unknown word '%.40s', expected network, size, mean, std, order, output or layer",
                 p->file, p->line, key);
}

// Splits a line into its word and the rest, without comment and outer blanks.
static char *split(char *line) {
  line[strcspn(line, "#\r")] = 0;
  for (size_t n = strlen(line); n && strchr(" \t", line[n - 1]); n--) line[n - 1] = 0;
  char *rest = line + strcspn(line, " \t");
  if (*rest) *rest++ = 0;
  return rest + strspn(rest, " \t");
}

static sv_status parse(parser *p, char *text, sv_err *err) {
  bool has_output = false;
  while (text && *text) {
    char *line = text, *end = strchr(text, '\n');
    if (end) *end++ = 0;
    text = end;
    p->line++;
    line += strspn(line, " \t");
    const char *rest = split(line);
    if (!*line) continue;
    sv_status s = take(p, line, rest, err);
    if (s != SV_OK) return s;
    has_output |= strcmp(line, "output") == 0;
  }
  const char *missing = !*p->out->path      ? "network"
                        : !p->out->width_px ? "size"
                        : has_output        ? NULL
                                            : "output";
  if (missing) return sv_fail(err, SV_E_FORMAT, "%s: '%s' is missing", p->file, missing);
  return SV_OK;
}

sv_status sv_network_read(const char *path, sv_network *out, sv_err *err) {
  void *data;
  size_t bytes;
  *out = (sv_network){.deviation = {1, 1, 1}};
  sv_status s = sv_file_read(path, &data, &bytes, err);
  if (s != SV_OK) return s;
  parser p = {path, 0, out};
  s = strlen(data) == bytes ? parse(&p, data, err) : sv_fail(err, SV_E_FORMAT, "%s: not a text file", path);
  free(data);
  return s;
}
