// SPDX-License-Identifier: Apache-2.0
#include <linux/videodev2.h>
#include <string.h>

#include "platform/v4l2/camera.h"
#include "platform/v4l2/format.h"

#define CAP_NODES 64

static void add_rate(sv_str *out, double fps) {
  int tenths = (int)(10 * fps + 0.5);
  if (!tenths) return;
  if (tenths % 10) sv_str_add(out, "@%d.%d", tenths / 10, tenths % 10);
  else sv_str_add(out, "@%d", tenths / 10);
}

// " 640x480@30 1280x720@10" of one format, or the range of sizes.
static void add_sizes(sv_str *out, const sv_v4l2_camera *c, uint32_t fourcc) {
  for (uint32_t i = 0; i < 32; i++) {
    struct v4l2_frmsizeenum e = {.index = i, .pixel_format = fourcc};
    if (sv_v4l2_call(c, VIDIOC_ENUM_FRAMESIZES, &e) < 0) break;
    if (e.type != V4L2_FRMSIZE_TYPE_DISCRETE) {
      sv_str_add(out, " %ux%u..%ux%u", e.stepwise.min_width, e.stepwise.min_height, e.stepwise.max_width,
                 e.stepwise.max_height);
      break;
    }
    int w = (int)e.discrete.width, h = (int)e.discrete.height;
    sv_str_add(out, " %dx%d", w, h);
    add_rate(out, sv_v4l2_max_fps(c, fourcc, w, h));
  }
}

// Formats that have the same sizes share a list.
static int add_modes(sv_str *out, const sv_v4l2_camera *c) {
  char last[1024] = "", sizes[1024];
  int n = 0;
  for (uint32_t i = 0; i < 128; i++) {
    struct v4l2_fmtdesc d = {.index = i, .type = c->buf_type};
    char name[5];
    if (sv_v4l2_call(c, VIDIOC_ENUM_FMT, &d) < 0) break;
    if (sv_v4l2_format_index(d.pixelformat) < 0) continue;
    sv_str s = sv_str_make(sizes, sizeof sizes);
    add_sizes(&s, c, d.pixelformat);
    if (n && !sv_str_eq(sizes, last)) sv_str_add(out, "%s;", last);
    sv_v4l2_fourcc_name(d.pixelformat, name);
    for (int k = 3; k > 0 && name[k] == ' '; k--) name[k] = 0;
    sv_str_add(out, "%s%s", n && sv_str_eq(sizes, last) ? "," : " ", name);
    memcpy(last, sizes, sizeof last);
    n++;
  }
  if (n) sv_str_add(out, "%s", last);
  return n;
}

static bool look(sv_v4l2_camera *c) {
  struct v4l2_capability cap;
  memset(&cap, 0, sizeof cap);
  if (sv_v4l2_call(c, VIDIOC_QUERYCAP, &cap) < 0) return false;
  uint32_t can = cap.capabilities & V4L2_CAP_DEVICE_CAPS ? cap.device_caps : cap.capabilities;
  if (!(can & V4L2_CAP_STREAMING)) return false;
  c->is_mplane = !(can & V4L2_CAP_VIDEO_CAPTURE);
  c->buf_type = c->is_mplane ? V4L2_BUF_TYPE_VIDEO_CAPTURE_MPLANE : V4L2_BUF_TYPE_VIDEO_CAPTURE;
  memcpy(c->card, cap.card, sizeof c->card);
  memcpy(c->bus, cap.bus_info, sizeof c->bus);
  c->card[31] = c->bus[31] = 0;
  c->n_planes = 1;
  return (can & (V4L2_CAP_VIDEO_CAPTURE | V4L2_CAP_VIDEO_CAPTURE_MPLANE)) != 0;
}

int sv_v4l2_list(sv_str *out, const sv_v4l2_sys *sys) {
  int n = 0;
  for (int i = 0; i < CAP_NODES; i++) {
    char modes[3072];
    static const sv_v4l2_camera none;
    sv_v4l2_camera c = none;
    c.sys = sys;
    sv_fmt(c.path, sizeof c.path, "/dev/video%d", i);
    c.fd = sys->open(sys->self, c.path);
    if (c.fd < 0) continue;
    sv_str s = sv_str_make(modes, sizeof modes);
    if (look(&c) && add_modes(&s, &c)) {
      sv_str_add(out, "v4l2:%-12s  %s (%s) %s\n", c.path, c.card, c.bus, modes);
      n++;
    }
    sys->close(sys->self, c.fd);
  }
  return n;
}
