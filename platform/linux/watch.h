// SPDX-License-Identifier: Apache-2.0
// C only: heartbeats are.
// Who watches the run on Linux: heartbeats, the processor's temperature, and a system watchdog that
// speaks sd_notify's protocol (datagrams to $NOTIFY_SOCKET: systemd, and others; no library of
// theirs). Owns the descriptors, opened before the run. Never allocates, never blocks, and restarts
// nothing itself.
#ifndef SV_PLATFORM_LINUX_WATCH_H
#define SV_PLATFORM_LINUX_WATCH_H

#include <sys/socket.h>
#include <sys/un.h>

#include "src/port/heartbeat.h"

typedef struct {
  sv_heartbeats beats;
  sv_beat_of own[SV_CAP_BEATS]; // where there is no feed
  int temperature_fd, throttled_fd, notify_fd;
  struct sockaddr_un to; // of the watchdog
  socklen_t n_to;
  bool is_ready; // the watchdog knows
} sv_linux_watch;

// sys: "/sys", or a folder like it in a test. Reads NOTIFY_SOCKET, WATCHDOG_USEC and WATCHDOG_PID,
// and takes them out of the environment: they are not for the programs that this one starts. What
// is not there is left out. *w stays where it is.
void sv_linux_watch_open(sv_linux_watch *w, const char *sys);
// Heartbeats go to the feed, for the page. NULL: to memory of the watch's own.
void sv_linux_watch_share(sv_linux_watch *w, sv_beat_of *beats);
// Tells the watchdog READY=1, once. From then on it gets WATCHDOG=1, four times in its interval,
// while the main thread makes progress and no other thread is late by half of that interval.
void sv_linux_watch_ready(sv_linux_watch *w);
sv_thermometer sv_linux_thermometer(sv_linux_watch *w);
void sv_linux_watch_close(sv_linux_watch *w); // tells STOPPING=1

#endif
