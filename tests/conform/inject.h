// SPDX-License-Identifier: Apache-2.0
// What makes a camera fail: the fault controls of the kernel's vivid driver, a device node that
// goes and comes back under another number, and frames played into v4l2loopback devices that are
// not what they should be.
#ifndef SV_TESTS_CONFORM_INJECT_H
#define SV_TESTS_CONFORM_INJECT_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "src/base/time.h"

#define INJECT_CAP_CAMERAS 4
#define INJECT_CAP_BUFFERS 16

typedef enum { INJECT_GOOD, INJECT_SHORT, INJECT_OTHER_SIZE, INJECT_SILENCE } inject_kind;

typedef struct {
  int fd;
  uint8_t *map[INJECT_CAP_BUFFERS];
  size_t bytes; // of a buffer
  unsigned n, i_next;
} inject_feeder;

typedef struct {
  char path[INJECT_CAP_CAMERAS][64]; // of the cameras, the first of which is to fail
  char first_path[64];               // what the first one was called
  int n_cameras;
  bool is_feeding;
  inject_feeder feeder[INJECT_CAP_CAMERAS];
  inject_kind kind; // of what the first one is fed with
  sv_ns next_ns;
  uint8_t jpeg[2][16384]; // of the right size; of another
  size_t jpeg_bytes[2];
} inject;

// "/dev/video0,/dev/video1,..."; words that are not device names are left out. False: told on
// stderr.
bool inject_open(inject *j, const char *cameras, bool is_feeding);
void inject_close(inject *j);
// Sets a control of the first camera by the name that v4l2-ctl gives it.
bool inject_control(inject *j, const char *name, long value);
bool inject_unplug(inject *j);  // its device fails and its node is gone
bool inject_replug(inject *j);  // the node is back, under another number
void inject_restore(inject *j); // and under its first one
bool inject_short(inject *j);
bool inject_other_size(inject *j);
bool inject_silence(inject *j);
bool inject_good(inject *j);
// Plays what is due; when the next frames are (INT64_MAX: nothing is fed).
sv_ns inject_feed(inject *j, sv_ns now_ns);

#endif
