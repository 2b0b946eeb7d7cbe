// SPDX-License-Identifier: Apache-2.0
#include "platform/camera/tiled.h"

#include <string.h>

#include "src/base/str.h"

static int n_tiles(const sv_tiled *t) { return t->cols * t->rows; }

static uint16_t *loan(sv_tiled *t, int i_inner, int i_buffer) {
  return &t->on_loan[(size_t)i_inner * SV_TILED_CAP_BUFFERS + (size_t)i_buffer];
}

static sv_status check(const sv_tiled *t, const sv_camera_caps *c, sv_err *err) {
  const sv_pixel_info *p = sv_pixel(c->format);
  int step_x = p->container_bits == 10 ? 4 : 2, step_y = 1;
  bool is_pattern = p->layout == SV_LAYOUT_NV12 || p->layout == SV_LAYOUT_BAYER;
  if (is_pattern) step_y = 2;
  if (!is_pattern && p->layout != SV_LAYOUT_YUYV && p->layout != SV_LAYOUT_UYVY && p->container_bits % 8 == 0)
    step_x = 1;
  if (p->layout == SV_LAYOUT_CODED) step_x = step_y = 1;
  int w = c->width_px / t->cols, h = c->height_px / t->rows;
  if (c->width_px % t->cols || c->height_px % t->rows || w % step_x || h % step_y)
    return sv_fail(err, SV_E_ARG, "tiles=%dx%d: %s delivers %dx%d px in %s, which cannot be divided this way",
                   t->cols, t->rows, c->name, c->width_px, c->height_px, p->name);
  return SV_OK;
}

sv_status sv_tiled_init(sv_tiled *t, const sv_source *inner, int cols, int rows, sv_arena *arena,
                        sv_err *err) {
  memset(t, 0, sizeof *t);
  if (cols < 1 || rows < 1 || cols * rows < 2 || cols * rows > SV_TILED_CAP_TILES)
    return sv_fail(err, SV_E_ARG, "tiles=%dx%d: expected 2 to %d tiles", cols, rows, SV_TILED_CAP_TILES);
  t->inner = *inner;
  t->cols = cols;
  t->rows = rows;
  t->caps = SV_TAKE(arena, sv_camera_caps, inner->n_cameras);
  t->on_loan = SV_TAKE(arena, uint16_t, inner->n_cameras * SV_TILED_CAP_BUFFERS);
  if (arena->status < 0)
    return sv_fail(err, arena->status, "tiles: no room for %d cameras", inner->n_cameras);
  memset(t->on_loan, 0, sizeof *t->on_loan * (size_t)inner->n_cameras * SV_TILED_CAP_BUFFERS);
  for (int i = 0; i < inner->n_cameras; i++) {
    sv_status s = inner->caps(inner->self, i, &t->caps[i]);
    if (s < 0) return sv_fail(err, s, "camera %d does not tell what it can do", i);
    if ((s = check(t, &t->caps[i], err)) < 0) return s;
  }
  return SV_OK;
}

static sv_status tiled_caps(void *self, int i, sv_camera_caps *out) {
  sv_tiled *t = self;
  if (i < 0 || i >= t->inner.n_cameras * n_tiles(t)) return SV_E_ARG;
  const sv_camera_caps *c = &t->caps[i / n_tiles(t)];
  *out = *c;
  out->width_px = c->width_px / t->cols;
  out->height_px = c->height_px / t->rows;
  out->area = (sv_sensor_area){.sensor_width_px = 0}; // that of a tile is not known
  if (sv_pixel(c->format)->layout == SV_LAYOUT_CODED && !c->coded_width_px) {
    out->coded_width_px = c->width_px;
    out->coded_height_px = c->height_px;
  }
  sv_fmt(out->name, sizeof out->name, "%.40s.%d", c->name, i % n_tiles(t));
  return SV_OK;
}

// Cuts tile i_tile out of the image.
static void cut(const sv_tiled *t, const sv_frame *whole, int i_tile, sv_frame *f) {
  *f = *whole;
  f->width_px = whole->width_px / t->cols;
  f->height_px = whole->height_px / t->rows;
  f->i_camera = whole->i_camera * n_tiles(t) + i_tile;
  int x = i_tile % t->cols * f->width_px, y = i_tile / t->cols * f->height_px;
  if (sv_pixel(f->format)->layout == SV_LAYOUT_CODED) {
    f->coded_x0_px += x;
    f->coded_y0_px += y;
    return;
  }
  size_t stride = (size_t)whole->stride_bytes, row = sv_pixel_row_bytes(f->format, f->width_px);
  size_t at = (size_t)y * stride + sv_pixel_row_bytes(f->format, x);
  size_t bytes = stride * (size_t)(f->height_px - 1) + row;
  if (f->format == SV_PIX_NV12) {
    const uint8_t *chroma = whole->chroma ? whole->chroma : whole->data + stride * (size_t)whole->height_px;
    f->chroma_stride_bytes = whole->chroma ? whole->chroma_stride_bytes : whole->stride_bytes;
    f->chroma = chroma + (size_t)(y / 2) * (size_t)f->chroma_stride_bytes + (size_t)x;
  }
  if (at > whole->data_bytes) at = whole->data_bytes; // a short image, which is flagged
  f->data = whole->data + at;
  f->data_bytes = whole->data_bytes - at < bytes ? whole->data_bytes - at : bytes;
}

static sv_status tiled_dequeue(void *self, sv_frame *f, sv_ns until_ns) {
  sv_tiled *t = self;
  if (!t->has_frame) {
    sv_status s = t->inner.dequeue(t->inner.self, &t->frame, until_ns);
    if (s != SV_OK) {
      *f = t->frame;
      if (f->i_camera >= 0) f->i_camera *= n_tiles(t);
      return s;
    }
    if (t->frame.i_camera < 0 || t->frame.i_camera >= t->inner.n_cameras || t->frame.i_buffer < 0 ||
        t->frame.i_buffer >= SV_TILED_CAP_BUFFERS)
      return SV_E_DEVICE;
    *loan(t, t->frame.i_camera, t->frame.i_buffer) = (uint16_t)((1u << n_tiles(t)) - 1);
    t->has_frame = true;
    t->i_tile = 0;
  }
  cut(t, &t->frame, t->i_tile, f);
  t->has_frame = ++t->i_tile < n_tiles(t);
  return SV_OK;
}

static sv_status tiled_requeue(void *self, const sv_frame *f) {
  sv_tiled *t = self;
  int n = n_tiles(t);
  if (f->i_camera < 0 || f->i_camera >= t->inner.n_cameras * n || f->i_buffer < 0 ||
      f->i_buffer >= SV_TILED_CAP_BUFFERS)
    return SV_E_ARG;
  int i_inner = f->i_camera / n, i_tile = f->i_camera % n;
  uint16_t *l = loan(t, i_inner, f->i_buffer), bit = (uint16_t)(1u << i_tile);
  // A tile that is not delivered yet cannot come back.
  bool is_ahead =
      t->has_frame && t->frame.i_camera == i_inner && t->frame.i_buffer == f->i_buffer && i_tile >= t->i_tile;
  if (!(*l & bit) || is_ahead) return SV_E_ARG;
  *l = (uint16_t)(*l & ~bit);
  if (*l) return SV_OK;
  sv_frame whole = *f;
  whole.i_camera = i_inner;
  return t->inner.requeue(t->inner.self, &whole);
}

static sv_status tiled_start(void *self) {
  sv_tiled *t = self;
  return t->inner.start(t->inner.self);
}

static sv_status tiled_stop(void *self) {
  sv_tiled *t = self;
  t->has_frame = false;
  memset(t->on_loan, 0, sizeof *t->on_loan * (size_t)t->inner.n_cameras * SV_TILED_CAP_BUFFERS);
  return t->inner.stop(t->inner.self);
}

static sv_status tiled_pose(void *self, sv_ns host_ns, sv_pose *rig_from_world) {
  sv_tiled *t = self;
  return t->inner.rig_pose(t->inner.self, host_ns, rig_from_world);
}

static sv_status tiled_event(void *self, sv_camera_event *e) {
  sv_tiled *t = self;
  sv_status s = t->inner.event(t->inner.self, e);
  if (s == SV_OK) e->i_camera *= n_tiles(t);
  return s;
}

static sv_status tiled_control(void *self, int i, sv_control control, int64_t value, int64_t *actual) {
  sv_tiled *t = self;
  return i < 0 ? SV_E_ARG : t->inner.set_control(t->inner.self, i / n_tiles(t), control, value, actual);
}

static sv_status tiled_trigger(void *self, bool is_external) {
  sv_tiled *t = self;
  return t->inner.trigger(t->inner.self, is_external);
}

sv_source sv_tiled_source(sv_tiled *t) {
  return (sv_source){.self = t,
                     .n_cameras = t->inner.n_cameras * n_tiles(t),
                     .caps = tiled_caps,
                     .start = tiled_start,
                     .dequeue = tiled_dequeue,
                     .requeue = tiled_requeue,
                     .stop = tiled_stop,
                     .rig_pose = t->inner.rig_pose ? tiled_pose : NULL,
                     .event = t->inner.event ? tiled_event : NULL,
                     .set_control = t->inner.set_control ? tiled_control : NULL,
                     .trigger = t->inner.trigger ? tiled_trigger : NULL};
}
