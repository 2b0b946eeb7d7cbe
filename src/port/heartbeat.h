// SPDX-License-Identifier: Apache-2.0
// C only: C++ has no _Atomic.
// Heartbeats: when each thread of the runtime made progress last, for those who watch it from
// outside: the page, the report, a system watchdog. Owns nothing: the beats are the caller's, and
// may lie in memory that another process reads. A beat is one atomic store: no lock, no heap, no
// system call of its own. Never waits, and never changes what is computed.
#ifndef SV_PORT_HEARTBEAT_H
#define SV_PORT_HEARTBEAT_H

#include <stdatomic.h>

#include "src/port/port.h"

// Thread k of the pool, from 1 on, is SV_BEAT_POOL + k - 1; its thread 0 is the main thread.
typedef enum { SV_BEAT_MAIN, SV_BEAT_CAMERAS, SV_BEAT_POOL } sv_beat_thread;
#define SV_CAP_BEATS 65

typedef struct {
  // of the last progress; 0: the thread rests, so it cannot be late
  _Alignas(64) _Atomic int64_t ns;
  _Atomic int64_t longest_ns; // the longest time between two of them without rest
} sv_beat_of;

typedef struct sv_heartbeats {
  sv_clock clock;    // real time, also where the cameras' time is virtual
  sv_beat_of *beats; // [SV_CAP_BEATS], all zero at the start
  // For a watchdog: called on the main thread, after a beat of it, at most every alive_every_ns,
  // and only while no thread is late by more than late_ns. NULL: nobody asks.
  void (*alive)(void *self);
  void *self;
  sv_ns alive_every_ns, late_ns, next_alive_ns;
} sv_heartbeats;

// The thread made progress. h may be NULL.
void sv_beat(sv_heartbeats *h, int i_thread);
// Likewise, and it begins something that has no beats of its own and may take so long: the thread
// is late only afterwards.
void sv_beat_for(sv_heartbeats *h, int i_thread, sv_ns allowed_ns);
// The thread has nothing to do until its next beat.
void sv_beat_rest(sv_heartbeats *h, int i_thread);
// Since the last progress; 0 for a thread that rests.
sv_ns sv_beat_age_ns(const sv_beat_of *beats, int i_thread, sv_ns now_ns);
sv_ns sv_beat_longest_ns(const sv_beat_of *beats, int i_thread);
// The thread with the largest age; *age_ns is 0 when all rest.
int sv_beat_oldest(const sv_beat_of *beats, sv_ns now_ns, sv_ns *age_ns);
// "main", "cameras", "pool 1": into name[16].
void sv_beat_name(int i_thread, char name[static 16]);

// A pool whose tasks are progress of their threads. `inner` does the work; without heartbeats the
// pool is `inner` itself. *w stays where it is.
typedef struct {
  sv_pool inner;
  sv_heartbeats *beats;
  sv_task_fn fn; // of the present job
  void *arg;
} sv_watched_pool;
sv_pool sv_watch_pool(sv_watched_pool *w, const sv_pool *inner, sv_heartbeats *beats);

#endif
