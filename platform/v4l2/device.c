// SPDX-License-Identifier: Apache-2.0
// Opens a camera: identity, format, buffers.
#include <errno.h>
#include <linux/videodev2.h>
#include <string.h>

#include "platform/linux/linux.h"
#include "platform/v4l2/camera.h"
#include "platform/v4l2/format.h"

#define ENOUGH_FPS 15.0 // a format that reaches this wins over a preferred one that is slower

int sv_v4l2_call(const sv_v4l2_camera *c, unsigned long request, void *arg) {
  return c->fd < 0 ? -ENODEV : c->sys->ioctl(c->sys->self, c->fd, request, arg);
}

// --- formats -------------------------------------------------------------------------------------
static void from_v4l2(const sv_v4l2_camera *c, const struct v4l2_format *f, sv_v4l2_fmt *out) {
  if (c->is_mplane) {
    const struct v4l2_pix_format_mplane *p = &f->fmt.pix_mp;
    *out = (sv_v4l2_fmt){p->pixelformat,
                         p->width,
                         p->height,
                         p->plane_fmt[0].bytesperline,
                         p->plane_fmt[0].sizeimage,
                         p->ycbcr_enc,
                         p->quantization,
                         p->num_planes,
                         p->plane_fmt[1].bytesperline};
    return;
  }
  const struct v4l2_pix_format *p = &f->fmt.pix;
  *out = (sv_v4l2_fmt){p->pixelformat, p->width,     p->height,       p->bytesperline,
                       p->sizeimage,   p->ycbcr_enc, p->quantization, 1};
}

int sv_v4l2_get_fmt(const sv_v4l2_camera *c, sv_v4l2_fmt *out) {
  struct v4l2_format f = {.type = c->buf_type};
  int r = sv_v4l2_call(c, VIDIOC_G_FMT, &f);
  if (r >= 0) from_v4l2(c, &f, out);
  return r;
}

int sv_v4l2_try_fmt(const sv_v4l2_camera *c, sv_v4l2_fmt *io, bool is_set) {
  struct v4l2_format f = {.type = c->buf_type};
  if (c->is_mplane) {
    f.fmt.pix_mp.pixelformat = io->fourcc;
    f.fmt.pix_mp.width = io->width_px;
    f.fmt.pix_mp.height = io->height_px;
    f.fmt.pix_mp.field = V4L2_FIELD_NONE;
    f.fmt.pix_mp.num_planes = (uint8_t)sv_v4l2_format_planes(io->fourcc);
  } else {
    f.fmt.pix.pixelformat = io->fourcc;
    f.fmt.pix.width = io->width_px;
    f.fmt.pix.height = io->height_px;
    f.fmt.pix.field = V4L2_FIELD_NONE;
  }
  int r = sv_v4l2_call(c, is_set ? VIDIOC_S_FMT : VIDIOC_TRY_FMT, &f);
  if (r >= 0) from_v4l2(c, &f, io);
  return r;
}

double sv_v4l2_max_fps(const sv_v4l2_camera *c, uint32_t fourcc, int w, int h) {
  double best = 0;
  for (uint32_t i = 0; i < 64; i++) {
    struct v4l2_frmivalenum e = {
        .index = i, .pixel_format = fourcc, .width = (uint32_t)w, .height = (uint32_t)h};
    if (sv_v4l2_call(c, VIDIOC_ENUM_FRAMEINTERVALS, &e) < 0) break;
    struct v4l2_fract t = e.type == V4L2_FRMIVAL_TYPE_DISCRETE ? e.discrete : e.stepwise.min;
    double fps = t.numerator ? (double)t.denominator / (double)t.numerator : 0;
    if (fps > best) best = fps;
    if (e.type != V4L2_FRMIVAL_TYPE_DISCRETE) break;
  }
  return best;
}

// Tries the size in a format; true when the device accepts both unchanged.
static bool takes(const sv_v4l2_camera *c, uint32_t fourcc, int w, int h) {
  sv_v4l2_fmt f = {.fourcc = fourcc, .width_px = (uint32_t)w, .height_px = (uint32_t)h};
  return sv_v4l2_try_fmt(c, &f, false) >= 0 && f.fourcc == fourcc && f.width_px == (uint32_t)w &&
         f.height_px == (uint32_t)h && f.n_planes == sv_v4l2_format_planes(fourcc);
}

// The preferred format that reaches the rate wanted; else the fastest.
static uint32_t choose(const sv_v4l2_camera *c, int w, int h) {
  double want = c->cfg->fps > 0 ? c->cfg->fps : ENOUGH_FPS, best_fps = -1;
  uint32_t best = 0;
  for (int i = 0; i < sv_v4l2_n_formats; i++) {
    uint32_t f = sv_v4l2_fourcc(sv_v4l2_formats[i].name);
    if (!takes(c, f, w, h)) continue;
    double fps = sv_v4l2_max_fps(c, f, w, h);
    if (fps == 0 || fps >= 0.99 * want) return f;
    if (fps > best_fps) {
      best = f;
      best_fps = fps;
    }
  }
  return best;
}

static bool selection(const sv_v4l2_camera *c, uint32_t target, struct v4l2_rect *r) {
  // The same type for both APIs, as older kernels want it.
  struct v4l2_selection s = {.type = V4L2_BUF_TYPE_VIDEO_CAPTURE, .target = target};
  if (sv_v4l2_call(c, VIDIOC_G_SELECTION, &s) < 0) return false;
  *r = s.r;
  return r->width > 0 && r->height > 0;
}

// What the frames show, where the driver tells: its crop, if that fills the frame.
static sv_sensor_area shown_area(const sv_v4l2_camera *c) {
  struct v4l2_rect crop, all, to;
  sv_sensor_area a = {.sensor_width_px = 0};
  if (!selection(c, V4L2_SEL_TGT_CROP, &crop) || !selection(c, V4L2_SEL_TGT_CROP_BOUNDS, &all)) return a;
  const bool is_inside = crop.left >= all.left && crop.top >= all.top &&
                         crop.left + (int)crop.width <= all.left + (int)all.width &&
                         crop.top + (int)crop.height <= all.top + (int)all.height;
  const bool is_part =
      selection(c, V4L2_SEL_TGT_COMPOSE, &to) &&
      (to.left || to.top || (int)to.width != c->caps.width_px || (int)to.height != c->caps.height_px);
  if (!is_inside || is_part || all.width > 32767 || all.height > 32767) return a;
  return (sv_sensor_area){(int)all.width,     (int)all.height,    crop.left - all.left,
                          crop.top - all.top, (double)crop.width, (double)crop.height};
}

static sv_status agree(sv_v4l2_camera *c, sv_err *err) {
  const sv_camera_options *o = c->cfg;
  bool is_again = c->fourcc != 0; // back after a fault: only the negotiated format is accepted
  sv_v4l2_fmt f;
  char name[5];
  if (sv_v4l2_get_fmt(c, &f) < 0) return sv_fail(err, SV_E_DEVICE, "%s: does not tell its format", c->path);
  int w = is_again ? c->caps.width_px : o->width_px ? o->width_px : (int)f.width_px;
  int h = is_again ? c->caps.height_px : o->width_px ? o->height_px : (int)f.height_px;
  uint32_t fourcc = is_again ? c->fourcc : o->format[0] ? sv_v4l2_fourcc(o->format) : choose(c, w, h);
  if (!fourcc)
    return sv_fail(
        err, SV_E_UNSUPPORTED,
        "%s: no format of %dx%d px that can be read here; 'subview cameras --source-kind v4l2' lists "
        "what there is",
        c->path, w, h);
  sv_v4l2_fourcc_name(fourcc, name);
  int i = sv_v4l2_format_index(fourcc);
  if (i < 0) return sv_fail(err, SV_E_UNSUPPORTED, "%s: format %s is not known here", c->path, name);
  f = (sv_v4l2_fmt){.fourcc = fourcc, .width_px = (uint32_t)w, .height_px = (uint32_t)h};
  int r = sv_v4l2_try_fmt(c, &f, true);
  if (r < 0)
    return sv_fail(err, SV_E_DEVICE, "%s: does not take %s at %dx%d px: %s", c->path, name, w, h,
                   r == -EBUSY ? "another program uses it" : sv_linux_reason(-r));
  uint32_t n_planes = sv_v4l2_format_planes(fourcc);
  if (f.fourcc != fourcc || f.width_px != (uint32_t)w || f.height_px != (uint32_t)h ||
      f.n_planes != n_planes) {
    char got[5];
    sv_v4l2_fourcc_name(f.fourcc, got);
    return sv_fail(err, SV_E_RANGE, "%s: offers %s at %ux%u px in %u planes, expected %s at %dx%d px in %u",
                   c->path, got, f.width_px, f.height_px, f.n_planes, name, w, h, n_planes);
  }
  if (n_planes > 1 && o->is_exported)
    return sv_fail(err, SV_E_UNSUPPORTED, "%s: dmabuf=on exports frames of one plane, expected format=NV12",
                   c->path);
  c->n_planes = (int)n_planes;
  c->fourcc = fourcc;
  c->caps.width_px = w;
  c->caps.height_px = h;
  c->caps.format = sv_v4l2_formats[i].format;
  size_t row = sv_pixel_row_bytes(c->caps.format, w);
  c->stride_bytes = f.stride_bytes >= row ? (int)f.stride_bytes : (int)row;
  c->chroma_stride_bytes = f.stride1_bytes >= row ? (int)f.stride1_bytes : (int)row;
  c->image_bytes = f.image_bytes;
  // Without information from the driver: limited-range BT.601, V4L2's default for cameras.
  bool is_full = f.quantization == V4L2_QUANTIZATION_FULL_RANGE, is_709 = f.encoding == V4L2_YCBCR_ENC_709;
  c->caps.yuv = is_709 ? (is_full ? SV_YUV_709_FULL : SV_YUV_709) : is_full ? SV_YUV_601_FULL : SV_YUV_601;
  c->caps.tone = sv_camera_tone(o, c->caps.format);
  c->caps.area = shown_area(c);
  return SV_OK;
}

static void set_rate(sv_v4l2_camera *c) {
  struct v4l2_streamparm p = {.type = c->buf_type};
  struct v4l2_fract *t = &p.parm.capture.timeperframe;
  double want = c->cfg->fps > 0 ? c->cfg->fps : 0;
  c->caps.fps = 0;
  if (sv_v4l2_call(c, VIDIOC_G_PARM, &p) < 0) return;
  if (want > 0 && (p.parm.capture.capability & V4L2_CAP_TIMEPERFRAME)) {
    *t = (struct v4l2_fract){1000, (uint32_t)(want * 1000 + 0.5)};
    if (sv_v4l2_call(c, VIDIOC_S_PARM, &p) < 0) return;
  }
  if (t->numerator && t->denominator) c->caps.fps = (double)t->denominator / (double)t->numerator;
}

// --- buffers -------------------------------------------------------------------------------------
static int query(const sv_v4l2_camera *c, uint32_t index, size_t bytes[], int64_t offset[], uint32_t *flags) {
  struct v4l2_plane plane[VIDEO_MAX_PLANES] = {{0}};
  struct v4l2_buffer b = {.type = c->buf_type, .memory = V4L2_MEMORY_MMAP, .index = index};
  if (c->is_mplane) {
    b.m.planes = plane;
    b.length = (uint32_t)c->n_planes;
  }
  int r = sv_v4l2_call(c, VIDIOC_QUERYBUF, &b);
  if (r < 0) return r;
  for (int i = 0; i < c->n_planes; i++) {
    bytes[i] = c->is_mplane ? plane[i].length : b.length;
    offset[i] = c->is_mplane ? plane[i].m.mem_offset : b.m.offset;
  }
  *flags = b.flags;
  return 0;
}

static void note_stamps(sv_v4l2_camera *c, uint32_t flags) {
  bool is_monotonic = (flags & V4L2_BUF_FLAG_TIMESTAMP_MASK) == V4L2_BUF_FLAG_TIMESTAMP_MONOTONIC;
  bool is_start = (flags & V4L2_BUF_FLAG_TSTAMP_SRC_MASK) == V4L2_BUF_FLAG_TSTAMP_SRC_SOE;
  c->caps.clock = c->cfg->has_clock ? c->cfg->clock : is_monotonic ? SV_CLOCK_MONOTONIC : SV_CLOCK_CAMERA;
  c->caps.stamp = c->cfg->has_stamp ? c->cfg->stamp : is_start ? SV_STAMP_START : SV_STAMP_END;
}

static int map_one(sv_v4l2_camera *c, uint32_t index) {
  sv_v4l2_slot *s = NULL;
  int64_t offset[SV_V4L2_CAP_PLANES];
  uint32_t flags;
  for (int i = 0; i < SV_V4L2_CAP_SLOTS && !s; i++)
    if (c->slot[i].state == SV_V4L2_EMPTY) s = &c->slot[i];
  if (!s) return -ENOMEM;
  int r = query(c, index, s->bytes, offset, &flags);
  if (r < 0) return r;
  for (int i = 0; i < c->n_planes; i++) {
    s->map[i] = c->sys->map(c->sys->self, c->fd, s->bytes[i], offset[i]);
    if (s->map[i]) continue;
    sv_v4l2_free_slot(c, s);
    return -ENOMEM;
  }
  s->state = SV_V4L2_IDLE;
  s->index = index;
  s->dma_fd = -1;
  if (index == 0) note_stamps(c, flags);
  if (!c->cfg->is_exported) return 0;
  // O_CLOEXEC
  struct v4l2_exportbuffer e = {.type = c->buf_type, .index = index, .flags = 02000000};
  r = sv_v4l2_call(c, VIDIOC_EXPBUF, &e);
  if (r >= 0) s->dma_fd = e.fd;
  return r < 0 ? r : 0;
}

static sv_status map_buffers(sv_v4l2_camera *c, sv_err *err) {
  struct v4l2_requestbuffers q = {
      .count = (uint32_t)c->cfg->n_buffers, .type = c->buf_type, .memory = V4L2_MEMORY_MMAP};
  int r = sv_v4l2_call(c, VIDIOC_REQBUFS, &q);
  if (r < 0)
    return sv_fail(err, SV_E_DEVICE, "%s: gives no buffers: %s", c->path,
                   r == -EBUSY ? "another program uses it" : sv_linux_reason(-r));
  if (q.count < 3)
    return sv_fail(err, SV_E_DEVICE, "%s: gives %u buffers, expected at least 3", c->path, q.count);
  for (uint32_t i = 0; r >= 0 && i < q.count && i < SV_CAMERA_CAP_BUFFERS; i++) r = map_one(c, i);
  if (r < 0)
    return sv_fail(err, SV_E_DEVICE, "%s: its buffers cannot be mapped%s: %s", c->path,
                   c->cfg->is_exported ? " and exported" : "", sv_linux_reason(-r));
  const sv_camera_caps *k = &c->caps;
  size_t least = sv_pixel_row_bytes(k->format, k->width_px);
  bool is_coded = sv_pixel(k->format)->layout == SV_LAYOUT_CODED;
  size_t rows = (size_t)k->height_px, chroma_rows = (rows + 1) / 2, least1 = 0;
  if (c->n_planes > 1) least1 = (size_t)c->chroma_stride_bytes * (chroma_rows - 1) + least;
  else if (k->format == SV_PIX_NV12) rows += chroma_rows;
  least = is_coded ? 1 : (size_t)c->stride_bytes * (rows - 1) + least;
  for (int i = 0; i < SV_V4L2_CAP_SLOTS; i++)
    if (c->slot[i].state == SV_V4L2_IDLE && (c->slot[i].bytes[0] < least || c->slot[i].bytes[1] < least1))
      return sv_fail(err, SV_E_DEVICE, "%s: buffers of %zu bytes, expected at least %zu", c->path,
                     c->slot[i].bytes[0] + c->slot[i].bytes[1], least + least1);
  c->caps.frame_bytes = is_coded ? c->image_bytes : (size_t)c->stride_bytes * rows;
  return SV_OK;
}

void sv_v4l2_free_slot(sv_v4l2_camera *c, sv_v4l2_slot *s) {
  if (s->dma_fd >= 0 && s->state != SV_V4L2_EMPTY) c->sys->close(c->sys->self, s->dma_fd);
  for (int i = 0; i < SV_V4L2_CAP_PLANES; i++)
    if (s->map[i]) c->sys->unmap(c->sys->self, s->map[i], s->bytes[i]);
  *s = (sv_v4l2_slot){.dma_fd = -1};
}

// --- open and close ------------------------------------------------------------------------------
static sv_status identify(sv_v4l2_camera *c, sv_err *err) {
  struct v4l2_capability cap;
  memset(&cap, 0, sizeof cap);
  int r = sv_v4l2_call(c, VIDIOC_QUERYCAP, &cap);
  if (r < 0) return sv_fail(err, SV_E_DEVICE, "%s: is not a V4L2 device: %s", c->path, sv_linux_reason(-r));
  uint32_t can = cap.capabilities & V4L2_CAP_DEVICE_CAPS ? cap.device_caps : cap.capabilities;
  c->is_mplane = !(can & V4L2_CAP_VIDEO_CAPTURE) && (can & V4L2_CAP_VIDEO_CAPTURE_MPLANE);
  c->buf_type = c->is_mplane ? V4L2_BUF_TYPE_VIDEO_CAPTURE_MPLANE : V4L2_BUF_TYPE_VIDEO_CAPTURE;
  if (!(can & (V4L2_CAP_VIDEO_CAPTURE | V4L2_CAP_VIDEO_CAPTURE_MPLANE)) || !(can & V4L2_CAP_STREAMING))
    return sv_fail(err, SV_E_UNSUPPORTED, "%s: is not a camera that streams (%.31s)", c->path,
                   (const char *)cap.card);
  cap.card[31] = cap.bus_info[31] = 0;
  if (!c->card[0] && !c->bus[0]) {
    memcpy(c->card, cap.card, sizeof c->card);
    memcpy(c->bus, cap.bus_info, sizeof c->bus);
  } else if (memcmp(c->card, cap.card, strlen(c->card) + 1) ||
             memcmp(c->bus, cap.bus_info, strlen(c->bus) + 1))
    return sv_fail(err, SV_E_NOT_FOUND, "%s: is another camera now", c->path);
  return SV_OK;
}

static sv_status open_path(sv_v4l2_camera *c, sv_err *err) {
  int fd = c->sys->open(c->sys->self, c->path);
  if (fd < 0) {
    bool is_missing = fd == -ENOENT || fd == -ENODEV || fd == -ENXIO;
    return sv_fail(err, is_missing ? SV_E_NOT_FOUND : SV_E_DEVICE, "%s: the camera cannot be opened: %s%s",
                   c->path, sv_linux_reason(-fd),
                   is_missing ? "; 'subview cameras' lists those that are there" : "");
  }
  c->fd = fd;
  sv_status s = identify(c, err);
  if (s < 0) { // it may belong to someone else: change nothing
    c->sys->close(c->sys->self, fd);
    c->fd = -1;
  }
  return s;
}

// A camera that was plugged in again may have another number: it is looked up by name and port.
static sv_status find(sv_v4l2_camera *c, sv_err *err) {
  sv_status s = open_path(c, err);
  if (s != SV_E_NOT_FOUND || !c->bus[0]) return s;
  char before[SV_CAMERA_CAP_NAME];
  memcpy(before, c->path, sizeof before);
  for (int i = 0; i < 64; i++) {
    sv_fmt(c->path, sizeof c->path, "/dev/video%d", i);
    if (open_path(c, NULL) >= 0) return SV_OK;
  }
  memcpy(c->path, before, sizeof before);
  return s;
}

sv_status sv_v4l2_open_device(sv_v4l2_camera *c, sv_err *err) {
  sv_status s = find(c, err);
  if (s < 0) return s;
  s = sv_v4l2_follow_signal(c, err);
  if (s >= 0) s = agree(c, err);
  if (s >= 0) set_rate(c);
  if (s >= 0) s = map_buffers(c, err);
  if (s >= 0) s = sv_v4l2_check_controls(c, err);
  if (s < 0) sv_v4l2_close_device(c);
  else sv_v4l2_want_events(c);
  return s;
}

void sv_v4l2_close_device(sv_v4l2_camera *c) {
  if (c->fd < 0) return;
  sv_v4l2_stream_off(c);
  for (int i = 0; i < SV_V4L2_CAP_SLOTS; i++) {
    sv_v4l2_slot *s = &c->slot[i];
    if (s->state == SV_V4L2_ON_LOAN || s->state == SV_V4L2_WAITING) {
      // The reader keeps its frame. If even the copy fails, the mapping stays until the frame is
      // returned.
      for (int k = 0; k < SV_V4L2_CAP_PLANES; k++)
        if (s->map[k]) (void)c->sys->detach(c->sys->self, s->map[k], s->bytes[k]);
      s->state = SV_V4L2_ORPHAN;
    } else if (s->state == SV_V4L2_IDLE || s->state == SV_V4L2_QUEUED) sv_v4l2_free_slot(c, s);
  }
  struct v4l2_requestbuffers none = {.count = 0, .type = c->buf_type, .memory = V4L2_MEMORY_MMAP};
  (void)sv_v4l2_call(c, VIDIOC_REQBUFS, &none);
  c->sys->close(c->sys->self, c->fd);
  c->fd = -1;
}
