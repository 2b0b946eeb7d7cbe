// SPDX-License-Identifier: Apache-2.0
// V4L2 cameras that are not there, behind the table of system calls: as many as CAP, on a virtual
// clock that moves while poll waits, with every fault a real one has. Buffers are pages that are
// counted; what is unmapped is overwritten, so that a reader who comes too late sees it.
#ifndef SV_TESTS_COMMON_FAKE_V4L2_H
#define SV_TESTS_COMMON_FAKE_V4L2_H

#include "platform/v4l2/v4l2.h"

#define FAKE_V4L2_CAP_DEVICES 4
#define FAKE_V4L2_CAP_BUFFERS 32
#define FAKE_V4L2_CAP_PAGES   160
#define FAKE_V4L2_PAGE_BYTES  32768
#define FAKE_V4L2_WIDTH_PX    64
#define FAKE_V4L2_HEIGHT_PX   48
#define FAKE_V4L2_PERIOD_NS   (40 * SV_NS_PER_MS)
#define FAKE_V4L2_N_CONTROLS  8

typedef struct {
  bool is_queued, is_done, is_dequeued;
  int i_page[2]; // of each plane; -1: not mapped
  uint32_t sequence, flags, bytes;
  sv_ns stamp_ns;
} fake_buffer;

typedef struct {
  // what a test may change
  bool is_unplugged;        // everything fails with ENODEV
  bool is_fatal;            // the queue is broken: POLLERR, EIO, until it is streamed anew
  bool is_silent;           // no frames
  bool is_busy;             // another program uses it
  bool is_other_size;       // agrees on half the width only
  bool is_other_camera;     // another one was plugged in
  bool is_streamon_failing; // STREAMON fails
  bool has_frozen_sequence, is_short, is_flagged, is_wrong_jpeg;
  double max_fps_raw; // of formats that are not compressed; 0: as all
  bool has_controls, is_mplane;
  bool has_blanking; // 64 + 56 pixels a line, 48 + 52 lines a frame at 25 fps can be set
  // x, y, width and height of its crop, which fills the frame; 0: it does not tell
  int crop_px[4], bounds_px[2];
  bool is_letterbox;     // the crop fills the upper half only
  bool has_trigger;      // a control of its own, "Trigger Mode", is its last one
  bool can_set_rate;     // its frame interval can be set while it runs
  bool is_coarse;        // but only to one of a few
  bool has_short_chroma; // the second plane has half of its bytes
  // an input with a signal of its own
  bool is_hdmi;
  int signal_errno;              // 0: there is one
  int signal_width_px;           // 0: as set
  bool has_event, is_subscribed; // SOURCE_CHANGE waits
  int n_delay;                   // frames until a new exposure time is in effect
  // what it does
  int32_t exposure[64]; // value of the control when frame number % 64 began
  int n_open, fd;
  bool is_streaming;
  uint32_t fourcc;
  int width_px, height_px;
  sv_ns interval_ns; // of its frames, when it was set
  int n_buffers;
  fake_buffer buffer[FAKE_V4L2_CAP_BUFFERS];
  uint32_t sequence;
  sv_ns next_ns;
  int32_t control[FAKE_V4L2_N_CONTROLS];
  int n_streamons, n_exports;
} fake_device;

typedef struct {
  fake_device device[FAKE_V4L2_CAP_DEVICES];
  int n_devices;
  sv_ns now_ns;
  uint8_t page[FAKE_V4L2_CAP_PAGES][FAKE_V4L2_PAGE_BYTES];
  uint8_t page_state[FAKE_V4L2_CAP_PAGES]; // 0 free, 1 mapped, 2 detached
  uint8_t jpeg[2][8192];                   // of the right size, of another
  size_t jpeg_bytes[2];
  int n_exported; // descriptors open
  // the at-th call of device 0 fails (or every one from there on)
  long n_calls, fail_at;
  bool is_lasting, was_hit;
  int fail_errno;
  uint8_t block[1 << 20]; // for the source under test
} fake_v4l2;

void fake_v4l2_init(fake_v4l2 *f, int n_devices); // "/dev/video0" and on, YUYV 64x48 at 25 fps
sv_v4l2_sys fake_v4l2_sys(fake_v4l2 *f);
sv_clock fake_v4l2_clock(fake_v4l2 *f);
int fake_v4l2_n_open(const fake_v4l2 *f);   // descriptors, exported buffers included
int fake_v4l2_n_mapped(const fake_v4l2 *f); // pages, detached ones included
void fake_v4l2_unplug(fake_v4l2 *f, int i); // frames in the driver are gone
void fake_v4l2_plug(fake_v4l2 *f, int i);   // back, with all settings as new
// The signal at input i is another one (width 0: the old one again; an error number: none), and the
// driver says so.
void fake_v4l2_signal(fake_v4l2 *f, int i, int width_px, int error);
// With which exposure time one of the last 50 frames was taken.
sv_ns fake_v4l2_exposure_ns(const fake_device *d, uint32_t sequence);
// Was the picture written by frame number `sequence` of device i, and is it still so?
bool fake_v4l2_is_frame(const uint8_t *data, int i, uint32_t sequence);

#endif
