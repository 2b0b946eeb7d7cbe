// SPDX-License-Identifier: Apache-2.0
// A camera at work: buffers in and out, faults, and recovery.
#include <errno.h>
#include <linux/videodev2.h>
#include <string.h>

#include "platform/v4l2/camera.h"

#define MOST_RETRY_NS  (50 * SV_NS_PER_MS)
#define LEAST_RETRY_NS (10 * SV_NS_PER_MS)

static void event(sv_v4l2_camera *c, sv_camera_event_kind kind, sv_ns now_ns, int64_t detail) {
  sv_camera_events_add(c->events, kind, c->i_camera, now_ns, detail);
}

int sv_v4l2_n_queued(const sv_v4l2_camera *c) {
  int n = 0;
  for (int i = 0; i < SV_V4L2_CAP_SLOTS; i++) n += c->slot[i].state == SV_V4L2_QUEUED;
  return n;
}

int sv_v4l2_queue(sv_v4l2_camera *c, sv_v4l2_slot *s) {
  struct v4l2_plane plane[VIDEO_MAX_PLANES] = {{0}};
  struct v4l2_buffer b = {.type = c->buf_type, .memory = V4L2_MEMORY_MMAP, .index = s->index};
  if (c->is_mplane) {
    b.m.planes = plane;
    b.length = (uint32_t)c->n_planes;
  }
  int r = sv_v4l2_call(c, VIDIOC_QBUF, &b);
  s->state = r < 0 ? SV_V4L2_IDLE : SV_V4L2_QUEUED;
  return r < 0 ? r : 0;
}

int sv_v4l2_stream_on(sv_v4l2_camera *c) {
  int type = (int)c->buf_type, r = *c->is_triggered ? sv_v4l2_set_trigger_mode(c) : 0;
  for (int i = 0; r >= 0 && i < SV_V4L2_CAP_SLOTS; i++)
    if (c->slot[i].state == SV_V4L2_IDLE) r = sv_v4l2_queue(c, &c->slot[i]);
  if (r >= 0) r = sv_v4l2_call(c, VIDIOC_STREAMON, &type);
  if (r < 0) return r;
  c->is_streaming = true;
  c->has_last = false;
  return 0;
}

// The driver gives all of its buffers back.
void sv_v4l2_stream_off(sv_v4l2_camera *c) {
  int type = (int)c->buf_type;
  if (c->fd >= 0) (void)sv_v4l2_call(c, VIDIOC_STREAMOFF, &type);
  c->is_streaming = false;
  for (int i = 0; i < SV_V4L2_CAP_SLOTS; i++)
    if (c->slot[i].state == SV_V4L2_QUEUED) c->slot[i].state = SV_V4L2_IDLE;
}

// --- one frame -----------------------------------------------------------------------------------
static bool check_jpeg(sv_v4l2_camera *c, const sv_frame *f, sv_ns now_ns) {
  int w, h;
  bool has_end;
  if (!sv_camera_jpeg_look(f->data, f->data_bytes, &w, &h, &has_end)) {
    event(c, SV_CAMERA_SHORT_FRAME, now_ns, (int64_t)f->data_bytes);
    return false;
  }
  if (w != f->width_px || h != f->height_px) {
    event(c, SV_CAMERA_WRONG_SIZE, now_ns, (int64_t)w << 16 | h);
    return false;
  }
  if (!has_end) event(c, SV_CAMERA_SHORT_FRAME, now_ns, (int64_t)f->data_bytes);
  return has_end;
}

// Is the picture whole? Says what is wrong with it.
static bool check_frame(sv_v4l2_camera *c, const sv_frame *f, size_t cap, sv_ns now_ns) {
  if (f->data_bytes > cap) {
    event(c, SV_CAMERA_WRONG_SIZE, now_ns, (int64_t)f->data_bytes);
    return false;
  }
  if (sv_pixel(f->format)->layout == SV_LAYOUT_CODED) return check_jpeg(c, f, now_ns);
  size_t rows = (size_t)f->height_px;
  if (f->format == SV_PIX_NV12 && !f->chroma) rows += (rows + 1) / 2;
  size_t least = (size_t)f->stride_bytes * (rows - 1) + sv_pixel_row_bytes(f->format, f->width_px);
  if (f->data_bytes >= least) return true;
  event(c, SV_CAMERA_SHORT_FRAME, now_ns, (int64_t)f->data_bytes);
  return false;
}

// Some drivers do not count, or not always: their number stands still while the stamp moves. Then
// we count.
static uint32_t sequence_of(sv_v4l2_camera *c, uint32_t driver_sequence, sv_ns camera_ns) {
  if (!c->has_last) c->n_uncounted = 0;
  else if (driver_sequence == c->last_driver_sequence && camera_ns != c->last_camera_ns) c->n_uncounted++;
  c->has_last = true;
  c->last_driver_sequence = driver_sequence;
  c->last_camera_ns = camera_ns;
  return driver_sequence + c->n_uncounted;
}

// The second plane of two. False: it is not all there.
static bool fill_chroma(sv_v4l2_camera *c, const sv_v4l2_slot *s, const struct v4l2_plane *plane) {
  sv_frame *f = &c->waiting;
  size_t offset = plane->data_offset <= s->bytes[1] ? plane->data_offset : s->bytes[1];
  size_t least = (size_t)c->chroma_stride_bytes * ((size_t)(f->height_px + 1) / 2 - 1) +
                 sv_pixel_row_bytes(f->format, f->width_px);
  bool is_whole =
      plane->bytesused <= s->bytes[1] && plane->bytesused >= offset && plane->bytesused - offset >= least;
  f->chroma = s->map[1] + (is_whole ? offset : 0); // readable in any case
  f->chroma_stride_bytes = c->chroma_stride_bytes;
  return is_whole;
}

static void fill_frame(sv_v4l2_camera *c, int i_slot, const struct v4l2_buffer *b,
                       const struct v4l2_plane *plane, sv_ns now_ns) {
  const sv_v4l2_slot *s = &c->slot[i_slot];
  size_t offset = c->is_mplane ? plane->data_offset : 0;
  size_t used = c->is_mplane ? plane->bytesused : b->bytesused;
  size_t cap = s->bytes[0];
  if (offset > cap) offset = cap;
  sv_frame *f = &c->waiting;
  *f = (sv_frame){.i_camera = c->i_camera,
                  .camera_ns =
                      (sv_ns)b->timestamp.tv_sec * SV_NS_PER_S + (sv_ns)b->timestamp.tv_usec * SV_NS_PER_US,
                  .arrival_ns = now_ns,
                  .width_px = c->caps.width_px,
                  .height_px = c->caps.height_px,
                  .stride_bytes = c->stride_bytes,
                  .format = c->caps.format,
                  .data = s->map[0] + offset,
                  .data_bytes = used >= offset ? used - offset : 0,
                  .i_buffer = i_slot};
  sv_v4l2_tell_exposure(c, f);
  f->sequence = sequence_of(c, b->sequence, f->camera_ns);
  bool has_chroma = c->n_planes < 2 || fill_chroma(c, s, &plane[1]);
  f->is_error = !check_frame(c, f, cap - offset, now_ns);
  if (!f->is_error && !has_chroma) {
    event(c, SV_CAMERA_SHORT_FRAME, now_ns, (int64_t)plane[1].bytesused);
    f->is_error = true;
  }
  if (f->is_error) f->data_bytes = f->data_bytes < cap - offset ? f->data_bytes : cap - offset;
  if (b->flags & V4L2_BUF_FLAG_ERROR) {
    if (!f->is_error) event(c, SV_CAMERA_DAMAGED, now_ns, f->sequence);
    f->is_error = true;
  }
}

int sv_v4l2_take(sv_v4l2_camera *c, sv_ns now_ns) {
  struct v4l2_plane plane[VIDEO_MAX_PLANES] = {{0}};
  struct v4l2_buffer b = {.type = c->buf_type, .memory = V4L2_MEMORY_MMAP};
  if (c->is_mplane) {
    b.m.planes = plane;
    b.length = VIDEO_MAX_PLANES;
  }
  int r = sv_v4l2_call(c, VIDIOC_DQBUF, &b);
  if (r == -EAGAIN) return 0;
  if (r < 0) return r;
  int i = 0;
  while (i < SV_V4L2_CAP_SLOTS && !(c->slot[i].state == SV_V4L2_QUEUED && c->slot[i].index == b.index)) i++;
  if (i == SV_V4L2_CAP_SLOTS) { // a buffer that the driver does not have
    for (i = 0;
         i < SV_V4L2_CAP_SLOTS && !(c->slot[i].state == SV_V4L2_ON_LOAN && c->slot[i].index == b.index);)
      i++;
    if (i == SV_V4L2_CAP_SLOTS) return -EPROTO;
    // v4l2loopback writes on in a ring, whoever still reads. The frame is lost; the camera is well.
    c->last_frame_ns = now_ns;
    event(c, SV_CAMERA_STARVED, now_ns, (int64_t)(c->events->count[SV_CAMERA_STARVED] + 1));
    return 0;
  }
  c->slot[i].state = SV_V4L2_WAITING;
  fill_frame(c, i, &b, plane, now_ns);
  c->has_waiting = true;
  c->last_frame_ns = now_ns;
  c->n_stalls = 0;
  if (c->is_lost) {
    c->is_lost = false;
    event(c, SV_CAMERA_RETURNED, now_ns, now_ns - c->lost_ns);
  }
  return 1;
}

// --- faults --------------------------------------------------------------------------------------
void sv_v4l2_fault(sv_v4l2_camera *c, int error, sv_ns now_ns) {
  if (!c->is_lost) {
    c->is_lost = true;
    c->lost_ns = now_ns;
    c->n_retries = 0;
    c->is_wrong = false;
    c->has_failed = true;
    c->stats.n_lost++;
    event(c, SV_CAMERA_LOST, now_ns, error < 0 ? -error : error);
  }
  sv_v4l2_close_device(c);
  // At once, for most failures are over when the device is closed; then every frame's time, however
  // long it is away.
  double frame_ns = c->caps.fps > 0 ? 1e9 / c->caps.fps : (double)MOST_RETRY_NS;
  sv_ns wait_ns = frame_ns > (double)MOST_RETRY_NS    ? MOST_RETRY_NS
                  : frame_ns < (double)LEAST_RETRY_NS ? LEAST_RETRY_NS
                                                      : (sv_ns)frame_ns;
  c->retry_ns = c->n_retries++ ? now_ns + wait_ns : now_ns;
}

static void reopen(sv_v4l2_camera *c, sv_ns now_ns) {
  sv_err err;
  sv_camera_caps before = c->caps;
  sv_status s = sv_v4l2_open_device(c, &err);
  if (s == SV_E_RANGE && !c->is_wrong) {
    c->is_wrong = true; // said once, tried on
    event(c, SV_CAMERA_WRONG_SIZE, now_ns, (int64_t)before.width_px << 16 | before.height_px);
  }
  int r = s < 0 ? -ENODEV : 0;
  if (r == 0) {
    // What the runtime was told at the start must hold.
    c->caps.clock = before.clock;
    c->caps.stamp = before.stamp;
    c->caps.fps = before.fps;
    if (c->is_locked) sv_v4l2_lock_controls(c, now_ns);
    r = sv_v4l2_stream_on(c);
  }
  c->last_frame_ns = now_ns;
  if (r < 0) sv_v4l2_fault(c, r, now_ns);
  else {
    c->stats.n_restarts++;
    event(c, SV_CAMERA_RESTARTED, now_ns, (int64_t)c->stats.n_restarts);
  }
}

// First the stream is started again, then the device is opened anew.
static void stalled(sv_v4l2_camera *c, sv_ns now_ns) {
  event(c, SV_CAMERA_STALLED, now_ns, now_ns - c->last_frame_ns);
  c->last_frame_ns = now_ns;
  if (c->n_stalls++) {
    sv_v4l2_fault(c, ETIMEDOUT, now_ns);
    return;
  }
  sv_v4l2_stream_off(c);
  int r = sv_v4l2_stream_on(c);
  if (r < 0) {
    sv_v4l2_fault(c, r, now_ns);
    return;
  }
  c->stats.n_restarts++;
  event(c, SV_CAMERA_RESTARTED, now_ns, (int64_t)c->stats.n_restarts);
}

void sv_v4l2_service(sv_v4l2_camera *c, sv_ns now_ns) {
  if (c->fd < 0) {
    if (now_ns >= c->retry_ns) reopen(c, now_ns);
    return;
  }
  int n = sv_v4l2_n_queued(c);
  if (n == 0) { // nothing can come: no fault of the camera
    if (!c->is_starved) sv_camera_events_starved(c->events, c->i_camera, now_ns);
    c->is_starved = true;
    c->last_frame_ns = now_ns;
    return;
  }
  c->is_starved = false;
  if (!c->has_waiting && now_ns - c->last_frame_ns > c->cfg->stall_ns) stalled(c, now_ns);
}
