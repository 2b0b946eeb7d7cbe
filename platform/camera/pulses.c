// SPDX-License-Identifier: Apache-2.0
#include "platform/camera/pulses.h"

#include <errno.h>
#include <fcntl.h>
#include <linux/gpio.h>
#include <sched.h>
#include <signal.h>
#include <string.h>
#include <sys/ioctl.h>
#include <sys/prctl.h>
#include <time.h>
#include <unistd.h>

#include "platform/linux/linux.h"

// --- the system's calls and files ----------------------------------------------------------------
static int sys_open(void *self, const char *path) {
  (void)self;
  int fd = open(path, O_RDWR | O_CLOEXEC);
  return fd < 0 ? -errno : fd;
}
static int sys_close(void *self, int fd) {
  (void)self;
  return close(fd) < 0 ? -errno : 0;
}
static int sys_ioctl(void *self, int fd, unsigned long request, void *arg) {
  (void)self;
  int r = ioctl(fd, request, arg);
  return r < 0 ? -errno : r;
}

sv_pulses_sys sv_pulses_linux(void) { return (sv_pulses_sys){NULL, sys_open, sys_close, sys_ioctl, "/sys"}; }

static int write_file(const char *path, const char *text) {
  int fd = open(path, O_WRONLY | O_CLOEXEC), r = 0;
  if (fd < 0) return -errno;
  if (write(fd, text, strlen(text)) < 0) r = -errno;
  close(fd);
  return r;
}

// The first line of a file, without its end.
static int read_file(const char *path, char *text, size_t cap) {
  int fd = open(path, O_RDONLY | O_CLOEXEC);
  if (fd < 0) return -errno;
  ssize_t n = read(fd, text, cap - 1);
  int r = n < 0 ? -errno : 0;
  close(fd);
  text[n > 0 ? n : 0] = 0;
  text[strcspn(text, "\n")] = 0;
  return r;
}

// --- the sensors' driver -------------------------------------------------------------------------
static void mode_path(const sv_pulses *p, const sv_trigger_mode *m, char *path) {
  sv_fmt(path, SV_PULSES_PATH, "%s/module/%s/parameters/%s", p->sys.sys, m->module, m->name);
}

static sv_status set_mode(sv_pulses *p, sv_err *err) {
  sv_trigger_mode m;
  char path[SV_PULSES_PATH], want[16], now[32];
  if (!p->trigger.mode[0] || !sv_trigger_parse_mode(p->trigger.mode, strlen(p->trigger.mode), &m) ||
      !m.module[0])
    return SV_OK;
  mode_path(p, &m, path);
  int r = read_file(path, now, sizeof now);
  if (r < 0)
    return sv_fail(err, SV_E_NOT_FOUND,
                   "the trigger mode %s: %s cannot be read (%s); is the sensor's driver loaded?",
                   p->trigger.mode, path, sv_linux_reason(-r));
  sv_fmt(want, sizeof want, "%d", m.value);
  if (!strcmp(now, want)) return SV_OK;
  r = write_file(path, want);
  if (r < 0)
    return sv_fail(
        err, SV_E_DEVICE,
        "the trigger mode %s: %s is %s and cannot be changed (%s); write \"options %s %s=%d\" into a file "
        "in /etc/modprobe.d and restart",
        p->trigger.mode, path, now, sv_linux_reason(-r), m.module, m.name, m.value);
  memcpy(p->was_mode, now, sizeof p->was_mode);
  return SV_OK;
}

static void restore_mode(sv_pulses *p) {
  sv_trigger_mode m;
  char path[SV_PULSES_PATH];
  if (!p->was_mode[0] || !sv_trigger_parse_mode(p->trigger.mode, strlen(p->trigger.mode), &m)) return;
  mode_path(p, &m, path);
  (void)write_file(path, p->was_mode);
  p->was_mode[0] = 0;
}

// --- GPIO ----------------------------------------------------------------------------------------
static int call(const sv_pulses *p, int fd, unsigned long request, void *arg) {
  return p->sys.ioctl(p->sys.self, fd, request, arg);
}

static sv_status line_refused(const sv_pulses *p, int chip_fd, int error, sv_err *err) {
  const sv_trigger *t = &p->trigger;
  struct gpiochip_info chip;
  struct gpio_v2_line_info line;
  memset(&chip, 0, sizeof chip);
  memset(&line, 0, sizeof line);
  line.offset = (uint32_t)t->offset;
  if (call(p, chip_fd, GPIO_GET_CHIPINFO_IOCTL, &chip) >= 0 && (uint32_t)t->offset >= chip.lines)
    return sv_fail(err, SV_E_RANGE, "the trigger line gpio:%s:%d: the chip has the lines 0 to %d", t->chip,
                   t->offset, (int)chip.lines - 1);
  if (error == -EBUSY && call(p, chip_fd, GPIO_V2_GET_LINEINFO_IOCTL, &line) >= 0)
    return sv_fail(err, SV_E_DEVICE, "the trigger line gpio:%s:%d is used by \"%.31s\"", t->chip, t->offset,
                   line.consumer);
  return sv_fail(err, SV_E_DEVICE, "the trigger line gpio:%s:%d cannot be an output: %s", t->chip, t->offset,
                 sv_linux_reason(-error));
}

static sv_status open_gpio(sv_pulses *p, sv_err *err) {
  const sv_trigger *t = &p->trigger;
  char path[SV_PULSES_PATH];
  struct gpio_v2_line_request q;
  sv_fmt(path, sizeof path, "/dev/%s", t->chip);
  int chip_fd = p->sys.open(p->sys.self, path);
  if (chip_fd < 0)
    return sv_fail(err, chip_fd == -ENOENT ? SV_E_NOT_FOUND : SV_E_DEVICE,
                   "the trigger line gpio:%s:%d: %s cannot be opened: %s", t->chip, t->offset, path,
                   chip_fd == -EACCES ? "permission denied; add the user to the group gpio"
                                      : sv_linux_reason(-chip_fd));
  memset(&q, 0, sizeof q);
  q.offsets[0] = (uint32_t)t->offset;
  q.num_lines = 1;
  sv_copy(q.consumer, sizeof q.consumer, "subview");
  q.config.flags = GPIO_V2_LINE_FLAG_OUTPUT | (t->is_active_low ? GPIO_V2_LINE_FLAG_ACTIVE_LOW : 0);
  int r = call(p, chip_fd, GPIO_V2_GET_LINE_IOCTL, &q);
  sv_status s = r < 0 ? line_refused(p, chip_fd, r, err) : SV_OK;
  p->fd = r < 0 ? -1 : q.fd;
  p->sys.close(p->sys.self, chip_fd);
  return s;
}

static int set_line(const sv_pulses *p, bool is_active) {
  struct gpio_v2_line_values v = {.bits = is_active, .mask = 1};
  return call(p, p->fd, GPIO_V2_LINE_SET_VALUES_IOCTL, &v);
}

static sv_ns now_ns(void) {
  struct timespec t;
  clock_gettime(CLOCK_MONOTONIC, &t);
  return (sv_ns)t.tv_sec * SV_NS_PER_S + t.tv_nsec;
}

static void sleep_until(sv_ns ns) {
  const struct timespec t = {.tv_sec = ns / SV_NS_PER_S, .tv_nsec = ns % SV_NS_PER_S};
  while (clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &t, NULL) == EINTR) {
  }
}

static void note_late(sv_pulses_stats *s, sv_ns late_ns) {
  const sv_ns us = late_ns / SV_NS_PER_US;
  s->late_us[us < SV_PULSES_BINS - 1 ? us : SV_PULSES_BINS - 1]++;
  if (late_ns > s->max_late_ns) s->max_late_ns = late_ns;
  s->n_pulses++;
}

static void make_pulses(sv_pulses *p) {
  const sv_trigger *t = &p->trigger;
  sv_ns due_ns = now_ns() + t->period_ns;
  while (!p->is_stopping) {
    sleep_until(due_ns);
    int r = set_line(p, true);
    if (r >= 0) note_late(&p->stats, now_ns() - due_ns);
    sleep_until(due_ns + t->width_ns);
    if (r >= 0) r = set_line(p, false);
    if (r < 0) {
      p->stats.error = -r;
      return;
    }
    due_ns += t->period_ns;
    for (sv_ns t_ns = now_ns(); t_ns - due_ns > t->period_ns; due_ns += t->period_ns) p->stats.n_skipped++;
  }
}

// The highest of these that the system permits: a pulse that is late is seen by all cameras, so it
// comes before their thread, whose priority is 1.
static bool hurry(void) {
  static const int priorities[] = {50, 2, 1};
  (void)prctl(PR_SET_TIMERSLACK, 1UL, 0UL, 0UL, 0UL); // without a priority, sleeps end 50 us late
  for (size_t i = 0; i < sizeof priorities / sizeof *priorities; i++) {
    const struct sched_param q = {.sched_priority = priorities[i]};
    if (pthread_setschedparam(pthread_self(), SCHED_FIFO, &q) == 0) return true;
  }
  return false;
}

static void *body(void *arg) {
  sv_pulses *p = arg;
  const bool is_realtime = hurry();
  for (;;) {
    while (sem_wait(&p->go) < 0) {
    }
    if (p->is_quitting) return NULL;
    p->stats.is_realtime = is_realtime;
    make_pulses(p);
    sem_post(&p->done);
  }
}

static sv_status open_thread(sv_pulses *p, sv_err *err) {
  sigset_t all, old;
  sem_init(&p->go, 0, 0);
  sem_init(&p->done, 0, 0);
  sigfillset(&all); // Ctrl-C goes to the main thread
  pthread_sigmask(SIG_SETMASK, &all, &old);
  int e = pthread_create(&p->thread, NULL, body, p);
  pthread_sigmask(SIG_SETMASK, &old, NULL);
  p->has_thread = e == 0;
  return e ? sv_fail(err, SV_E_IO, "no thread for the trigger's pulses: %s", sv_linux_reason(e)) : SV_OK;
}

// --- PWM -----------------------------------------------------------------------------------------
static void pwm_path(const sv_pulses *p, const char *name, char *path) {
  const sv_trigger *t = &p->trigger;
  if (!name) sv_fmt(path, SV_PULSES_PATH, "%s/class/pwm/%s", p->sys.sys, t->chip);
  else sv_fmt(path, SV_PULSES_PATH, "%s/class/pwm/%s/pwm%d/%s", p->sys.sys, t->chip, t->offset, name);
}

static int write_pwm(const sv_pulses *p, const char *name, long long value) {
  char path[SV_PULSES_PATH], text[24];
  pwm_path(p, name, path);
  sv_fmt(text, sizeof text, "%lld", value);
  return write_file(path, text);
}

static int write_chip(const sv_pulses *p, const char *name) {
  char path[SV_PULSES_PATH], text[16];
  sv_fmt(path, sizeof path, "%s/class/pwm/%s/%s", p->sys.sys, p->trigger.chip, name);
  sv_fmt(text, sizeof text, "%d", p->trigger.offset);
  return write_file(path, text);
}

static sv_status pwm_fails(const sv_pulses *p, const char *what, int error, sv_err *err) {
  return sv_fail(err, SV_E_DEVICE, "the trigger line pwm:%s:%d: %s: %s", p->trigger.chip, p->trigger.offset,
                 what, sv_linux_reason(-error));
}

static sv_status export_channel(sv_pulses *p, sv_err *err) {
  const sv_trigger *t = &p->trigger;
  char path[SV_PULSES_PATH], text[16];
  long long n;
  sv_fmt(path, sizeof path, "%s/class/pwm/%s/npwm", p->sys.sys, t->chip);
  if (read_file(path, text, sizeof text) < 0 || !sv_parse_int(text, strlen(text), &n))
    return sv_fail(err, SV_E_NOT_FOUND, "the trigger line pwm:%s:%d: there is no %s/class/pwm/%s", t->chip,
                   t->offset, p->sys.sys, t->chip);
  if (t->offset >= n)
    return sv_fail(err, SV_E_RANGE, "the trigger line pwm:%s:%d: the chip has the channels 0 to %d", t->chip,
                   t->offset, (int)n - 1);
  pwm_path(p, "enable", path);
  if (access(path, F_OK) == 0) return SV_OK;
  int r = write_chip(p, "export");
  if (r < 0) return pwm_fails(p, "the channel cannot be taken", r, err);
  p->is_exported = true;
  // udev gives the group its rights a moment later
  for (int i = 0; i < 50 && access(path, W_OK) != 0; i++) usleep(20000);
  return SV_OK;
}

// The duty cycle first becomes 0: it must never be longer than the period.
static sv_status open_pwm(sv_pulses *p, sv_err *err) {
  const sv_trigger *t = &p->trigger;
  char path[SV_PULSES_PATH];
  sv_status s = export_channel(p, err);
  if (s < 0) return s;
  // A channel that was never used has the period 0 and refuses both.
  (void)write_pwm(p, "enable", 0);
  (void)write_pwm(p, "duty_cycle", 0);
  int r = write_pwm(p, "period", t->period_ns);
  if (r >= 0) r = write_pwm(p, "duty_cycle", t->width_ns);
  if (r < 0) return pwm_fails(p, "it does not take the pulses' period and width", r, err);
  pwm_path(p, "polarity", path);
  r = write_file(path, t->is_active_low ? "inversed" : "normal");
  if (r < 0 && t->is_active_low) return pwm_fails(p, "it has no polarity", r, err);
  return SV_OK;
}

// --- all lines -----------------------------------------------------------------------------------
sv_status sv_pulses_open(sv_pulses *p, const sv_trigger *t, const sv_pulses_sys *sys, sv_err *err) {
  memset(p, 0, sizeof *p);
  p->fd = -1;
  p->sys = *sys;
  p->trigger = *t;
  sv_status s = sv_trigger_complete(&p->trigger, err);
  if (s >= 0) s = t->kind == SV_LINE_GPIO ? open_gpio(p, err) : open_pwm(p, err);
  if (s >= 0 && t->kind == SV_LINE_GPIO) s = open_thread(p, err);
  if (s >= 0) s = set_mode(p, err);
  if (s < 0) sv_pulses_close(p);
  return s;
}

void sv_pulses_close(sv_pulses *p) {
  if (p->trigger.kind == SV_LINE_NONE) return;
  sv_pulses_stop(p);
  if (p->has_thread) {
    p->is_quitting = true;
    sem_post(&p->go);
    pthread_join(p->thread, NULL);
    sem_destroy(&p->go);
    sem_destroy(&p->done);
  }
  if (p->fd >= 0) p->sys.close(p->sys.self, p->fd);
  if (p->is_exported) (void)write_chip(p, "unexport");
  restore_mode(p);
  p->fd = -1;
  p->has_thread = p->is_exported = false;
  p->trigger.kind = SV_LINE_NONE;
}

sv_status sv_pulses_start(sv_pulses *p) {
  if (p->trigger.kind == SV_LINE_NONE || p->is_running) return SV_E_ARG;
  memset(&p->stats, 0, sizeof p->stats);
  if (p->trigger.kind == SV_LINE_PWM && write_pwm(p, "enable", 1) < 0) return SV_E_DEVICE;
  p->is_stopping = false;
  p->is_running = true;
  if (p->has_thread) sem_post(&p->go);
  return SV_OK;
}

void sv_pulses_stop(sv_pulses *p) {
  if (!p->is_running) return;
  p->is_stopping = true;
  while (p->has_thread && sem_wait(&p->done) < 0) {
  }
  if (p->trigger.kind == SV_LINE_PWM) (void)write_pwm(p, "enable", 0);
  p->is_running = false;
}

static sv_status start(void *self) { return sv_pulses_start(self); }
static void stop(void *self) { sv_pulses_stop(self); }

sv_camera_trigger sv_pulses_trigger(sv_pulses *p) { return (sv_camera_trigger){p, &p->trigger, start, stop}; }

sv_ns sv_pulses_late_ns(const sv_pulses_stats *s, double percent) {
  uint64_t n = 0;
  for (int i = 0; i < SV_PULSES_BINS - 1; i++) {
    n += s->late_us[i];
    if (n && (double)n >= percent * 0.01 * (double)s->n_pulses) return (i + 1) * SV_NS_PER_US;
  }
  return s->max_late_ns;
}
