// SPDX-License-Identifier: Apache-2.0
// subview status: what the service does. A script beside the libcamera module asks systemd and the
// page; this command starts it.
#include <string.h>
#include <unistd.h>

#include "boards/board_main.h"

typedef struct {
  options_common common;
} status_options;

static const sv_option rows[] = {OPTIONS_COMMON(status_options)};

static const sv_tool_command command = {
    .name = "status",
    .args = "[options]",
    .text =
        "Prints what the service subview of this machine does, in ten lines: state, page, cameras, scans.\n"
        "As root with the page's link. Exit code 0 if the service is active. The service is part of the "
        "package.",
    .example = "  sudo subview status",
    .bit = 1};

int cmd_status(int argc, char **argv) {
  status_options o = {0};
  char path[640];
  int r = options_parse(&command, rows, sizeof rows / sizeof *rows, argc, argv, &o);
  if (r) return r < 0 ? 0 : r;
  ssize_t n = readlink("/proc/self/exe", path, sizeof path - 64);
  while (n > 0 && path[n - 1] != '/') n--;
  if (n <= 0) n = 0;
  sv_copy(path + n, sizeof path - (size_t)n, "../lib/subview/status");
  execl(path, "subview status", (char *)NULL);
  say(2, "subview: %s: cannot be started; the package subview installs it, with the service\n", path);
  return 1;
}
