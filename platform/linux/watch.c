// SPDX-License-Identifier: Apache-2.0
#include "platform/linux/watch.h"

#include <errno.h>
#include <fcntl.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>
#include <unistd.h>

#include "src/base/str.h"

#define CAP_ZONES 16

// Some milliseconds fine, and about a nanosecond cheap: a beat may come with each task.
static sv_ns coarse_ns(void *self) {
  struct timespec t;
  (void)self;
  clock_gettime(CLOCK_MONOTONIC_COARSE, &t);
  return (sv_ns)t.tv_sec * SV_NS_PER_S + t.tv_nsec;
}

// --- temperature ---------------------------------------------------------------------------------

static bool is_of_processor(const char *sys, int i) {
  static const char *const words[] = {"cpu", "soc", "pkg"};
  char path[300], type[64];
  sv_fmt(path, sizeof path, "%s/class/thermal/thermal_zone%d/type", sys, i);
  int fd = open(path, O_RDONLY | O_CLOEXEC);
  ssize_t n = fd < 0 ? 0 : read(fd, type, sizeof type - 1);
  if (fd >= 0) close(fd);
  type[n > 0 ? n : 0] = 0;
  for (size_t k = 0; k < sizeof words / sizeof *words; k++)
    if (strstr(type, words[k])) return true;
  return false;
}

// The first zone that is named after a processor, else the first of all.
static int open_temperature(const char *sys) {
  char path[300];
  int i = 0;
  while (i < CAP_ZONES && !is_of_processor(sys, i)) i++;
  sv_fmt(path, sizeof path, "%s/class/thermal/thermal_zone%d/temp", sys, i < CAP_ZONES ? i : 0);
  return open(path, O_RDONLY | O_CLOEXEC);
}

static long read_number(int fd, int base, long missing) {
  char text[32], *end;
  ssize_t n = fd < 0 ? -1 : pread(fd, text, sizeof text - 1, 0);
  if (n <= 0) return missing;
  text[n] = 0;
  long v = strtol(text, &end, base);
  return end == text ? missing : v;
}

// Bits 0 to 3 of the Raspberry Pi's get_throttled tell what is so now; elsewhere only the
// temperature is known.
static sv_heat read_heat(void *self) {
  const sv_linux_watch *w = self;
  long milli_c = read_number(w->temperature_fd, 10, -1000000), flags = read_number(w->throttled_fd, 16, -1);
  return (sv_heat){.temperature_c = milli_c > -1000000 ? (double)milli_c * 1e-3 : (double)NAN,
                   .is_throttled = flags < 0 ? -1 : (flags & 0xf) != 0};
}

sv_thermometer sv_linux_thermometer(sv_linux_watch *w) { return (sv_thermometer){w, read_heat}; }

// --- system watchdog -----------------------------------------------------------------------------

static void notify(sv_linux_watch *w, const char *text) {
  if (w->notify_fd < 0) return;
  // A watchdog that is gone, or does not read, is none of the run's business.
  (void)!sendto(w->notify_fd, text, strlen(text), MSG_NOSIGNAL | MSG_DONTWAIT, (struct sockaddr *)&w->to,
                w->n_to);
}

static void tell_alive(void *self) { notify(self, "WATCHDOG=1"); }

static void open_notify(sv_linux_watch *w) {
  const char *path = getenv("NOTIFY_SOCKET");
  const size_t n = path ? strlen(path) : 0;
  if (n < 2 || n >= sizeof w->to.sun_path || (path[0] != '/' && path[0] != '@')) return;
  w->notify_fd = socket(AF_UNIX, SOCK_DGRAM | SOCK_CLOEXEC, 0);
  w->to.sun_family = AF_UNIX;
  memcpy(w->to.sun_path, path, n);
  if (path[0] == '@') w->to.sun_path[0] = 0; // of the abstract namespace, without an end
  w->n_to = (socklen_t)(offsetof(struct sockaddr_un, sun_path) + n + (path[0] == '/'));
}

// The watchdog's interval; 0: it does not ask for signs of life from this process.
static sv_ns interval_ns(void) {
  const char *usec = getenv("WATCHDOG_USEC"), *pid = getenv("WATCHDOG_PID");
  long long us, of;
  if (!usec || !sv_parse_int(usec, strlen(usec), &us) || us < 1 || us > 86400000000ll) return 0;
  if (pid && (!sv_parse_int(pid, strlen(pid), &of) || of != getpid())) return 0;
  return us * SV_NS_PER_US;
}

void sv_linux_watch_ready(sv_linux_watch *w) {
  if (!w->is_ready) notify(w, "READY=1");
  w->is_ready = true;
}

// --- open and close ------------------------------------------------------------------------------

void sv_linux_watch_open(sv_linux_watch *w, const char *sys) {
  char path[300];
  *w = (sv_linux_watch){.notify_fd = -1};
  w->beats = (sv_heartbeats){.clock = {w, coarse_ns, NULL}, .beats = w->own, .self = w};
  w->temperature_fd = open_temperature(sys);
  sv_fmt(path, sizeof path, "%s/devices/platform/soc/soc:firmware/get_throttled", sys);
  w->throttled_fd = open(path, O_RDONLY | O_CLOEXEC);
  open_notify(w);
  const sv_ns every_ns = w->notify_fd < 0 ? 0 : interval_ns();
  if (every_ns > 0) {
    w->beats.alive = tell_alive;
    w->beats.alive_every_ns = every_ns / 4;
    w->beats.late_ns = every_ns / 2;
  }
  unsetenv("NOTIFY_SOCKET");
  unsetenv("WATCHDOG_USEC");
  unsetenv("WATCHDOG_PID");
}

void sv_linux_watch_share(sv_linux_watch *w, sv_beat_of *beats) { w->beats.beats = beats ? beats : w->own; }

void sv_linux_watch_close(sv_linux_watch *w) {
  int *fds[] = {&w->temperature_fd, &w->throttled_fd, &w->notify_fd};
  notify(w, "STOPPING=1");
  for (size_t i = 0; i < sizeof fds / sizeof *fds; i++) {
    if (*fds[i] >= 0) close(*fds[i]);
    *fds[i] = -1;
  }
}
