// SPDX-License-Identifier: Apache-2.0
// subview cameras: what can be captured from on this machine.
#include <string.h>

#include "boards/board_main.h"

static char text[32 * 1024];

static void print_lines(const char *t) {
  while (*t) { // say() takes 4 KiB at a time
    size_t n = strcspn(t, "\n");
    say(1, "%.*s\n", (int)n, t);
    t += n + (t[n] == '\n');
  }
}

// How many there are; -1 after a message.
static int list_kind(const char *kind) {
  sv_err err = {0};
  sv_str s = sv_str_make(text, sizeof text);
  int n = 1;
  text[0] = 0;
  if (!strcmp(kind, "sim")) sv_sim_list(&s);
  else if (!strcmp(kind, "v4l2")) {
    sv_v4l2_sys sys = sv_v4l2_linux();
    n = sv_v4l2_list(&s, &sys);
  } else n = sv_libcamera_list(&s, &err);
  if (n < 0) {
    fail_with(&err);
    return -1;
  }
  print_lines(text);
  return n;
}

int cmd_cameras(int argc, char **argv) {
  const char *kind = "";
  const opt list[] = {{"--source-kind", OPT_TEXT, &kind, 0, 0, "KIND",
                       "sim, v4l2 or libcamera (default: V4L2 and libcamera cameras, then the simulator's)"}};
  int r = options_parse(
      "cameras",
      "Lists cameras, a line each: the source string to use, then what it is, its formats, sizes@fps.\n"
      "Several cameras of a kind make one source: v4l2:/dev/video0,/dev/video2. Options follow after "
      "commas:\n"
      "  size=WxH format=FOURCC fps=F buffers=N    what the cameras deliver\n"
      "  exposure=US gain=N wb=K lock=on|off settle=MS    held still while they run, unless lock=off\n"
      "  stall=MS clock=camera|monotonic|boottime|realtime stamp=start|middle|end dmabuf=on|off\n"
      "  black=N red=F blue=F light=linear|display    raw sensors: black level, gains, kind of values\n"
      "  sync=off|server|client    libcamera on Raspberry Pi: frames of several boards at one time\n"
      "Of all sources: tiles=CxR (a picture holds so many cameras), fov=DEG (a single camera without a rig).",
      "subview cameras --source-kind v4l2", list, 1, argc, argv);
  if (r) return r < 0 ? 0 : r;
  if (!kind[0]) {
    list_kind("v4l2");
    if (sv_libcamera_version()) list_kind("libcamera");
    return list_kind("sim") < 0;
  }
  if (strcmp(kind, "sim") && strcmp(kind, "v4l2") && strcmp(kind, "libcamera"))
    return usage_error("cameras", "--source-kind %s: expected sim, v4l2 or libcamera", kind);
  int n = list_kind(kind);
  if (n == 0) say(2, "subview: no %s camera was found on this machine\n", kind);
  return n > 0 ? 0 : 1;
}
