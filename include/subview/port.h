// SPDX-License-Identifier: Apache-2.0
// What a machine may offer to an instance: threads. All of it is optional.
// Owns: the interface of a thread pool.
// Never: starts a thread, reads a clock or opens a file.
#ifndef SUBVIEW_PORT_H
#define SUBVIEW_PORT_H

#ifdef __cplusplus
extern "C" {
#endif

typedef void (*subview_task)(void *arg, int i_task, int i_thread);

// A fixed pool of threads. All zero: everything runs on the caller's thread.
// `run` calls task(arg, i_task, i_thread) once for each i_task in [0, n_tasks), in any order on any
// thread, and returns when all are done. i_thread is in [0, n_threads) and unique among the calls
// that run at the same time. Results do not depend on the number of threads, bit for bit.
typedef struct {
  void *self;
  int n_threads;
  void (*run)(void *self, subview_task task, void *arg, int n_tasks);
} subview_pool;

#ifdef __cplusplus
}
#endif
#endif
