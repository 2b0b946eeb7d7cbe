// SPDX-License-Identifier: Apache-2.0
// C only: the port is.
// Display cards that are not there, behind the table of system calls: card0 renders only, card1 has
// HDMI-A-1, a writeback connector and DSI-1. Flips end when a test says so. Counts what is open.
#ifndef SV_TESTS_COMMON_FAKE_DRM_H
#define SV_TESTS_COMMON_FAKE_DRM_H

#include "platform/drm/drm.h"

#define FAKE_DRM_CAP_BUFFERS 4
#define FAKE_DRM_CAP_BYTES   (1920 * 1200 * 4)
#define FAKE_DRM_FBCON       7 // the picture before

typedef struct {
  bool is_hdmi_there, is_dsi_there; // DSI-1 has 800x480; HDMI-A-1 has 3840x2160, its preferred
                                    // mode, 1920x1080 and 1280x720
  bool has_no_cards, has_other_master, is_mode_refused;
  int open_errno;         // of all cards; 0: they open
  bool are_flips_waiting; // a flip does not end by itself
  bool are_flips_refused;
  int n_allocs_left; // dumb buffers that the driver gives
  // what it does
  int n_open, fd, n_mapped;
  struct {
    uint32_t width_px, height_px, stride_bytes;
    bool is_used, has_fb;
    uint8_t px[FAKE_DRM_CAP_BYTES];
  } buffer[FAKE_DRM_CAP_BUFFERS];
  uint32_t fb_id; // that is shown; 0: the screen is off
  uint32_t width_px, height_px;
  bool is_flip_pending, has_event;
} fake_drm;

void fake_drm_init(fake_drm *f);
sv_drm_sys fake_drm_sys(fake_drm *f);
int fake_drm_n_buffers(const fake_drm *f);
// What the screen shows; width 0: it is off, or shows the picture before.
sv_display_frame fake_drm_shown(fake_drm *f);

#endif
