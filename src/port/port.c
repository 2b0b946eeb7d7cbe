// SPDX-License-Identifier: Apache-2.0
#include "src/port/port.h"

static void run_serial(void *self, sv_task_fn fn, void *arg, int n_tasks) {
  (void)self;
  for (int i = 0; i < n_tasks; i++) fn(arg, i, 0);
}

sv_pool sv_pool_serial(void) { return (sv_pool){.self = 0, .n_threads = 1, .run = run_serial}; }
