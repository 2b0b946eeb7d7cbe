// SPDX-License-Identifier: Apache-2.0
// What every source of frames must do: the checks, for any sv_source. The request counts are those
// of libcamera's compliance suite. Needs no test framework: it also runs on the virtual board and
// on real cameras.
#ifndef SV_TESTS_COMMON_SOURCE_SUITE_H
#define SV_TESTS_COMMON_SOURCE_SUITE_H

#include "src/port/port.h"

#define SOURCE_SUITE_N_COUNTS 10
extern const int source_suite_counts[SOURCE_SUITE_N_COUNTS];

typedef struct {
  sv_source source;
  sv_clock clock;
  int n_frames;    // after which it ends; 0: never
  bool may_lose;   // frames may be damaged or missing (real cameras, slow machines)
  sv_ns wait_ns;   // for one frame; 0: 10 s
  char why[256];   // the first thing that was wrong
  uint64_t n_seen; // frames looked at
} source_suite;

// start, n frames each handed back at once, stop.
bool source_suite_capture(source_suite *s, int n);
bool source_suite_start_stop(source_suite *s, int n); // the same three times
// stop before any start; n frames not handed back; stop twice; then all buffers are there again.
bool source_suite_unbalanced(source_suite *s, int n);
bool source_suite_bad_calls(source_suite *s);

#endif
