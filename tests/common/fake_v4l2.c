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
      sv_codec_encode_jpeg(&codec, &in, 90, true, f->jpeg[i], sizeof f->jpeg[i], &f->jpeg_bytes[i], NULL) < 0)
    f->jpeg_bytes[i] = 0;
  sv_codec_close(&codec);
}

static uint8_t mark(int i, uint32_t sequence) {
  return (uint8_t)(1 + (sequence * 7 + (uint32_t)i * 31) % 254);
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

static void fill(fake_v4l2 *f, fake_device *d, fake_buffer *b) {
  int i = (int)(d - f->device);
  uint8_t *p = f->page[b->i_page];
  b->flags = d->is_flagged ? V4L2_BUF_FLAG_ERROR : 0;
  b->bytes = (uint32_t)image_bytes(d);
  if (d->fourcc == V4L2_PIX_FMT_MJPEG) {
    b->bytes = (uint32_t)f->jpeg_bytes[d->is_wrong_jpeg];
    memcpy(p, f->jpeg[d->is_wrong_jpeg], b->bytes);
  } else memset(p, mark(i, d->sequence), b->bytes);
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
        d->sequence++;
      }
      d->next_ns += FAKE_V4L2_PERIOD_NS;
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
};

static int control_index(const fake_device *d, uint32_t id) {
  for (int i = 0; d->has_controls && i < FAKE_V4L2_N_CONTROLS; i++)
    if (controls[i].id == id) return i;
  return -1;
}

static int do_control(fake_device *d, unsigned long request, void *arg) {
  struct v4l2_control *c = arg;
  if (request == VIDIOC_QUERYCTRL) {
    int i = control_index(d, ((struct v4l2_queryctrl *)arg)->id);
    if (i < 0) return -EINVAL;
    *(struct v4l2_queryctrl *)arg = controls[i];
    return 0;
  }
  int i = control_index(d, c->id);
  if (i < 0) return -EINVAL;
  if (request == VIDIOC_S_CTRL) {
    if (c->value < controls[i].minimum || c->value > controls[i].maximum) return -ERANGE;
    d->control[i] = c->value;
  }
  c->value = d->control[i];
  return 0;
}

static void reset_device(fake_device *d) {
  d->fourcc = V4L2_PIX_FMT_YUYV;
  d->width_px = FAKE_V4L2_WIDTH_PX, d->height_px = FAKE_V4L2_HEIGHT_PX;
  for (int i = 0; i < FAKE_V4L2_N_CONTROLS; i++) d->control[i] = controls[i].default_value;
}

// --- formats and buffers -------------------------------------------------------------------------
static int do_format(fake_device *d, unsigned long request, struct v4l2_format *f) {
  bool is_get = request == VIDIOC_G_FMT;
  uint32_t fourcc = is_get ? d->fourcc : d->is_mplane ? f->fmt.pix_mp.pixelformat : f->fmt.pix.pixelformat;
  fake_device wanted = *d;
  if (sv_v4l2_format_index(fourcc) < 0 || fourcc == V4L2_PIX_FMT_JPEG) fourcc = V4L2_PIX_FMT_YUYV;
  wanted.fourcc = fourcc;
  if (!is_get && d->is_other_size) wanted.width_px = FAKE_V4L2_WIDTH_PX / 2;
  if (request == VIDIOC_S_FMT) {
    if (d->n_buffers || d->is_busy) return -EBUSY;
    d->fourcc = wanted.fourcc, d->width_px = wanted.width_px;
  }
  uint32_t bytes = (uint32_t)image_bytes(&wanted), w = (uint32_t)wanted.width_px,
           h = (uint32_t)wanted.height_px;
  uint32_t row = (uint32_t)sv_pixel_row_bytes(sv_v4l2_formats[sv_v4l2_format_index(fourcc)].format, (int)w);
  if (d->is_mplane) {
    f->fmt.pix_mp =
        (struct v4l2_pix_format_mplane){.width = w, .height = h, .pixelformat = fourcc, .num_planes = 1};
    f->fmt.pix_mp.plane_fmt[0].bytesperline = row;
    f->fmt.pix_mp.plane_fmt[0].sizeimage = bytes;
  } else
    f->fmt.pix = (struct v4l2_pix_format){
        .width = w, .height = h, .pixelformat = fourcc, .bytesperline = row, .sizeimage = bytes};
  return 0;
}

static int do_reqbufs(fake_device *d, struct v4l2_requestbuffers *r) {
  if (r->count && d->is_busy) return -EBUSY;
  memset(d->buffer, 0, sizeof d->buffer);
  for (int k = 0; k < FAKE_V4L2_CAP_BUFFERS; k++) d->buffer[k].i_page = -1;
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
    b->m.planes[0].length = FAKE_V4L2_PAGE_BYTES;
    b->m.planes[0].m.mem_offset = offset;
    b->m.planes[0].bytesused = k->bytes;
  } else b->length = FAKE_V4L2_PAGE_BYTES, b->m.offset = offset, b->bytesused = k->bytes;
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
    d->next_ns = f->now_ns + FAKE_V4L2_PERIOD_NS + (d - f->device) * SV_NS_PER_MS;
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

static int do_capability(const fake_v4l2 *f, const fake_device *d, struct v4l2_capability *c) {
  memset(c, 0, sizeof *c);
  snprintf((char *)c->card, sizeof c->card, d->is_other_camera ? "another" : "fake camera");
  snprintf((char *)c->bus_info, sizeof c->bus_info, "fake:%d", (int)(d - f->device));
  c->device_caps =
      V4L2_CAP_STREAMING | (d->is_mplane ? V4L2_CAP_VIDEO_CAPTURE_MPLANE : V4L2_CAP_VIDEO_CAPTURE);
  c->capabilities = V4L2_CAP_DEVICE_CAPS | c->device_caps;
  return 0;
}

// --- the table -----------------------------------------------------------------------------------
static int do_ioctl(fake_v4l2 *f, fake_device *d, unsigned long request, void *arg) {
  if (d->is_unplugged) return -ENODEV;
  switch (request) {
  case VIDIOC_QUERYCAP: return do_capability(f, d, arg);
  case VIDIOC_ENUM_FMT:
  case VIDIOC_ENUM_FRAMESIZES: return do_list(request, arg);
  case VIDIOC_ENUM_FRAMEINTERVALS: return do_interval(d, arg);
  case VIDIOC_G_FMT:
  case VIDIOC_TRY_FMT:
  case VIDIOC_S_FMT: return do_format(d, request, arg);
  case VIDIOC_G_PARM:
    ((struct v4l2_streamparm *)arg)->parm.capture.timeperframe = (struct v4l2_fract){1, 25};
    return 0;
  case VIDIOC_S_PARM: return 0;
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
  int k = (int)(offset / 4096 % 64);
  if (must_fail(f, fd - FD_DEVICE) || bytes > FAKE_V4L2_PAGE_BYTES || k >= d->n_buffers) return NULL;
  for (int i = 0; i < FAKE_V4L2_CAP_PAGES; i++)
    if (!f->page_state[i]) {
      f->page_state[i] = 1;
      d->buffer[k].i_page = i;
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
