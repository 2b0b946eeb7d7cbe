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

typedef struct {
  options_common common;
  const char *kind;
} cameras_options;

#define AT(field) offsetof(cameras_options, field)

static const sv_option rows[] = {{"source-kind", SV_OPT_TEXT, 1, 0, AT(kind), "KIND",
                                  "sim, v4l2 or libcamera [V4L2 and libcamera cameras, then the simulator's]",
                                  0, 0, NULL},
                                 OPTIONS_COMMON(cameras_options)};

static const sv_tool_command command = {
    .name = "cameras",
    .args = "[options]",
    .text =
        "Lists cameras, one a line: its source string, name, formats and sizes@fps.\n"
        "Several cameras of a kind make one source: v4l2:/dev/video0,/dev/video2. Options follow after "
        "commas:\n"
        "  size=WxH format=FOURCC fps=F buffers=N    what the cameras deliver\n"
        "  exposure=US gain=N wb=K lock=on|shared|off settle=MS    fixed while they run, unless lock=off\n"
        "  brackets=F:F[:F[:F]] bracket-delay=N    exposure times in turn, as factors (docs/boards.md)\n"
        "  stall=MS clock=camera|monotonic|boottime|realtime stamp=start|middle|end dmabuf=on|off\n"
        "  black=N red=F blue=F light=linear|display    raw sensors: black level, gains, kind of values\n"
        "  trigger=gpio:CHIP:LINE|pwm:CHIP:CHANNEL trigger-period=US trigger-width=US "
        "trigger-polarity=high|low\n"
        "      trigger-mode=CONTROL:VALUE|MODULE.PARAMETER:VALUE    pulses for --sync trigger "
        "(docs/boards.md)\n"
        "  sync=off|server|client    libcamera on Raspberry Pi: cameras of one or several boards in step; a "
        "word,\n"
        "      or one for each camera with ':' between them\n"
        "A capture, replay:DIR, takes\n"
        "  speed=max|realtime|F    as fast as it is processed [max], as recorded, or F times that\n"
        "  from=N count=N          frames of each camera\n"
        "  poses=FILE              poses of the rig, in place of the capture's\n"
        "All sources: tiles=CxR (one image holds C x R cameras), fov=DEG (a single camera without a "
        "rig).",
    .example = "  "
               "subview cameras --source-kind v4l2",
    .bit = 1};

int cmd_cameras(int argc, char **argv) {
  cameras_options o = {.kind = ""};
  int r = options_parse(&command, rows, sizeof rows / sizeof *rows, argc, argv, &o);
  if (r) return r < 0 ? 0 : r;
  const char *kind = o.kind;
  if (!kind[0]) {
    const int n = list_kind("v4l2"), n_more = list_kind("libcamera");
    if (n <= 0 && n_more <= 0)
      say(2, "subview: no camera found on this machine; these scenes of the simulator need none:\n");
    return list_kind("sim") < 0;
  }
  if (strcmp(kind, "sim") && strcmp(kind, "v4l2") && strcmp(kind, "libcamera"))
    return usage_error("cameras", "--source-kind %s: expected sim, v4l2 or libcamera", kind);
  int n = list_kind(kind);
  if (n == 0) say(2, "subview: no %s camera found on this machine\n", kind);
  return n > 0 ? 0 : 1;
}
