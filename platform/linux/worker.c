// SPDX-License-Identifier: Apache-2.0
#include "platform/linux/linux.h"

#include <sched.h>
#include <signal.h>

// Highest priority, where the system permits it: a frame that is not fetched in time is lost.
static void hurry(void) {
  const struct sched_param p = {.sched_priority = 1};
  (void)pthread_setschedparam(pthread_self(), SCHED_FIFO, &p);
}

static void *body(void *arg) {
  sv_linux_background *b = arg;
  hurry();
  if (b->cpu >= 0) (void)sv_linux_take_cpu(b->cpu); // without it the thread still works
  b->fn(b->arg);
  return NULL;
}

static sv_status start(void *self, void (*fn)(void *arg), void *arg) {
  sv_linux_background *b = self;
  sigset_t all, old;
  if (b->is_running) return SV_E_ARG;
  b->fn = fn;
  b->arg = arg;
  sigfillset(&all); // Ctrl-C goes to the main thread
  pthread_sigmask(SIG_SETMASK, &all, &old);
  int e = pthread_create(&b->id, NULL, body, b);
  pthread_sigmask(SIG_SETMASK, &old, NULL);
  b->is_running = e == 0;
  return e ? SV_E_IO : SV_OK;
}

static void join(void *self) {
  sv_linux_background *b = self;
  if (b->is_running) pthread_join(b->id, NULL);
  b->is_running = false;
}

sv_worker sv_linux_worker_port(sv_linux_background *b) {
  *b = (sv_linux_background){.cpu = -1};
  return (sv_worker){b, start, join};
}
