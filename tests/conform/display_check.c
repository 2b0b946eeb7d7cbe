// SPDX-License-Identifier: Apache-2.0
// A screen that is there: trains a small model with it, reads the frame that the card shows back
// through a descriptor of its own, and compares each pixel with the runtime's rendering. As root,
// since others' frames are not for everybody.
//
//   display-check SCREEN          as of subview run --display; exit code 0: no pixel differs
//   display-check --look SCREEN   what another program shows there: its size, and how many colors
#include <fcntl.h>
#include <stdio.h>
#include <string.h>
#include <sys/ioctl.h>
#include <sys/mman.h>
#include <unistd.h>

#include <libdrm/drm.h>
#include <libdrm/drm_mode.h>

#include "platform/drm/drm.h"
#include "tests/common/display_run.h"

static world w;
static sv_drm d;

// The frame that a CRTC of the card shows. False: it shows none, or it is not to be had.
static bool read_back(int fd, sv_display_frame *f) {
  uint32_t crtcs[32];
  struct drm_mode_card_res r = {0};
  if (ioctl(fd, DRM_IOCTL_MODE_GETRESOURCES, &r) < 0 || r.count_crtcs > 32) return false;
  r = (struct drm_mode_card_res){.crtc_id_ptr = (uint64_t)(uintptr_t)crtcs, .count_crtcs = r.count_crtcs};
  if (ioctl(fd, DRM_IOCTL_MODE_GETRESOURCES, &r) < 0) return false;
  for (uint32_t i = 0; i < r.count_crtcs; i++) {
    struct drm_mode_crtc c = {.crtc_id = crtcs[i]};
    if (ioctl(fd, DRM_IOCTL_MODE_GETCRTC, &c) < 0 || !c.fb_id) continue;
    struct drm_mode_fb_cmd fb = {.fb_id = c.fb_id};
    if (ioctl(fd, DRM_IOCTL_MODE_GETFB, &fb) < 0 || !fb.handle) return false;
    struct drm_mode_map_dumb m = {.handle = fb.handle};
    if (ioctl(fd, DRM_IOCTL_MODE_MAP_DUMB, &m) < 0) return false;
    void *px = mmap(NULL, (size_t)fb.pitch * fb.height, PROT_READ, MAP_SHARED, fd, (off_t)m.offset);
    if (px == MAP_FAILED) return false;
    *f = (sv_display_frame){px, fb.pitch, (int)fb.width, (int)fb.height};
    return true;
  }
  return false;
}

// By their upper four bits.
static int n_colors(const sv_display_frame *f) {
  static bool is_seen[4096];
  int n = 0;
  for (int y = 0; y < f->height_px; y++)
    for (int x = 0; x < f->width_px; x++) {
      const uint8_t *p = f->px + (size_t)y * f->stride_bytes + 4 * (size_t)x;
      const int i = (p[0] >> 4) | (p[1] & 0xf0) | (p[2] & 0xf0) << 4;
      n += !is_seen[i];
      is_seen[i] = true;
    }
  return n;
}

static int look(const char *card) {
  sv_display_frame f;
  const int fd = open(card, O_RDWR | O_CLOEXEC);
  if (fd < 0) return 1;
  (void)ioctl(fd, DRM_IOCTL_DROP_MASTER, NULL); // whoever opens a card first would be its master
  if (read_back(fd, &f)) printf("%dx%d, colors: %d\n", f.width_px, f.height_px, n_colors(&f));
  else printf("off\n");
  return 0;
}

static int compare(const char *screen) {
  const sv_drm_sys sys = sv_drm_linux();
  sv_display_frame f;
  long n;
  if (sv_drm_open(&d, screen, &sys, &w.err) < 0) {
    printf("%s\n", w.err.text);
    return 1;
  }
  const sv_display display = sv_drm_display(&d);
  if (!display_run(&w, &display)) {
    printf("%s\n", w.err.text);
    return 1;
  }
  const char *card = strstr(d.name, "/dev/dri/");
  const int fd = open(card, O_RDWR | O_CLOEXEC);
  if (fd < 0 || !read_back(fd, &f)) {
    printf("%s: its frame cannot be read back\n", d.name);
    return 1;
  }
  const long n_other = display_differences(&w, &f, &n);
  printf("%s, %dx%d at %.4g Hz, %u frames shown: of %ld pixels of model and cameras %ld differ\n", d.name,
         f.width_px, f.height_px, d.rate_hz, d.n_flips, n, n_other);
  world_close(&w);
  sv_drm_close(&d);
  return n_other || n < 10000;
}

int main(int argc, char **argv) {
  if (argc == 3 && !strcmp(argv[1], "--look"))
    return look(strcmp(argv[2], "auto") ? argv[2] : "/dev/dri/card0");
  if (argc == 2) return compare(argv[1]);
  fprintf(stderr, "usage: display-check [--look] SCREEN\n");
  return 2;
}
