// SPDX-License-Identifier: Apache-2.0
#include <time.h>

#include "platform/linux/linux.h"

static sv_ns now_ns(void *self) {
  (void)self;
  struct timespec t;
  clock_gettime(CLOCK_MONOTONIC, &t);
  return (sv_ns)t.tv_sec * SV_NS_PER_S + t.tv_nsec;
}

static void sleep_until_ns(void *self, sv_ns host_ns) {
  (void)self;
  if (host_ns <= 0) return;
  struct timespec t = {.tv_sec = (time_t)(host_ns / SV_NS_PER_S), .tv_nsec = (long)(host_ns % SV_NS_PER_S)};
  clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &t, NULL); // EINTR: the caller looks again
}

sv_clock sv_linux_clock(void) { return (sv_clock){NULL, now_ns, sleep_until_ns}; }
