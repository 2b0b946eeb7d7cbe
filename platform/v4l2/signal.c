// SPDX-License-Identifier: Apache-2.0
// Inputs with a signal of their own (HDMI receivers): its timings set the size of the frames, and
// it can change or go at any time; the driver tells by an event.
#include <errno.h>
#include <linux/videodev2.h>

#include "platform/linux/linux.h"
#include "platform/v4l2/camera.h"

static bool has_timings(const sv_v4l2_camera *c) {
  int index;
  if (sv_v4l2_call(c, VIDIOC_G_INPUT, &index) < 0) return false;
  struct v4l2_input in = {.index = (uint32_t)index};
  return sv_v4l2_call(c, VIDIOC_ENUMINPUT, &in) >= 0 && (in.capabilities & V4L2_IN_CAP_DV_TIMINGS);
}

static bool is_same(const struct v4l2_dv_timings *a, const struct v4l2_dv_timings *b) {
  return a->type == b->type && a->bt.width == b->bt.width && a->bt.height == b->bt.height &&
         a->bt.interlaced == b->bt.interlaced && a->bt.pixelclock == b->bt.pixelclock;
}

sv_status sv_v4l2_follow_signal(sv_v4l2_camera *c, sv_err *err) {
  struct v4l2_dv_timings there = {.type = 0}, set = {.type = 0};
  if (!has_timings(c)) return SV_OK;
  int r = sv_v4l2_call(c, VIDIOC_QUERY_DV_TIMINGS, &there);
  if (r == -ENOTTY || r == -ENODATA) return SV_OK; // not told: what is set holds
  if (r < 0)
    return sv_fail(err, SV_E_DEVICE, "%s: %s", c->path,
                   r == -ENOLINK  ? "there is no signal at its input"
                   : r == -ENOLCK ? "the signal at its input is not steady"
                   : r == -ERANGE ? "the signal at its input is beyond what it can take"
                                  : sv_linux_reason(-r));
  if (sv_v4l2_call(c, VIDIOC_G_DV_TIMINGS, &set) >= 0 && is_same(&there, &set)) return SV_OK;
  r = sv_v4l2_call(c, VIDIOC_S_DV_TIMINGS, &there);
  return r < 0 ? sv_fail(err, SV_E_DEVICE, "%s: does not take the timings of its own signal: %s", c->path,
                         sv_linux_reason(-r))
               : SV_OK;
}

// Drivers without events refuse; then a change shows as frames of a wrong size, or as silence.
void sv_v4l2_want_events(sv_v4l2_camera *c) {
  struct v4l2_event_subscription sub = {.type = V4L2_EVENT_SOURCE_CHANGE};
  (void)sv_v4l2_call(c, VIDIOC_SUBSCRIBE_EVENT, &sub);
}

// 0: all as agreed on; else an error number, and the size that is there now, or 0.
static int look(const sv_v4l2_camera *c, int64_t *size) {
  struct v4l2_dv_timings there = {.type = 0}, set = {.type = 0};
  sv_v4l2_fmt f;
  *size = 0;
  if (has_timings(c)) {
    int r = sv_v4l2_call(c, VIDIOC_QUERY_DV_TIMINGS, &there);
    if (r < 0 && r != -ENOTTY && r != -ENODATA) return r;
    if (r >= 0 && sv_v4l2_call(c, VIDIOC_G_DV_TIMINGS, &set) >= 0 && !is_same(&there, &set)) {
      *size = (int64_t)there.bt.width << 16 | there.bt.height;
      return -ESTALE;
    }
  }
  if (sv_v4l2_get_fmt(c, &f) < 0) return 0; // the stream itself will tell
  if (f.fourcc == c->fourcc && f.width_px == (uint32_t)c->caps.width_px &&
      f.height_px == (uint32_t)c->caps.height_px)
    return 0;
  *size = (int64_t)f.width_px << 16 | f.height_px;
  return -ESTALE;
}

void sv_v4l2_take_events(sv_v4l2_camera *c, sv_ns now_ns) {
  struct v4l2_event e = {.type = 0};
  bool is_changed = false;
  for (int i = 0; i < 16 && sv_v4l2_call(c, VIDIOC_DQEVENT, &e) >= 0; i++)
    is_changed = is_changed || e.type == V4L2_EVENT_SOURCE_CHANGE;
  int64_t size;
  int r = is_changed ? look(c, &size) : 0;
  if (r >= 0) return;
  sv_camera_events_add(c->events, SV_CAMERA_SIGNAL, c->i_camera, now_ns, size);
  sv_v4l2_fault(c, r, now_ns);
}
