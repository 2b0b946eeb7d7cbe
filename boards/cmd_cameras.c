// SPDX-License-Identifier: Apache-2.0
// subview cameras: what can be captured from on this machine.
#include <string.h>

#include "boards/board_main.h"

int cmd_cameras(int argc, char **argv) {
  const char *kind = "sim";
  const opt list[] = {{"--source-kind", OPT_TEXT, &kind, 0, 0, "KIND",
                       "sim: the simulator's scenes (v4l2 and libcamera are not built in)"}};
  int r = options_parse("cameras", "Lists cameras, a line each: the source string to use, then what it is.",
                        "subview cameras --source-kind sim", list, 1, argc, argv);
  if (r) return r < 0 ? 0 : r;
  if (!strcmp(kind, "v4l2") || !strcmp(kind, "libcamera")) {
    say(2, "subview: this build has no %s support; the simulator is --source-kind sim\n", kind);
    return 1;
  }
  if (strcmp(kind, "sim")) return usage_error("cameras", "--source-kind %s: expected sim", kind);
  static char text[8192];
  sv_str s = sv_str_make(text, sizeof text);
  sv_sim_list(&s);
  for (const char *t = text; *t;) { // say() takes 4 KiB at a time
    size_t n = strcspn(t, "\n");
    say(1, "%.*s\n", (int)n, t);
    t += n + (t[n] == '\n');
  }
  return 0;
}
