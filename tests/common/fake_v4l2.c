// SPDX-License-Identifier: Apache-2.0
#include "tests/common/fake_v4l2.h"

#include <errno.h>
#include <linux/videodev2.h>
#include <stdio.h>
#include <string.h>

#include "platform/codec/codec.h"
#include "platform/v4l2/format.h"

#define FD_DEVICE 100
#define FD_EXPORT 1000

// --- the pictures --------------------------------------------------------------------------------
static void make_jpeg(fake_v4l2 *f, int i, int w, int h) {
  static _Alignas(64) uint8_t block[1 << 20];
  static uint8_t px[128 * 128 * 3];
  sv_arena a = sv_arena_make(block, sizeof block);
  sv_codec codec;
  sv_codec_cfg cfg = {128, 128, false};
  for (int k = 0; k < w * h * 3; k++) px[k] = (uint8_t)(40 + k / 3 % w * 2 + k % 3 * 20);
  sv_picture in = {w, h, (size_t)w * 3, SV_PIX_RGB8, px};
  if (sv_codec_init(&codec, &cfg, &a) < 0 ||
      sv_codec_encode_jpeg(&codec, &in, (sv_jpeg_options){90, true},
                           (sv_codec_buffer){f->jpeg[i], sizeof f->jpeg[i]}, &f->jpeg_bytes[i], NULL) < 0)
    f->jpeg_bytes[i] = 0;
  sv_codec_close(&codec);
}

static uint8_t mark(int i, uint32_t sequence) {
  return (uint8_t)(1 + (sequence * 7 + (uint32_t)i * 31) % 254);
}

sv_ns fake_v4l2_exposure_ns(const fake_device *d, uint32_t sequence) {
  const uint32_t back = sequence < (uint32_t)d->n_delay ? sequence : (uint32_t)d->n_delay;
  return d->exposure[(sequence - back) % 64] * 100 * SV_NS_PER_US;
}

bool fake_v4l2_is_frame(const uint8_t *data, int i, uint32_t sequence) {
  for (int k = 0; k < FAKE_V4L2_WIDTH_PX * FAKE_V4L2_HEIGHT_PX; k++)
    if (data[k] != mark(i, sequence)) return false;
  return true;
}

static size_t image_bytes(const fake_device *d) {
  int i = sv_v4l2_format_index(d->fourcc);
  size_t n = i < 0 ? 0 : sv_pixel_frame_bytes(sv_v4l2_formats[i].format, d->width_px, d->height_px);
  return n ? n : sizeof((fake_v4l2 *)0)->jpeg[0];
}

static sv_ns period_ns(const fake_device *d) { return d->interval_ns ? d->interval_ns : FAKE_V4L2_PERIOD_NS; }

static void fill(fake_v4l2 *f, fake_device *d, fake_buffer *b) {
  int i = (int)(d - f->device);
  uint8_t *p = f->page[b->i_page[0]];
  b->flags = d->is_flagged ? V4L2_BUF_FLAG_ERROR : 0;
  b->bytes = (uint32_t)image_bytes(d);
  if (d->fourcc == V4L2_PIX_FMT_MJPEG) {
    b->bytes = (uint32_t)f->jpeg_bytes[d->is_wrong_jpeg];
    memcpy(p, f->jpeg[d->is_wrong_jpeg], b->bytes);
  } else memset(p, mark(i, d->sequence), b->bytes);
  if (d->fourcc == V4L2_PIX_FMT_NV12M) memset(f->page[b->i_page[1]], mark(i, d->sequence), b->bytes / 2);
  if (d->is_short) b->bytes /= 2;
}

// Frames that were due until now.
static void advance(fake_v4l2 *f) {
  for (int i = 0; i < f->n_devices; i++) {
    fake_device *d = &f->device[i];
    while (d->is_streaming && d->next_ns <= f->now_ns) {
      fake_buffer *free_ = NULL;
      for (int k = 0; k < d->n_buffers && !free_; k++)
        if (d->buffer[k].is_queued && !d->buffer[k].is_done) free_ = &d->buffer[k];
      if (!d->is_silent && !d->is_unplugged && !d->is_fatal) {
        if (free_) {
          free_->is_done = true;
          free_->sequence = d->has_frozen_sequence ? 0 : d->sequence;
          free_->stamp_ns = d->next_ns - 5 * SV_NS_PER_MS;
          fill(f, d, free_);
        }
        d->exposure[d->sequence % 64] = d->control[1];
        d->sequence++;
      }
      d->next_ns += period_ns(d);
    }
  }
}

static fake_buffer *oldest_done(fake_device *d) {
  fake_buffer *best = NULL;
  for (int k = 0; k < d->n_buffers; k++)
    if (d->buffer[k].is_done && (!best || d->buffer[k].stamp_ns < best->stamp_ns)) best = &d->buffer[k];
  return best;
}

// --- faults on demand ----------------------------------------------------------------------------
// Calls of device 0 (and those without a device) are counted; fails the at-th.
static bool must_fail(fake_v4l2 *f, int i_device) {
  if (i_device > 0) return false;
  f->n_calls++;
  if (!f->fail_at || (f->is_lasting ? f->n_calls < f->fail_at : f->n_calls != f->fail_at)) return false;
  f->was_hit = true;
  return true;
}

// --- controls ------------------------------------------------------------------------------------
static const struct v4l2_queryctrl controls[FAKE_V4L2_N_CONTROLS] = {
    {.id = V4L2_CID_EXPOSURE_AUTO, .maximum = 3, .default_value = 3},
    {.id = V4L2_CID_EXPOSURE_ABSOLUTE, .minimum = 1, .maximum = 5000, .default_value = 157},
    {.id = V4L2_CID_GAIN, .maximum = 255, .default_value = 64},
    {.id = V4L2_CID_AUTO_WHITE_BALANCE, .maximum = 1, .default_value = 1},
    {.id = V4L2_CID_WHITE_BALANCE_TEMPERATURE, .minimum = 2800, .maximum = 6500, .default_value = 4600},
    {.id = V4L2_CID_HBLANK, .minimum = 56, .maximum = 56, .default_value = 56},
    {.id = V4L2_CID_VBLANK, .minimum = 4, .maximum = 4000, .default_value = 52},
    {.id = 0x009f0901, .name = "Trigger Mode", .maximum = 2},
};
#define I_HBLANK   5
#define I_VBLANK   6
#define I_TRIGGER  7
#define PIXEL_RATE ((64 + 56) * (48 + 52) * 25) // 400 us a line

static int control_index(const fake_device *d, uint32_t id) {
  for (int i = 0; d->has_controls && i < FAKE_V4L2_N_CONTROLS; i++)
    if (controls[i].id == id)
      return (i == I_TRIGGER ? !d->has_trigger : i >= I_HBLANK && !d->has_blanking) ? -1 : i;
  return -1;
}

// The one with the next larger number.
static int next_control(const fake_device *d, uint32_t after) {
  int best = -1;
  for (int i = 0; i < FAKE_V4L2_N_CONTROLS; i++)
    if (control_index(d, controls[i].id) >= 0 && controls[i].id > after &&
        (best < 0 || controls[i].id < controls[best].id))
      best = i;
  return best;
}

static int do_control(fake_device *d, unsigned long request, void *arg) {
  struct v4l2_control *c = arg;
  if (request == VIDIOC_QUERYCTRL) {
    const uint32_t id = ((struct v4l2_queryctrl *)arg)->id;
    int i = control_index(d, id);
    if (id & V4L2_CTRL_FLAG_NEXT_CTRL) i = next_control(d, id & ~V4L2_CTRL_FLAG_NEXT_CTRL);
    if (i < 0) return -EINVAL;
    *(struct v4l2_queryctrl *)arg = controls[i];
    return 0;
  }
  int i = control_index(d, c->id);
  if (i < 0) return -EINVAL;
  if (request == VIDIOC_S_CTRL) {
    if (c->value < controls[i].minimum || c->value > controls[i].maximum) return -ERANGE;
    d->control[i] = c->value;
    if (i == I_VBLANK) d->interval_ns = (48 + c->value) * 400 * SV_NS_PER_US;
  }
  c->value = d->control[i];
  return 0;
}

static void reset_device(fake_device *d) {
  d->fourcc = V4L2_PIX_FMT_YUYV;
  d->width_px = FAKE_V4L2_WIDTH_PX;
  d->height_px = FAKE_V4L2_HEIGHT_PX;
  d->interval_ns = 0;
  for (int i = 0; i < FAKE_V4L2_N_CONTROLS; i++) d->control[i] = controls[i].default_value;
}

// --- formats and buffers -------------------------------------------------------------------------
static int do_format(fake_device *d, unsigned long request, struct v4l2_format *f) {
  bool is_get = request == VIDIOC_G_FMT;
  uint32_t fourcc = is_get ? d->fourcc : d->is_mplane ? f->fmt.pix_mp.pixelformat : f->fmt.pix.pixelformat;
  fake_device wanted = *d;
  if (sv_v4l2_format_index(fourcc) < 0 || fourcc == V4L2_PIX_FMT_JPEG ||
      (fourcc == V4L2_PIX_FMT_NV12M && !d->is_mplane))
    fourcc = V4L2_PIX_FMT_YUYV;
  wanted.fourcc = fourcc;
  if (!is_get && d->is_other_size) wanted.width_px = FAKE_V4L2_WIDTH_PX / 2;
  if (request == VIDIOC_S_FMT) {
    if (d->n_buffers || d->is_busy) return -EBUSY;
    d->fourcc = wanted.fourcc;
    d->width_px = wanted.width_px;
  }
  uint32_t bytes = (uint32_t)image_bytes(&wanted), w = (uint32_t)wanted.width_px,
           h = (uint32_t)wanted.height_px;
  uint32_t row = (uint32_t)sv_pixel_row_bytes(sv_v4l2_formats[sv_v4l2_format_index(fourcc)].format, (int)w);
  if (d->is_mplane) {
    f->fmt.pix_mp =
        (struct v4l2_pix_format_mplane){.width = w, .height = h, .pixelformat = fourcc, .num_planes = 1};
    f->fmt.pix_mp.num_planes = (uint8_t)sv_v4l2_format_planes(fourcc);
    for (int p = 0; p < f->fmt.pix_mp.num_planes; p++) {
      f->fmt.pix_mp.plane_fmt[p].bytesperline = row;
      f->fmt.pix_mp.plane_fmt[p].sizeimage = p ? bytes / 2 : bytes;
    }
  } else
    f->fmt.pix = (struct v4l2_pix_format){
        .width = w, .height = h, .pixelformat = fourcc, .bytesperline = row, .sizeimage = bytes};
  return 0;
}

static int do_reqbufs(fake_device *d, struct v4l2_requestbuffers *r) {
  if (r->count && d->is_busy) return -EBUSY;
  memset(d->buffer, 0, sizeof d->buffer);
  for (int k = 0; k < FAKE_V4L2_CAP_BUFFERS; k++) d->buffer[k].i_page[0] = d->buffer[k].i_page[1] = -1;
  d->n_buffers = (int)(r->count < FAKE_V4L2_CAP_BUFFERS ? r->count : FAKE_V4L2_CAP_BUFFERS);
  return 0;
}

static void put_buffer(const fake_v4l2 *f, const fake_device *d, uint32_t i, struct v4l2_buffer *b) {
  const fake_buffer *k = &d->buffer[i];
  b->index = i;
  b->sequence = k->sequence;
  b->flags = k->flags | V4L2_BUF_FLAG_TIMESTAMP_MONOTONIC | V4L2_BUF_FLAG_TSTAMP_SRC_SOE;
  b->timestamp.tv_sec = k->stamp_ns / SV_NS_PER_S;
  b->timestamp.tv_usec = k->stamp_ns % SV_NS_PER_S / SV_NS_PER_US;
  uint32_t offset = (uint32_t)(d - f->device) * 4096 * 64 + i * 4096;
  if (d->is_mplane) {
    for (uint32_t p = 0; p < sv_v4l2_format_planes(d->fourcc); p++) {
      b->m.planes[p].length = FAKE_V4L2_PAGE_BYTES;
      b->m.planes[p].m.mem_offset = offset + p * FAKE_V4L2_CAP_BUFFERS * 4096;
      b->m.planes[p].bytesused = p ? k->bytes / (d->has_short_chroma ? 4 : 2) : k->bytes;
    }
  } else {
    b->length = FAKE_V4L2_PAGE_BYTES;
    b->m.offset = offset;
    b->bytesused = k->bytes;
  }
}

static int do_buffer(fake_v4l2 *f, fake_device *d, unsigned long request, struct v4l2_buffer *b) {
  if (request == VIDIOC_DQBUF) {
    if (d->is_fatal) return -EIO;
    if (!d->is_streaming) return -EINVAL;
    fake_buffer *k = oldest_done(d);
    if (!k) return -EAGAIN;
    k->is_done = k->is_queued = false;
    k->is_dequeued = true;
    put_buffer(f, d, (uint32_t)(k - d->buffer), b);
    return 0;
  }
  if (b->index >= (uint32_t)d->n_buffers) return -EINVAL;
  if (d->is_mplane && b->length < sv_v4l2_format_planes(d->fourcc)) return -EINVAL;
  if (request == VIDIOC_QBUF) {
    fake_buffer *k = &d->buffer[b->index];
    if (k->is_queued) return -EINVAL;
    k->is_queued = true;
    k->is_dequeued = k->is_done = false;
    return 0;
  }
  put_buffer(f, d, b->index, b);
  return 0;
}

static int do_stream(fake_v4l2 *f, fake_device *d, bool is_on) {
  if (is_on && d->is_streamon_failing) return -EIO;
  d->is_streaming = is_on;
  if (is_on) {
    d->sequence = 0;
    d->n_streamons++;
    d->next_ns = f->now_ns + period_ns(d) + (d - f->device) * SV_NS_PER_MS;
    return 0;
  }
  d->is_fatal = false;
  for (int k = 0; k < d->n_buffers; k++)
    d->buffer[k].is_queued = d->buffer[k].is_done = d->buffer[k].is_dequeued = false;
  return 0;
}

static int do_interval(const fake_device *d, struct v4l2_frmivalenum *e) {
  if (e->index) return -EINVAL;
  double fps = d->max_fps_raw > 0 && e->pixel_format != V4L2_PIX_FMT_MJPEG ? d->max_fps_raw : 25;
  e->type = V4L2_FRMIVAL_TYPE_DISCRETE;
  e->discrete = (struct v4l2_fract){1000, (uint32_t)(fps * 1000)};
  return 0;
}

static int do_list(unsigned long request, void *arg) {
  static const uint32_t formats[] = {V4L2_PIX_FMT_YUYV, V4L2_PIX_FMT_GREY, V4L2_PIX_FMT_MJPEG};
  if (request == VIDIOC_ENUM_FMT) {
    struct v4l2_fmtdesc *d = arg;
    if (d->index > 2) return -EINVAL;
    d->pixelformat = formats[d->index];
    return 0;
  }
  struct v4l2_frmsizeenum *e = arg;
  if (e->index) return -EINVAL;
  e->type = V4L2_FRMSIZE_TYPE_DISCRETE;
  e->discrete = (struct v4l2_frmsize_discrete){FAKE_V4L2_WIDTH_PX, FAKE_V4L2_HEIGHT_PX};
  return 0;
}

static int do_selection(const fake_device *d, struct v4l2_selection *s) {
  if (!d->bounds_px[0] || s->type != V4L2_BUF_TYPE_VIDEO_CAPTURE) return -EINVAL;
  const uint32_t w = (uint32_t)d->width_px, h = (uint32_t)d->height_px;
  // The coordinates of a driver may begin anywhere.
  const struct v4l2_rect bounds = {-8, 16, (uint32_t)d->bounds_px[0], (uint32_t)d->bounds_px[1]};
  const struct v4l2_rect crop = {d->crop_px[0] - 8, d->crop_px[1] + 16, (uint32_t)d->crop_px[2],
                                 (uint32_t)d->crop_px[3]};
  s->r = s->target == V4L2_SEL_TGT_CROP          ? crop
         : s->target == V4L2_SEL_TGT_CROP_BOUNDS ? bounds
                                                 : (struct v4l2_rect){0, 0, w, d->is_letterbox ? h / 2 : h};
  return 0;
}

static int do_capability(const fake_v4l2 *f, const fake_device *d, struct v4l2_capability *c) {
  memset(c, 0, sizeof *c);
  snprintf((char *)c->card, sizeof c->card, d->is_other_camera ? "another" : "fake camera");
  snprintf((char *)c->bus_info, sizeof c->bus_info, "fake:%d", (int)(d - f->device));
  c->device_caps =
      V4L2_CAP_STREAMING | (d->is_mplane ? V4L2_CAP_VIDEO_CAPTURE_MPLANE : V4L2_CAP_VIDEO_CAPTURE);
  c->capabilities = V4L2_CAP_DEVICE_CAPS | c->device_caps;
  return 0;
}

static int do_interval_now(fake_device *d, unsigned long request, struct v4l2_streamparm *p) {
  struct v4l2_captureparm *c = &p->parm.capture;
  if (request == VIDIOC_S_PARM) {
    if (d->is_streaming && !d->can_set_rate) return -EBUSY;
    sv_ns ns = (sv_ns)c->timeperframe.numerator * SV_NS_PER_S / c->timeperframe.denominator;
    d->interval_ns = d->is_coarse && ns != FAKE_V4L2_PERIOD_NS ? 2 * FAKE_V4L2_PERIOD_NS : ns;
  }
  c->capability = d->can_set_rate ? V4L2_CAP_TIMEPERFRAME : 0;
  c->timeperframe = (struct v4l2_fract){(uint32_t)period_ns(d), 1000000000};
  return 0;
}

static int do_pixel_rate(const fake_device *d, struct v4l2_ext_controls *x) {
  if (!d->has_blanking || x->count != 1 || x->controls[0].id != V4L2_CID_PIXEL_RATE) return -EINVAL;
  x->controls[0].value64 = PIXEL_RATE;
  return 0;
}

// --- a signal at its input -----------------------------------------------------------------------
static int do_signal(fake_device *d, unsigned long request, void *arg) {
  struct v4l2_dv_timings *t = arg;
  int width_px = d->signal_width_px ? d->signal_width_px : FAKE_V4L2_WIDTH_PX;
  if (request == VIDIOC_SUBSCRIBE_EVENT) {
    d->is_subscribed = true;
    return 0;
  }
  if (request == VIDIOC_DQEVENT) {
    if (!d->has_event) return -ENOENT;
    d->has_event = false;
    ((struct v4l2_event *)arg)->type = V4L2_EVENT_SOURCE_CHANGE;
    return 0;
  }
  if (request == VIDIOC_G_INPUT) {
    *(int *)arg = 0;
    return 0;
  }
  if (request == VIDIOC_ENUMINPUT) {
    ((struct v4l2_input *)arg)->capabilities = d->is_hdmi ? V4L2_IN_CAP_DV_TIMINGS : 0;
    return 0;
  }
  if (!d->is_hdmi) return -ENODATA;
  if (request == VIDIOC_QUERY_DV_TIMINGS && d->signal_errno) return -d->signal_errno;
  if (request == VIDIOC_S_DV_TIMINGS) {
    if (d->n_buffers) return -EBUSY;
    d->width_px = (int)t->bt.width;
    return 0;
  }
  memset(t, 0, sizeof *t);
  t->bt.width = (uint32_t)(request == VIDIOC_G_DV_TIMINGS ? d->width_px : width_px);
  t->bt.height = FAKE_V4L2_HEIGHT_PX;
  return 0;
}

void fake_v4l2_signal(fake_v4l2 *f, int i, int width_px, int error) {
  f->device[i].signal_width_px = width_px;
  f->device[i].signal_errno = error;
  f->device[i].has_event = f->device[i].is_subscribed;
}

// --- the table -----------------------------------------------------------------------------------
static int do_ioctl(fake_v4l2 *f, fake_device *d, unsigned long request, void *arg) {
  if (d->is_unplugged) return -ENODEV;
  switch (request) {
  case VIDIOC_QUERYCAP: return do_capability(f, d, arg);
  case VIDIOC_ENUM_FMT:
  case VIDIOC_ENUM_FRAMESIZES: return do_list(request, arg);
  case VIDIOC_G_SELECTION: return do_selection(d, arg);
  case VIDIOC_ENUM_FRAMEINTERVALS: return do_interval(d, arg);
  case VIDIOC_G_FMT:
  case VIDIOC_TRY_FMT:
  case VIDIOC_S_FMT: return do_format(d, request, arg);
  case VIDIOC_G_PARM:
  case VIDIOC_S_PARM: return do_interval_now(d, request, arg);
  case VIDIOC_G_EXT_CTRLS: return do_pixel_rate(d, arg);
  case VIDIOC_G_INPUT:
  case VIDIOC_ENUMINPUT:
  case VIDIOC_QUERY_DV_TIMINGS:
  case VIDIOC_G_DV_TIMINGS:
  case VIDIOC_S_DV_TIMINGS:
  case VIDIOC_SUBSCRIBE_EVENT:
  case VIDIOC_DQEVENT: return do_signal(d, request, arg);
  case VIDIOC_REQBUFS: return do_reqbufs(d, arg);
  case VIDIOC_QUERYBUF:
  case VIDIOC_QBUF:
  case VIDIOC_DQBUF: return do_buffer(f, d, request, arg);
  case VIDIOC_STREAMON: return do_stream(f, d, true);
  case VIDIOC_STREAMOFF: return do_stream(f, d, false);
  case VIDIOC_QUERYCTRL:
  case VIDIOC_G_CTRL:
  case VIDIOC_S_CTRL: return do_control(d, request, arg);
  case VIDIOC_EXPBUF:
    ((struct v4l2_exportbuffer *)arg)->fd = FD_EXPORT + d->n_exports++;
    f->n_exported++;
    return 0;
  default: return -ENOTTY;
  }
}

static int sys_open(void *self, const char *path) {
  fake_v4l2 *f = self;
  int i;
  if (sscanf(path, "/dev/video%d", &i) != 1 || i < 0 || i >= f->n_devices) return -ENOENT;
  if (must_fail(f, i)) return -f->fail_errno;
  if (f->device[i].is_unplugged) return -ENOENT;
  f->device[i].n_open++;
  return FD_DEVICE + i;
}

static int sys_close(void *self, int fd) {
  fake_v4l2 *f = self;
  if (fd >= FD_EXPORT) {
    f->n_exported--;
    return 0;
  }
  f->device[fd - FD_DEVICE].n_open--;
  return 0;
}

static int sys_ioctl(void *self, int fd, unsigned long request, void *arg) {
  fake_v4l2 *f = self;
  if (must_fail(f, fd - FD_DEVICE)) return -f->fail_errno;
  advance(f);
  return do_ioctl(f, &f->device[fd - FD_DEVICE], request, arg);
}

static void *sys_map(void *self, int fd, size_t bytes, int64_t offset) {
  fake_v4l2 *f = self;
  fake_device *d = &f->device[fd - FD_DEVICE];
  int k = (int)(offset / 4096 % 64), plane = k / FAKE_V4L2_CAP_BUFFERS;
  k %= FAKE_V4L2_CAP_BUFFERS;
  if (must_fail(f, fd - FD_DEVICE) || bytes > FAKE_V4L2_PAGE_BYTES || k >= d->n_buffers) return NULL;
  for (int i = 0; i < FAKE_V4L2_CAP_PAGES; i++)
    if (!f->page_state[i]) {
      f->page_state[i] = 1;
      d->buffer[k].i_page[plane] = i;
      return f->page[i];
    }
  return NULL;
}

static int page_of(const fake_v4l2 *f, const void *p) {
  return (int)(((const uint8_t *)p - f->page[0]) / FAKE_V4L2_PAGE_BYTES);
}

static int sys_unmap(void *self, void *p, size_t bytes) {
  fake_v4l2 *f = self;
  memset(p, 0, bytes < FAKE_V4L2_PAGE_BYTES ? bytes : FAKE_V4L2_PAGE_BYTES);
  f->page_state[page_of(f, p)] = 0;
  return 0;
}

static int sys_detach(void *self, void *p, size_t bytes) {
  fake_v4l2 *f = self;
  (void)bytes;
  if (must_fail(f, 0)) return -ENOMEM;
  f->page_state[page_of(f, p)] = 2;
  return 0;
}

static int sys_poll(void *self, struct pollfd *fds, int n, int timeout_ms) {
  fake_v4l2 *f = self;
  sv_ns end_ns = f->now_ns + timeout_ms * SV_NS_PER_MS;
  if (!f->is_lasting && must_fail(f, 0)) return -EINTR; // a signal; none lasts
  for (;;) {
    int n_ready = 0;
    advance(f);
    for (int i = 0; i < n; i++) {
      fake_device *d = &f->device[fds[i].fd - FD_DEVICE];
      fds[i].revents = 0;
      if (d->is_unplugged || d->is_fatal) fds[i].revents = POLLERR;
      else if (oldest_done(d)) fds[i].revents = POLLIN;
      if (d->has_event) fds[i].revents |= fds[i].events & POLLPRI;
      n_ready += fds[i].revents != 0;
    }
    if (n_ready || f->now_ns >= end_ns) return n_ready;
    f->now_ns += SV_NS_PER_MS < end_ns - f->now_ns ? SV_NS_PER_MS : end_ns - f->now_ns;
  }
}

sv_v4l2_sys fake_v4l2_sys(fake_v4l2 *f) {
  return (sv_v4l2_sys){f, sys_open, sys_close, sys_ioctl, sys_map, sys_unmap, sys_detach, sys_poll};
}

// --- clock and control ---------------------------------------------------------------------------
static sv_ns clock_now(void *self) { return ((fake_v4l2 *)self)->now_ns; }
static void clock_sleep(void *self, sv_ns host_ns) {
  fake_v4l2 *f = self;
  if (host_ns > f->now_ns) f->now_ns = host_ns;
}
sv_clock fake_v4l2_clock(fake_v4l2 *f) { return (sv_clock){f, clock_now, clock_sleep}; }

void fake_v4l2_init(fake_v4l2 *f, int n_devices) {
  memset(f, 0, offsetof(fake_v4l2, block));
  f->n_devices = n_devices;
  f->now_ns = 1000 * SV_NS_PER_S;
  f->fail_errno = EIO;
  for (int i = 0; i < n_devices; i++) {
    f->device[i].has_controls = true;
    reset_device(&f->device[i]);
  }
  make_jpeg(f, 0, FAKE_V4L2_WIDTH_PX, FAKE_V4L2_HEIGHT_PX);
  make_jpeg(f, 1, 32, 32);
}

int fake_v4l2_n_open(const fake_v4l2 *f) {
  int n = f->n_exported;
  for (int i = 0; i < f->n_devices; i++) n += f->device[i].n_open;
  return n;
}

int fake_v4l2_n_mapped(const fake_v4l2 *f) {
  int n = 0;
  for (int i = 0; i < FAKE_V4L2_CAP_PAGES; i++) n += f->page_state[i] != 0;
  return n;
}

void fake_v4l2_unplug(fake_v4l2 *f, int i) {
  f->device[i].is_unplugged = true;
  f->device[i].is_streaming = false;
}

void fake_v4l2_plug(fake_v4l2 *f, int i) {
  fake_device *d = &f->device[i];
  d->is_unplugged = false;
  struct v4l2_requestbuffers none = {.count = 0};
  do_reqbufs(d, &none);
  reset_device(d);
}
