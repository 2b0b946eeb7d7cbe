// SPDX-License-Identifier: Apache-2.0
// C only: the port is.
// A screen at HDMI, DSI or another connector, by the kernel's DRM/KMS: two dumb buffers of the
// driver, of which one is shown and the other drawn. Owns the card's descriptor and the buffers,
// all made at open; the former picture comes back at close. Never waits for the screen and never
// allocates.
#ifndef SV_PLATFORM_DRM_DRM_H
#define SV_PLATFORM_DRM_DRM_H

#include "platform/drm/sys.h"
#include "src/port/port.h"

#define SV_DRM_MODE_WORDS 17 // of a struct drm_mode_modeinfo, 32 bits each
#define SV_DRM_CRTC_WORDS 13 // of a struct drm_mode_crtc, 64 bits each

typedef struct {
  uint32_t handle, fb_id, stride_bytes;
  size_t bytes;
  uint8_t *px;
} sv_drm_buffer;

typedef struct {
  sv_drm_sys sys;
  int fd;        // -1: not open
  char name[64]; // "HDMI-A-1 of /dev/dri/card1"
  int width_px, height_px;
  double rate_hz;
  uint32_t connector_id, crtc_id;
  sv_drm_buffer buffer[2];
  int i_front; // of the two the one that is shown
  bool is_flipping;
  uint32_t n_flips, n_refused; // frames that were shown; that the card did not take
  uint32_t mode[SV_DRM_MODE_WORDS];
  uint64_t former[SV_DRM_CRTC_WORDS];
} sv_drm;

// Opens a screen and shows black. spec: "auto", the first card with a connected screen; or
// CARD[:CONNECTOR], "card1" or "/dev/dri/card1:HDMI-A-1". The mode is the screen's preferred one,
// but at most 1920x1200 where it has another. E_NOT_FOUND: no card, no such connector, or no
// screen; E_DEVICE: no permission, another program has the screen, or the card refuses;
// E_UNSUPPORTED: built without DRM's headers.
sv_status sv_drm_open(sv_drm *d, const char *spec, const sv_drm_sys *sys, sv_err *err) SV_MUST_USE;
sv_display sv_drm_display(sv_drm *d);
void sv_drm_close(sv_drm *d); // also of one that did not open

#endif
