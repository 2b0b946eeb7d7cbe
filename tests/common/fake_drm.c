// SPDX-License-Identifier: Apache-2.0
#include "tests/common/fake_drm.h"

#include <errno.h>
#include <string.h>

#include <libdrm/drm.h>
#include <libdrm/drm_mode.h>

#define HDMI      31u
#define WRITEBACK 32u
#define DSI       33u
#define CRTC      41u
#define ENCODER   51u

void fake_drm_init(fake_drm *f) {
  memset(f, 0, sizeof *f);
  f->is_dsi_there = true;
  f->fb_id = FAKE_DRM_FBCON;
  f->n_allocs_left = 1000;
}

int fake_drm_n_buffers(const fake_drm *f) {
  int n = 0;
  for (int i = 0; i < FAKE_DRM_CAP_BUFFERS; i++) n += f->buffer[i].is_used;
  return n;
}

sv_display_frame fake_drm_shown(fake_drm *f) {
  if (f->fb_id < 100) return (sv_display_frame){0};
  const uint32_t i = f->fb_id - 100;
  return (sv_display_frame){f->buffer[i].px, f->buffer[i].stride_bytes, (int)f->buffer[i].width_px,
                            (int)f->buffer[i].height_px};
}

static int do_open(void *self, const char *path) {
  fake_drm *f = self;
  if (f->has_no_cards) return -ENOENT;
  if (f->open_errno) return -f->open_errno;
  if (strcmp(path, "/dev/dri/card0") != 0 && strcmp(path, "/dev/dri/card1") != 0) return -ENOENT;
  f->n_open++;
  return path[13] == '0' ? 10 : 11;
}

static int do_close(void *self, int fd) {
  fake_drm *f = self;
  f->n_open--;
  return fd == 10 || fd == 11 ? 0 : -EBADF;
}

static void give(uint64_t to, const void *from, size_t bytes) { memcpy((void *)(uintptr_t)to, from, bytes); }

static int resources(struct drm_mode_card_res *r) {
  static const uint32_t connectors[] = {HDMI, WRITEBACK, DSI}, crtcs[] = {CRTC};
  if (r->count_connectors >= 3) give(r->connector_id_ptr, connectors, sizeof connectors);
  if (r->count_crtcs >= 1) give(r->crtc_id_ptr, crtcs, sizeof crtcs);
  r->count_connectors = 3;
  r->count_crtcs = r->count_encoders = 1;
  return 0;
}

static struct drm_mode_modeinfo mode(uint16_t w, uint16_t h, bool is_preferred) {
  return (struct drm_mode_modeinfo){.clock = (uint32_t)w * h * 60 / 1000,
                                    .hdisplay = w,
                                    .vdisplay = h,
                                    .htotal = w,
                                    .vtotal = h,
                                    .type = is_preferred ? DRM_MODE_TYPE_PREFERRED : 0};
}

static int connector(const fake_drm *f, struct drm_mode_get_connector *c) {
  const struct drm_mode_modeinfo hdmi[] = {mode(3840, 2160, true), mode(1280, 720, false),
                                           mode(1920, 1080, false)};
  const struct drm_mode_modeinfo dsi[] = {mode(800, 480, true)};
  const uint32_t encoder = ENCODER;
  const bool is_there = c->connector_id == HDMI  ? f->is_hdmi_there
                        : c->connector_id == DSI ? f->is_dsi_there
                                                 : true;
  const struct drm_mode_modeinfo *modes = c->connector_id == HDMI ? hdmi : dsi;
  const uint32_t n = !is_there ? 0 : c->connector_id == HDMI ? 3 : 1;
  if (c->count_modes >= n) give(c->modes_ptr, modes, n * sizeof *modes);
  if (c->count_encoders >= 1) give(c->encoders_ptr, &encoder, sizeof encoder);
  c->count_modes = n;
  c->count_encoders = 1;
  c->connection = is_there ? 1 : 2;
  c->connector_type = c->connector_id == HDMI  ? DRM_MODE_CONNECTOR_HDMIA
                      : c->connector_id == DSI ? DRM_MODE_CONNECTOR_DSI
                                               : DRM_MODE_CONNECTOR_WRITEBACK;
  c->connector_type_id = 1;
  return 0;
}

static int create(fake_drm *f, struct drm_mode_create_dumb *d) {
  for (uint32_t i = 0; i < FAKE_DRM_CAP_BUFFERS; i++) {
    if (f->buffer[i].is_used) continue;
    if (f->n_allocs_left-- <= 0) return -ENOMEM;
    f->buffer[i].is_used = true;
    f->buffer[i].width_px = d->width;
    f->buffer[i].height_px = d->height;
    f->buffer[i].stride_bytes = d->pitch = 4 * d->width + 64;
    d->size = (uint64_t)d->pitch * d->height;
    d->handle = i + 1;
    return d->size <= FAKE_DRM_CAP_BYTES ? 0 : -ENOMEM;
  }
  return -ENOMEM;
}

static int set_crtc(fake_drm *f, const struct drm_mode_crtc *c) {
  if (c->mode_valid && f->is_mode_refused) return -EINVAL;
  f->fb_id = c->mode_valid ? c->fb_id : 0;
  f->width_px = c->mode_valid ? c->mode.hdisplay : 0;
  f->height_px = c->mode_valid ? c->mode.vdisplay : 0;
  return c->mode_valid && c->count_connectors != 1 ? -EINVAL : 0;
}

static int flip(fake_drm *f, const struct drm_mode_crtc_page_flip *p) {
  if (f->are_flips_refused) return -EACCES;
  if (f->is_flip_pending) return -EBUSY;
  f->fb_id = p->fb_id;
  f->is_flip_pending = true;
  f->has_event = !f->are_flips_waiting;
  return 0;
}

static int buffer_call(fake_drm *f, unsigned long request, void *arg) {
  if (request == DRM_IOCTL_MODE_CREATE_DUMB) return create(f, arg);
  if (request == DRM_IOCTL_MODE_ADDFB) {
    struct drm_mode_fb_cmd *fb = arg;
    fb->fb_id = 100 + fb->handle - 1;
    f->buffer[fb->handle - 1].has_fb = true;
  } else if (request == DRM_IOCTL_MODE_MAP_DUMB) {
    struct drm_mode_map_dumb *m = arg;
    m->offset = (uint64_t)(m->handle - 1) << 32;
  } else if (request == DRM_IOCTL_MODE_RMFB) {
    f->buffer[*(uint32_t *)arg - 100].has_fb = false;
    if (f->fb_id == *(uint32_t *)arg) f->fb_id = 0;
  } else f->buffer[((struct drm_mode_destroy_dumb *)arg)->handle - 1].is_used = false;
  return 0;
}

static int do_ioctl(void *self, int fd, unsigned long request, void *arg) {
  fake_drm *f = self;
  if (fd == 10) return -EOPNOTSUPP;
  switch (request) {
  case DRM_IOCTL_MODE_GETRESOURCES: return resources(arg);
  case DRM_IOCTL_MODE_GETCONNECTOR: return connector(f, arg);
  case DRM_IOCTL_MODE_GETENCODER:
    *(struct drm_mode_get_encoder *)arg =
        (struct drm_mode_get_encoder){.encoder_id = ENCODER, .possible_crtcs = 1};
    return 0;
  case DRM_IOCTL_SET_MASTER: return f->has_other_master ? -EBUSY : 0;
  case DRM_IOCTL_MODE_GETCRTC:
    *(struct drm_mode_crtc *)arg = (struct drm_mode_crtc){
        .crtc_id = CRTC, .fb_id = f->fb_id, .mode_valid = 1, .mode = mode(800, 480, true)};
    return 0;
  case DRM_IOCTL_MODE_SETCRTC: return set_crtc(f, arg);
  case DRM_IOCTL_MODE_PAGE_FLIP: return flip(f, arg);
  default: return buffer_call(f, request, arg);
  }
}

static void *do_map(void *self, int fd, size_t bytes, int64_t offset) {
  fake_drm *f = self;
  (void)fd;
  f->n_mapped++;
  return bytes <= FAKE_DRM_CAP_BYTES ? f->buffer[offset >> 32].px : NULL;
}

static int do_unmap(void *self, void *p, size_t bytes) {
  fake_drm *f = self;
  f->n_mapped--;
  memset(p, 0xee, bytes);
  return 0;
}

static int64_t do_read(void *self, int fd, void *to, size_t cap) {
  fake_drm *f = self;
  const struct drm_event_vblank e = {.base = {DRM_EVENT_FLIP_COMPLETE, sizeof e}};
  if (fd != 11 || !f->has_event || cap < sizeof e) return -EAGAIN;
  f->has_event = f->is_flip_pending = false;
  memcpy(to, &e, sizeof e);
  return (int64_t)sizeof e;
}

sv_drm_sys fake_drm_sys(fake_drm *f) {
  return (sv_drm_sys){f, do_open, do_close, do_ioctl, do_map, do_unmap, do_read};
}
