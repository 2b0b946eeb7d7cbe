// SPDX-License-Identifier: Apache-2.0
#include <stdlib.h>
#include <string.h>

#include "boards/board_main.h"

void say(int fd, const char *fmt, ...) {
  char text[4096];
  va_list ap;
  va_start(ap, fmt);
  size_t n = sv_vfmt(text, sizeof text, fmt, ap);
  va_end(ap);
  if (n >= sizeof text) n = sizeof text - 1;
  sv_linux_print(fd, text, n); // a closed terminal is no reason to stop
}

int usage_error(const char *command, const char *fmt, ...) {
  va_list ap;
  va_start(ap, fmt);
  int e = sv_options_vusage("subview", command, fmt, ap);
  va_end(ap);
  return e;
}

int fail_with(const sv_err *err) {
  say(2, "subview: %s\n", err->text);
  return 1;
}

void print_version(void) { say(1, "subview " VERSION " (" BOARD_NAME ")\n"); }

int options_parse(const sv_tool_command *command, const sv_option *rows, int n_rows, int argc, char **argv,
                  void *to) {
  const sv_options options = {.program = "subview", .rows = rows, .n_rows = n_rows};
  const options_common *common = to;
  int e = sv_options_parse(&options, command, argc - 1, argv + 1, to);
  if (common->is_help) sv_options_help(&options, command);
  else if (common->is_version) print_version();
  return common->is_help || common->is_version ? -1 : e;
}

bool size_of(const char *text, int *width_px, int *height_px) {
  const char *x = strchr(text, 'x');
  long long w, h;
  if (!x || !sv_parse_int(text, (size_t)(x - text), &w) || !sv_parse_int(x + 1, strlen(x + 1), &h))
    return false;
  if (w < 1 || h < 1 || w > 16384 || h > 16384) return false;
  *width_px = (int)w;
  *height_px = (int)h;
  return true;
}

int sync_mode_of(const char *name) {
  // In the order of sv_sync_method
  static const char *const names[] = {"free", "frame-length", "trigger"};
  for (int i = 0; i < 3; i++)
    if (!strcmp(name, names[i])) return i;
  return -1;
}
