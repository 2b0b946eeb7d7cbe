// SPDX-License-Identifier: Apache-2.0
// Pulses on a trigger line: a GPIO line that a thread switches (Linux's character device, its
// second interface), or a PWM channel, whose hardware makes them (sysfs). Opening takes the line
// and sets the sensors' driver up; pulses begin when the cameras stream, and end before they stop.
// Owns the line and the thread. Never allocates between start and stop.
#ifndef SV_PLATFORM_CAMERA_PULSES_H
#define SV_PLATFORM_CAMERA_PULSES_H

#include <pthread.h>
#include <semaphore.h>
#include <stdint.h>

#include "platform/camera/options.h"

#ifdef __cplusplus
#define SV_PULSES_ATOMIC(type) type
extern "C" {
#else
#include <stdatomic.h>
#define SV_PULSES_ATOMIC(type) _Atomic(type)
#endif

// The system calls on GPIO chips, and where the system's files are; tests put their own here.
// Failures are negative error numbers.
typedef struct {
  void *self;
  int (*open)(void *self, const char *path);
  int (*close)(void *self, int fd);
  int (*ioctl)(void *self, int fd, unsigned long request, void *arg);
  const char *sys; // "/sys"
} sv_pulses_sys;
sv_pulses_sys sv_pulses_linux(void);

#define SV_PULSES_BINS 4096 // of a microsecond; the last has all later ones
#define SV_PULSES_PATH 128

typedef struct {
  uint64_t n_pulses;
  uint64_t n_skipped;               // a period late: left out, the grid goes on
  uint32_t late_us[SV_PULSES_BINS]; // how long after its time a pulse was on the line
  sv_ns max_late_ns;
  bool is_realtime; // the thread has real-time priority
  int error;        // error number that ended the pulses; 0: none
} sv_pulses_stats;

typedef struct {
  sv_trigger trigger; // completed; NONE: not open
  sv_pulses_sys sys;
  int fd;            // of the GPIO line; -1: none
  bool is_exported;  // the PWM channel was exported here
  char was_mode[32]; // the module's parameter before; "": not changed
  pthread_t thread;
  bool has_thread, is_running;
  sem_t go, done;
  SV_PULSES_ATOMIC(bool) is_stopping, is_quitting;
  sv_pulses_stats stats; // the thread's until stop
} sv_pulses;

// Takes the line, inactive, and starts the thread that waits. E_NOT_FOUND, E_RANGE, E_DEVICE,
// E_UNSUPPORTED with a sentence that says why there is no such line. p must not move afterwards.
sv_status sv_pulses_open(sv_pulses *p, const sv_trigger *t, const sv_pulses_sys *sys,
                         sv_err *err) SV_MUST_USE;
// What was changed outside is as before. Not open: does nothing.
void sv_pulses_close(sv_pulses *p);

// Starts new pulses and new figures, and ends them with the line inactive.
sv_status sv_pulses_start(sv_pulses *p) SV_MUST_USE;
void sv_pulses_stop(sv_pulses *p);
// For sv_camera_options.trigger: the cameras' source starts and stops the pulses.
sv_camera_trigger sv_pulses_trigger(sv_pulses *p);

// So many percent of the pulses were late by at most so much, to a microsecond.
sv_ns sv_pulses_late_ns(const sv_pulses_stats *s, double percent);

#ifdef __cplusplus
}
#endif
#endif
