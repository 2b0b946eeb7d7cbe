// SPDX-License-Identifier: Apache-2.0
// Locks exposure, gain and white balance while the cameras run: a changing shutter moves the middle
// of the exposure, and a changing gain changes a surface's color from one exposure to the next.
#include <errno.h>
#include <linux/videodev2.h>
#include <math.h>
#include <string.h>

#include "platform/v4l2/camera.h"

#define EXPOSURE_UNIT_NS (100 * SV_NS_PER_US) // of V4L2_CID_EXPOSURE_ABSOLUTE

// The automatic controls, and what switches them off.
static const struct {
  uint32_t id;
  int32_t manual;
} autos[] = {
    {V4L2_CID_EXPOSURE_AUTO, V4L2_EXPOSURE_MANUAL},
    {V4L2_CID_EXPOSURE_AUTO_PRIORITY, 0}, // otherwise the frame rate follows the brightness
    {V4L2_CID_AUTOGAIN, 0},
    {V4L2_CID_AUTO_WHITE_BALANCE, 0},
    {V4L2_CID_FOCUS_AUTO, 0},
    {V4L2_CID_HUE_AUTO, 0},
};
#define N_AUTOS ((int)(sizeof autos / sizeof *autos))

static bool has(const sv_v4l2_camera *c, uint32_t id, struct v4l2_queryctrl *q) {
  *q = (struct v4l2_queryctrl){.id = id};
  return sv_v4l2_call(c, VIDIOC_QUERYCTRL, q) >= 0 && !(q->flags & V4L2_CTRL_FLAG_DISABLED);
}

static bool get(const sv_v4l2_camera *c, uint32_t id, int32_t *value) {
  struct v4l2_control v = {.id = id};
  if (sv_v4l2_call(c, VIDIOC_G_CTRL, &v) < 0) return false;
  *value = v.value;
  return true;
}

static int set(const sv_v4l2_camera *c, uint32_t id, int32_t value) {
  struct v4l2_control v = {.id = id, .value = value};
  return sv_v4l2_call(c, VIDIOC_S_CTRL, &v);
}

static uint32_t gain_id(const sv_v4l2_camera *c) {
  struct v4l2_queryctrl q;
  return has(c, V4L2_CID_GAIN, &q)            ? V4L2_CID_GAIN
         : has(c, V4L2_CID_ANALOGUE_GAIN, &q) ? V4L2_CID_ANALOGUE_GAIN
                                              : 0;
}

bool sv_v4l2_has_auto(const sv_v4l2_camera *c) {
  struct v4l2_queryctrl q;
  int32_t v;
  for (int i = 0; i < N_AUTOS; i++)
    if (autos[i].id != V4L2_CID_EXPOSURE_AUTO_PRIORITY && has(c, autos[i].id, &q) &&
        get(c, autos[i].id, &v) && v != autos[i].manual)
      return true;
  return false;
}

static sv_v4l2_control *noted(sv_v4l2_camera *c, uint32_t id) {
  for (int i = 0; i < c->n_controls; i++)
    if (c->control[i].id == id) return &c->control[i];
  if (c->n_controls == SV_V4L2_CAP_CONTROLS) return NULL;
  sv_v4l2_control *k = &c->control[c->n_controls];
  *k = (sv_v4l2_control){.id = id};
  if (!get(c, id, &k->before)) return NULL;
  c->n_controls++;
  return k;
}

static void hold(sv_v4l2_camera *c, uint32_t id, int32_t value, sv_ns now_ns) {
  struct v4l2_queryctrl q;
  int32_t got;
  if (!has(c, id, &q)) return;
  sv_v4l2_control *k = noted(c, id);
  if (!k) return;
  k->locked = value;
  k->is_changed = true;
  int r = set(c, id, value);
  if (r < 0 || !get(c, id, &got) || got != value)
    sv_camera_events_add(c->events, SV_CAMERA_CONTROL, c->i_camera, now_ns, (int64_t)id);
}

// The given value, else the one found by the automatic control; the same again after a fault.
static void hold_value(sv_v4l2_camera *c, uint32_t id, bool is_given, int32_t value, sv_ns now_ns) {
  struct v4l2_queryctrl q;
  if (!id || !has(c, id, &q)) return;
  sv_v4l2_control *k = noted(c, id);
  if (!k) return;
  if (k->is_changed) value = k->locked;
  else if (!is_given && !get(c, id, &value)) return;
  hold(c, id, value, now_ns);
}

static int32_t clamped(const sv_v4l2_camera *c, uint32_t id, double v) {
  struct v4l2_queryctrl q;
  if (!has(c, id, &q)) return 0;
  v = v < q.minimum ? q.minimum : v > q.maximum ? q.maximum : v;
  return (int32_t)(v + (v < 0 ? -0.5 : 0.5));
}

void sv_v4l2_lock_controls(sv_v4l2_camera *c, sv_ns now_ns) {
  const sv_camera_options *o = c->cfg;
  int32_t v;
  uint32_t gain = gain_id(c);
  for (int i = 0; i < N_AUTOS; i++) hold(c, autos[i].id, autos[i].manual, now_ns);
  hold_value(c, V4L2_CID_EXPOSURE_ABSOLUTE, o->exposure_ns > 0,
             clamped(c, V4L2_CID_EXPOSURE_ABSOLUTE, (double)o->exposure_ns / EXPOSURE_UNIT_NS), now_ns);
  hold_value(c, V4L2_CID_EXPOSURE, false, 0, now_ns);
  if (gain) hold_value(c, gain, o->gain >= 0, clamped(c, gain, o->gain), now_ns);
  hold_value(c, V4L2_CID_WHITE_BALANCE_TEMPERATURE, o->white_k > 0,
             clamped(c, V4L2_CID_WHITE_BALANCE_TEMPERATURE, o->white_k), now_ns);
  for (int i = 0; i < c->n_controls; i++) // lock=shared has set them
    if (c->control[i].id == V4L2_CID_RED_BALANCE || c->control[i].id == V4L2_CID_BLUE_BALANCE)
      hold(c, c->control[i].id, c->control[i].locked, now_ns);
  c->exposure_ns = get(c, V4L2_CID_EXPOSURE_ABSOLUTE, &v) && v > 0 ? v * EXPOSURE_UNIT_NS : 0;
  c->is_locked = true;
}

// What decides how bright and in which colors a camera shows light; gains besides.
static const uint32_t lights[] = {V4L2_CID_EXPOSURE_ABSOLUTE, V4L2_CID_EXPOSURE,
                                  V4L2_CID_WHITE_BALANCE_TEMPERATURE, V4L2_CID_RED_BALANCE,
                                  V4L2_CID_BLUE_BALANCE};

void sv_v4l2_share_controls(sv_v4l2_camera *c, const sv_v4l2_camera *from, sv_ns now_ns) {
  const double share =
      sv_camera_exposure_share(c->cfg, c->i_camera) / sv_camera_exposure_share(c->cfg, from->i_camera);
  int32_t v;
  for (size_t i = 0; i < sizeof lights / sizeof *lights; i++)
    if (get(from, lights[i], &v)) {
      if (lights[i] == V4L2_CID_EXPOSURE_ABSOLUTE) v = clamped(c, lights[i], share * v);
      hold(c, lights[i], v, now_ns);
    }
  if (gain_id(from) && get(from, gain_id(from), &v)) hold(c, gain_id(c), v, now_ns);
  c->exposure_ns = get(c, V4L2_CID_EXPOSURE_ABSOLUTE, &v) && v > 0 ? v * EXPOSURE_UNIT_NS : 0;
}

sv_status sv_v4l2_check_shared(const sv_v4l2_camera *c, const sv_v4l2_camera *from, sv_err *err) {
  struct v4l2_queryctrl a, b;
  for (size_t i = 0; i < sizeof lights / sizeof *lights; i++)
    if (has(from, lights[i], &a) && !has(c, lights[i], &b))
      return sv_fail(
          err, SV_E_UNSUPPORTED,
          "%s has no control \"%s\", which lock=shared would set to the value of %s; expected cameras "
          "of one kind, or lock=on",
          c->path, (const char *)a.name, from->path);
  if (!gain_id(from)) return SV_OK;
  const bool has_gain = has(from, gain_id(from), &a) && gain_id(c) && has(c, gain_id(c), &b);
  if (!has_gain || a.minimum != b.minimum || a.maximum != b.maximum)
    return sv_fail(err, SV_E_UNSUPPORTED,
                   "%s counts its gain in other units than %s, so that lock=shared cannot set it; expected "
                   "cameras of one kind, or lock=on",
                   c->path, from->path);
  return SV_OK;
}

void sv_v4l2_restore_controls(sv_v4l2_camera *c) {
  // Values first: they cannot be written while the automatic control is on.
  for (int i = c->n_controls - 1; i >= 0; i--)
    if (c->control[i].is_changed && c->fd >= 0) (void)set(c, c->control[i].id, c->control[i].before);
  c->n_controls = 0;
  c->is_locked = false;
}

// "Trigger Mode" -> "trigger_mode", as v4l2-ctl prints it.
static bool is_named(const char *control, const char *name) {
  for (; *control; control++) {
    char c = *control;
    if (c >= 'A' && c <= 'Z') c = (char)(c - 'A' + 'a');
    const bool is_word = (c >= 'a' && c <= 'z') || (c >= '0' && c <= '9');
    if (!is_word) continue;
    if (*name == '_') name++; // stands for all that is no letter and no digit
    if (*name++ != c) return false;
  }
  return !*name;
}

int sv_v4l2_set_trigger_mode(sv_v4l2_camera *c) {
  const sv_trigger *line = c->cfg->trigger.line;
  struct v4l2_queryctrl q = {.id = V4L2_CTRL_FLAG_NEXT_CTRL};
  sv_trigger_mode m;
  if (!line || !sv_trigger_parse_mode(line->mode, strlen(line->mode), &m) || m.module[0]) return 0;
  for (; sv_v4l2_call(c, VIDIOC_QUERYCTRL, &q) >= 0; q.id |= V4L2_CTRL_FLAG_NEXT_CTRL) {
    if ((q.flags & V4L2_CTRL_FLAG_DISABLED) || !is_named((const char *)q.name, m.name)) continue;
    sv_v4l2_control *k = noted(c, q.id);
    int32_t got;
    int r = set(c, q.id, m.value);
    if (r < 0) return r;
    if (!get(c, q.id, &got) || got != m.value) return -ERANGE;
    if (k) k->is_changed = true;
    if (k) k->locked = m.value;
    return 0;
  }
  return -ENOENT;
}

sv_status sv_v4l2_check_controls(const sv_v4l2_camera *c, sv_err *err) {
  struct v4l2_queryctrl q;
  const sv_camera_options *o = c->cfg;
  if ((o->exposure_ns > 0 || o->n_brackets) && !has(c, V4L2_CID_EXPOSURE_ABSOLUTE, &q))
    return sv_fail(err, SV_E_UNSUPPORTED, "%s: its exposure time cannot be set (%s=)", c->path,
                   o->n_brackets ? "brackets" : "exposure");
  if (o->gain >= 0 && !gain_id(c))
    return sv_fail(err, SV_E_UNSUPPORTED, "%s: its gain cannot be set (gain=)", c->path);
  if (o->white_k > 0 && !has(c, V4L2_CID_WHITE_BALANCE_TEMPERATURE, &q))
    return sv_fail(err, SV_E_UNSUPPORTED, "%s: its colour temperature cannot be set (wb=)", c->path);
  return SV_OK;
}

int64_t sv_v4l2_exposure_id(void) { return V4L2_CID_EXPOSURE_ABSOLUTE; }

sv_ns sv_v4l2_possible_exposure(const sv_v4l2_camera *c, sv_ns ns) {
  return clamped(c, V4L2_CID_EXPOSURE_ABSOLUTE, (double)ns / EXPOSURE_UNIT_NS) * EXPOSURE_UNIT_NS;
}

sv_status sv_v4l2_set_exposure(sv_v4l2_camera *c, int64_t ns, int64_t *actual_ns) {
  struct v4l2_queryctrl q;
  int32_t v;
  if (c->fd < 0) return SV_E_DEVICE;
  if (!has(c, V4L2_CID_EXPOSURE_ABSOLUTE, &q)) return SV_E_UNSUPPORTED;
  double want = (double)ns / (double)EXPOSURE_UNIT_NS;
  if (want < q.minimum || want > q.maximum) return SV_E_RANGE;
  sv_v4l2_control *k = noted(c, V4L2_CID_EXPOSURE_ABSOLUTE);
  if (set(c, V4L2_CID_EXPOSURE_ABSOLUTE, (int32_t)(want + 0.5)) < 0 ||
      !get(c, V4L2_CID_EXPOSURE_ABSOLUTE, &v))
    return SV_E_DEVICE;
  if (k) {
    k->is_changed = true;
    k->locked = v;
  }
  c->exposure_ns = v * EXPOSURE_UNIT_NS;
  if (actual_ns) *actual_ns = c->exposure_ns;
  return SV_OK;
}

// --- frame length --------------------------------------------------------------------------------
// of the frame rate told: else the sensor's mode is another one than the frames' size
#define MAX_OFF 0.02

static bool pixel_rate(const sv_v4l2_camera *c, double *hz) {
  struct v4l2_ext_control x = {.id = V4L2_CID_PIXEL_RATE};
  struct v4l2_ext_controls xs = {.which = V4L2_CTRL_WHICH_CUR_VAL, .count = 1, .controls = &x};
  if (sv_v4l2_call(c, VIDIOC_G_EXT_CTRLS, &xs) < 0 || x.value64 <= 0) return false;
  *hz = (double)x.value64;
  return true;
}

// A sensor reads lines of (width + hblank) pixels, (height + vblank) of them a frame. Where the
// driver shows these controls beside the pictures, vblank sets the length of a frame to a line's
// time.
static sv_status set_lines(sv_v4l2_camera *c, int64_t ns, int64_t *actual_ns) {
  struct v4l2_queryctrl q;
  int32_t hblank, vblank;
  double hz;
  if (!has(c, V4L2_CID_VBLANK, &q) || (q.flags & V4L2_CTRL_FLAG_READ_ONLY) ||
      !get(c, V4L2_CID_HBLANK, &hblank) || !get(c, V4L2_CID_VBLANK, &vblank) || !pixel_rate(c, &hz))
    return SV_E_UNSUPPORTED;
  sv_v4l2_control *k = noted(c, V4L2_CID_VBLANK);
  if (k) vblank = k->before; // that of the rate told
  double line_ns = (c->caps.width_px + hblank) * 1e9 / hz, was_ns = line_ns * (c->caps.height_px + vblank);
  double told_ns = c->caps.fps > 0 ? 1e9 / c->caps.fps : was_ns;
  if (!(line_ns > 0) || was_ns < (1 - MAX_OFF) * told_ns || was_ns > (1 + MAX_OFF) * told_ns)
    return SV_E_UNSUPPORTED;
  double lines = (double)ns / line_ns - c->caps.height_px;
  if (lines < q.minimum - 0.5 || lines > q.maximum + 0.5) return SV_E_RANGE;
  if (set(c, V4L2_CID_VBLANK, (int32_t)(lines + 0.5)) < 0 || !get(c, V4L2_CID_VBLANK, &vblank))
    return SV_E_DEVICE;
  if (k) {
    k->is_changed = true;
    k->locked = vblank;
  }
  if (actual_ns) *actual_ns = (int64_t)(line_ns * (c->caps.height_px + vblank) + 0.5);
  return SV_OK;
}

sv_ns sv_v4l2_readout_ns(const sv_v4l2_camera *c) {
  int32_t hblank;
  double hz;
  if (!get(c, V4L2_CID_HBLANK, &hblank) || !pixel_rate(c, &hz)) return 0;
  const double ns = (c->caps.width_px + hblank) * 1e9 / hz * c->caps.height_px;
  // Longer than a frame: the controls are of another mode than the frames.
  return ns > 0 && (!(c->caps.fps > 0) || ns <= (1 + MAX_OFF) * 1e9 / c->caps.fps) ? (sv_ns)(ns + 0.5) : 0;
}

static int set_interval(sv_v4l2_camera *c, struct v4l2_fract t, double *ns) {
  struct v4l2_streamparm p = {.type = c->buf_type};
  p.parm.capture.timeperframe = t;
  int r = sv_v4l2_call(c, VIDIOC_S_PARM, &p);
  t = p.parm.capture.timeperframe;
  *ns = t.denominator ? (double)t.numerator * 1e9 / t.denominator : 0;
  return r;
}

sv_status sv_v4l2_set_frame_duration(sv_v4l2_camera *c, int64_t ns, int64_t *actual_ns) {
  struct v4l2_streamparm p = {.type = c->buf_type};
  double took_ns;
  if (c->fd < 0) return SV_E_DEVICE;
  if (ns < 1 || ns > 4 * SV_NS_PER_S) return SV_E_RANGE;
  sv_status s = set_lines(c, ns, actual_ns);
  if (s != SV_E_UNSUPPORTED) return s;
  // Most cameras refuse this while they run, and many know only a few rates: then things stay as
  // they are.
  if (sv_v4l2_call(c, VIDIOC_G_PARM, &p) < 0 || !(p.parm.capture.capability & V4L2_CAP_TIMEPERFRAME))
    return SV_E_UNSUPPORTED;
  struct v4l2_fract was = p.parm.capture.timeperframe;
  if (set_interval(c, (struct v4l2_fract){(uint32_t)ns, 1000000000}, &took_ns) < 0) return SV_E_UNSUPPORTED;
  double was_ns = was.denominator ? (double)was.numerator * 1e9 / was.denominator : 0;
  // nearer to another of its rates
  if (fabs(took_ns - (double)ns) > 0.25 * fabs((double)ns - was_ns)) {
    (void)set_interval(c, was, &took_ns);
    return SV_E_UNSUPPORTED;
  }
  if (actual_ns) *actual_ns = (int64_t)(took_ns + 0.5);
  return SV_OK;
}
