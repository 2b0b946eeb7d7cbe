// SPDX-License-Identifier: Apache-2.0
#include "platform/drm/drm.h"

#include <errno.h>
#include <string.h>

#include "platform/drm/text.h"
#include "src/base/str.h"

#if defined(__has_include) && __has_include(<libdrm/drm_mode.h>)
#include <libdrm/drm.h>
#include <libdrm/drm_mode.h>

#define CAP_CARDS   16
#define CAP_IDS     32 // encoders and CRTCs fit the kernel's masks of 32 bits
#define CAP_MODES   128
#define CAP_MODE_PX (1920 * 1200) // beyond, drawing takes a small board's processor too long

_Static_assert(sizeof(struct drm_mode_modeinfo) == 4 * SV_DRM_MODE_WORDS, "drm.h keeps one");
_Static_assert(sizeof(struct drm_mode_crtc) == 8 * SV_DRM_CRTC_WORDS, "drm.h keeps one");

// Arrays that the kernel fills; once in a program, as a screen is opened before the run.
static struct {
  uint32_t connectors[CAP_IDS], crtcs[CAP_IDS], encoders[CAP_IDS];
  struct drm_mode_modeinfo modes[CAP_MODES];
} list;

// Of the kernel's drm_mode.h, in the order of its numbers.
static const char *const connector_types[] = {
    "Unknown", "VGA",       "DVI-I", "DVI-D", "DVI-A",     "Composite", "SVIDEO",
    "LVDS",    "Component", "DIN",   "DP",    "HDMI-A",    "HDMI-B",    "TV",
    "eDP",     "Virtual",   "DSI",   "DPI",   "Writeback", "SPI",       "USB"};

// Why no screen was found: what was nearest to one.
typedef struct {
  int n_cards, n_connectors, error;
  char card[32];
} search;

static uint64_t address_of(void *p) { return (uint64_t)(uintptr_t)p; }

static int ask(const sv_drm *d, unsigned long request, void *arg) {
  return d->sys.ioctl(d->sys.self, d->fd, request, arg);
}

static void let_go(sv_drm *d) {
  if (d->fd >= 0) d->sys.close(d->sys.self, d->fd);
  d->fd = -1;
}

// --- finding a screen ----------------------------------------------------------------------------

static bool get_resources(const sv_drm *d, struct drm_mode_card_res *r) {
  *r = (struct drm_mode_card_res){0};
  if (ask(d, DRM_IOCTL_MODE_GETRESOURCES, r) < 0) return false; // a card that only renders
  if (r->count_connectors > CAP_IDS || r->count_crtcs > CAP_IDS) return false;
  r->count_fbs = r->count_encoders = 0;
  r->connector_id_ptr = address_of(list.connectors);
  r->crtc_id_ptr = address_of(list.crtcs);
  return ask(d, DRM_IOCTL_MODE_GETRESOURCES, r) >= 0;
}

// The kernel looks at the connector when no room for modes is given.
static bool get_connector(const sv_drm *d, uint32_t id, struct drm_mode_get_connector *c) {
  *c = (struct drm_mode_get_connector){.connector_id = id};
  if (ask(d, DRM_IOCTL_MODE_GETCONNECTOR, c) < 0) return false;
  c->count_modes = c->count_modes < CAP_MODES ? c->count_modes : CAP_MODES;
  c->count_encoders = c->count_encoders < CAP_IDS ? c->count_encoders : CAP_IDS;
  c->count_props = 0;
  c->modes_ptr = address_of(list.modes);
  c->encoders_ptr = address_of(list.encoders);
  if (c->count_modes == 0) return true;
  return ask(d, DRM_IOCTL_MODE_GETCONNECTOR, c) >= 0;
}

static void connector_name(char out[static 32], const struct drm_mode_get_connector *c) {
  const uint32_t n = sizeof connector_types / sizeof *connector_types;
  sv_fmt(out, 32, "%s-%u", connector_types[c->connector_type < n ? c->connector_type : 0],
         c->connector_type_id);
}

static const struct drm_mode_modeinfo *choose_mode(uint32_t n) {
  const struct drm_mode_modeinfo *best = NULL;
  for (uint32_t i = 0; i < n && i < CAP_MODES; i++) {
    const struct drm_mode_modeinfo *m = &list.modes[i];
    const uint32_t px = (uint32_t)m->hdisplay * m->vdisplay;
    if (m->flags & DRM_MODE_FLAG_INTERLACE || px > CAP_MODE_PX || px == 0) continue;
    if (m->type & DRM_MODE_TYPE_PREFERRED) return m;
    if (!best || px > (uint32_t)best->hdisplay * best->vdisplay) best = m;
  }
  return best ? best : &list.modes[0];
}

// The CRTC that drives the connector now, else the first that can. 0: none.
static uint32_t choose_crtc(const sv_drm *d, const struct drm_mode_get_connector *c, uint32_t n_crtcs) {
  struct drm_mode_get_encoder e = {.encoder_id = c->encoder_id};
  if (c->encoder_id && ask(d, DRM_IOCTL_MODE_GETENCODER, &e) >= 0 && e.crtc_id) return e.crtc_id;
  for (uint32_t i = 0; i < c->count_encoders; i++) {
    e = (struct drm_mode_get_encoder){.encoder_id = list.encoders[i]};
    if (ask(d, DRM_IOCTL_MODE_GETENCODER, &e) < 0) continue;
    for (uint32_t k = 0; k < n_crtcs; k++)
      if (e.possible_crtcs >> k & 1) return list.crtcs[k];
  }
  return 0;
}

// A connected screen of the card that is open. wanted: its connector, or empty.
static bool find_screen(sv_drm *d, const char *wanted, search *s) {
  struct drm_mode_card_res r;
  struct drm_mode_get_connector c;
  if (!get_resources(d, &r)) return false;
  for (uint32_t i = 0; i < r.count_connectors && i < CAP_IDS; i++) {
    char name[32];
    if (!get_connector(d, list.connectors[i], &c)) continue;
    connector_name(name, &c);
    const bool is_picture = c.connector_type != DRM_MODE_CONNECTOR_WRITEBACK;
    if (*wanted ? !sv_str_eq(name, wanted) : !is_picture) continue;
    s->n_connectors++;
    d->crtc_id = c.connection == 1 && c.count_modes > 0 ? choose_crtc(d, &c, r.count_crtcs) : 0;
    if (!d->crtc_id) continue;
    const struct drm_mode_modeinfo *m = choose_mode(c.count_modes);
    memcpy(d->mode, m, sizeof *m);
    d->width_px = m->hdisplay;
    d->height_px = m->vdisplay;
    d->rate_hz = m->htotal && m->vtotal ? 1e3 * m->clock / ((double)m->htotal * m->vtotal) : 0;
    d->connector_id = c.connector_id;
    sv_fmt(d->name, sizeof d->name, "%s of %s", name, s->card);
    return true;
  }
  return false;
}

// Leaves a card with a screen open.
static bool try_card(sv_drm *d, const char *path, const char *connector, search *s) {
  d->fd = d->sys.open(d->sys.self, path);
  if (d->fd < 0) {
    if (d->fd != -ENOENT) s->error = d->fd;
    return false;
  }
  s->n_cards++;
  sv_copy(s->card, sizeof s->card, path);
  if (find_screen(d, connector, s)) return true;
  let_go(d);
  return false;
}

static sv_status say_missing(const char *spec, const char *connector, const search *s, sv_err *err) {
  if (!s->n_cards && s->error == -EACCES)
    return sv_fail(err, SV_E_DEVICE,
                   "--display %s: no permission for /dev/dri; add the user to the group video", spec);
  if (!s->n_cards && s->error)
    return sv_fail(err, SV_E_DEVICE, "--display %s: the card cannot be opened (error %d)", spec, -s->error);
  if (!s->n_cards)
    return sv_fail(err, SV_E_NOT_FOUND, "--display %s: there is no such card in /dev/dri", spec);
  if (!s->n_connectors && *connector)
    return sv_fail(err, SV_E_NOT_FOUND, "--display %s: %s has no connector %s", spec, s->card, connector);
  return sv_fail(err, SV_E_NOT_FOUND, "--display %s: no screen is connected", spec);
}

static sv_status find(sv_drm *d, const char *spec, sv_err *err) {
  search s = {0};
  char path[32];
  if (sv_str_eq(spec, "auto")) {
    for (int i = 0; i < CAP_CARDS; i++) {
      sv_fmt(path, sizeof path, "/dev/dri/card%d", i);
      if (try_card(d, path, "", &s)) return SV_OK;
    }
    return say_missing(spec, "", &s, err);
  }
  const char *colon = strchr(spec, ':'), *connector = colon ? colon + 1 : "";
  const int n = (int)(colon ? (size_t)(colon - spec) : strlen(spec));
  if ((size_t)n + sizeof "/dev/dri/" > sizeof path)
    return sv_fail(err, SV_E_ARG, "--display %s: expected auto or CARD[:CONNECTOR], such as card1:HDMI-A-1",
                   spec);
  sv_fmt(path, sizeof path, "%s%.*s", spec[0] == '/' ? "" : "/dev/dri/", n, spec);
  return try_card(d, path, connector, &s) ? SV_OK : say_missing(spec, connector, &s, err);
}

// --- buffers -------------------------------------------------------------------------------------

static int make_buffer(sv_drm *d, sv_drm_buffer *b) {
  struct drm_mode_create_dumb make = {
      .width = (uint32_t)d->width_px, .height = (uint32_t)d->height_px, .bpp = 32};
  int e = ask(d, DRM_IOCTL_MODE_CREATE_DUMB, &make);
  if (e < 0) return e;
  b->handle = make.handle;
  b->stride_bytes = make.pitch;
  b->bytes = (size_t)make.size;
  struct drm_mode_fb_cmd fb = {.width = make.width,
                               .height = make.height,
                               .pitch = make.pitch,
                               .bpp = 32,
                               .depth = 24,
                               .handle = make.handle};
  if ((e = ask(d, DRM_IOCTL_MODE_ADDFB, &fb)) < 0) return e;
  b->fb_id = fb.fb_id;
  struct drm_mode_map_dumb map = {.handle = make.handle};
  if ((e = ask(d, DRM_IOCTL_MODE_MAP_DUMB, &map)) < 0) return e;
  b->px = d->sys.map(d->sys.self, d->fd, b->bytes, (int64_t)map.offset);
  if (!b->px) return -ENOMEM;
  memset(b->px, 0, b->bytes);
  return 0;
}

static void free_buffer(sv_drm *d, sv_drm_buffer *b) {
  struct drm_mode_destroy_dumb gone = {.handle = b->handle};
  if (b->px) d->sys.unmap(d->sys.self, b->px, b->bytes);
  if (b->fb_id) (void)ask(d, DRM_IOCTL_MODE_RMFB, &b->fb_id);
  if (b->handle) (void)ask(d, DRM_IOCTL_MODE_DESTROY_DUMB, &gone);
  *b = (sv_drm_buffer){0};
}

static int set_crtc(const sv_drm *d, struct drm_mode_crtc *c) {
  uint32_t connector = d->connector_id;
  c->set_connectors_ptr = address_of(&connector);
  c->count_connectors = c->mode_valid;
  return ask(d, DRM_IOCTL_MODE_SETCRTC, c);
}

static sv_status show_black(sv_drm *d, sv_err *err) {
  struct drm_mode_crtc former = {.crtc_id = d->crtc_id}, now = {.crtc_id = d->crtc_id, .mode_valid = 1};
  // The first who opens a card is its master; so a failure means that somebody else is.
  if (ask(d, DRM_IOCTL_SET_MASTER, NULL) < 0)
    return sv_fail(err, SV_E_DEVICE,
                   "--display: another program has the screen %s, such as a desktop; end it first", d->name);
  (void)ask(d, DRM_IOCTL_MODE_GETCRTC, &former);
  memcpy(d->former, &former, sizeof former);
  for (int i = 0; i < 2; i++) {
    const int e = make_buffer(d, &d->buffer[i]);
    if (e < 0)
      return sv_fail(err, SV_E_DEVICE, "--display: %s gives no frame of %dx%d (error %d)", d->name,
                     d->width_px, d->height_px, -e);
  }
  memcpy(&now.mode, d->mode, sizeof now.mode);
  now.fb_id = d->buffer[0].fb_id;
  const int e = set_crtc(d, &now);
  if (e < 0)
    return sv_fail(err, SV_E_DEVICE, "--display: %s refuses its mode of %dx%d (error %d)", d->name,
                   d->width_px, d->height_px, -e);
  return SV_OK;
}

sv_status sv_drm_open(sv_drm *d, const char *spec, const sv_drm_sys *sys, sv_err *err) {
  *d = (sv_drm){.sys = *sys, .fd = -1};
  sv_status s = find(d, spec, err);
  if (s >= 0) s = show_black(d, err);
  if (s < 0) sv_drm_close(d);
  return s;
}

void sv_drm_close(sv_drm *d) {
  if (d->fd < 0) return;
  struct drm_mode_crtc former;
  memcpy(&former, d->former, sizeof former);
  former.mode_valid = former.mode_valid && former.fb_id;
  if (!former.mode_valid) former = (struct drm_mode_crtc){.crtc_id = d->crtc_id}; // it was off
  if (d->buffer[0].fb_id) (void)set_crtc(d, &former);
  for (int i = 0; i < 2; i++) free_buffer(d, &d->buffer[i]);
  let_go(d);
}

// --- frames --------------------------------------------------------------------------------------

// Events of flips: 32 bytes each, and no others were asked for.
static bool is_ready(sv_drm *d) {
  union {
    struct drm_event event;
    uint8_t bytes[256];
  } u;
  if (!d->is_flipping) return true;
  const int64_t n = d->sys.read(d->sys.self, d->fd, u.bytes, sizeof u.bytes);
  if (n >= (int64_t)sizeof u.event && u.event.type == DRM_EVENT_FLIP_COMPLETE) d->is_flipping = false;
  return !d->is_flipping;
}

static void flip(sv_drm *d) {
  struct drm_mode_crtc_page_flip f = {
      .crtc_id = d->crtc_id, .fb_id = d->buffer[1 - d->i_front].fb_id, .flags = DRM_MODE_PAGE_FLIP_EVENT};
  if (ask(d, DRM_IOCTL_MODE_PAGE_FLIP, &f) < 0) { // another program took the screen: later again
    d->n_refused++;
    return;
  }
  d->i_front = 1 - d->i_front;
  d->is_flipping = true;
  d->n_flips++;
}

#else

sv_status sv_drm_open(sv_drm *d, const char *spec, const sv_drm_sys *sys, sv_err *err) {
  *d = (sv_drm){.sys = *sys, .fd = -1};
  return sv_fail(err, SV_E_UNSUPPORTED,
                 "--display %s: this build has no display (Debian: libdrm-dev was not there)", spec);
}

void sv_drm_close(sv_drm *d) { d->fd = -1; }

static bool is_ready(sv_drm *d) {
  (void)d;
  return false;
}

static void flip(sv_drm *d) { (void)d; }

#endif

static sv_display_frame back_of(const sv_drm *d) {
  const sv_drm_buffer *b = &d->buffer[1 - d->i_front];
  return (sv_display_frame){b->px, b->stride_bytes, d->width_px, d->height_px};
}

static bool begin(void *self, sv_display_frame *frame) {
  sv_drm *d = self;
  if (!is_ready(d)) return false;
  *frame = back_of(d);
  return true;
}

static void text(void *self, int x_px, int y_px, int scale, const char *line) {
  const sv_display_frame f = back_of(self);
  sv_drm_text(&f, (const int[]){x_px, y_px}, scale, line);
}

static void commit(void *self) { flip(self); }

sv_display sv_drm_display(sv_drm *d) {
  return (sv_display){.self = d, .begin = begin, .text = text, .commit = commit};
}
