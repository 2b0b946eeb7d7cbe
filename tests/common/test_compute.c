// SPDX-License-Identifier: Apache-2.0
#include "platform/linux/linux.h"
#include "tests/common/test.h"

sv_compute compute_serial(void) {
  static sv_kernels kernels;
  static sv_pool serial;
  sv_kernels_init(&kernels, ~0u);
  serial = sv_pool_serial();
  return (sv_compute){&kernels, &serial};
}

static sv_linux_pool threads;

sv_compute compute_start(uint32_t isa_mask, int n_threads) {
  static sv_kernels kernels;
  static sv_pool pool;
  sv_err err = {.text = ""};
  compute_end();
  sv_kernels_init(&kernels, isa_mask);
  assert_ok(sv_linux_pool_start(&threads, n_threads, -1, &err), &err);
  pool = sv_linux_pool_port(&threads);
  return (sv_compute){&kernels, &pool};
}

void compute_end(void) {
  if (threads.n_threads) sv_linux_pool_stop(&threads);
  threads.n_threads = 0;
}
