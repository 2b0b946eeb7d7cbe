// SPDX-License-Identifier: Apache-2.0
#include "src/port/heartbeat.h"

#include "src/base/str.h"

static bool is_thread(int i_thread) { return i_thread >= 0 && i_thread < SV_CAP_BEATS; }

// Beats may lie in a read-only mapping: the qualifier is on the view, not on the object.
static int64_t load(const _Atomic int64_t *p) {
  return atomic_load_explicit((_Atomic int64_t *)(uintptr_t)p, memory_order_relaxed);
}

static void tell_alive(sv_heartbeats *h, sv_ns now_ns) {
  sv_ns age_ns;
  if (!h->alive || now_ns < h->next_alive_ns) return;
  (void)sv_beat_oldest(h->beats, now_ns, &age_ns);
  if (age_ns > h->late_ns) return;
  h->next_alive_ns = now_ns + h->alive_every_ns;
  h->alive(h->self);
}

void sv_beat(sv_heartbeats *h, int i_thread) {
  if (!h || !is_thread(i_thread)) return;
  sv_beat_of *b = &h->beats[i_thread];
  const sv_ns now_ns = h->clock.now_ns(h->clock.self), before_ns = load(&b->ns);
  atomic_store_explicit(&b->ns, now_ns, memory_order_relaxed);
  // Only this thread writes its own.
  if (before_ns > 0 && now_ns - before_ns > load(&b->longest_ns))
    atomic_store_explicit(&b->longest_ns, now_ns - before_ns, memory_order_relaxed);
  if (i_thread == SV_BEAT_MAIN) tell_alive(h, now_ns);
}

void sv_beat_for(sv_heartbeats *h, int i_thread, sv_ns allowed_ns) {
  sv_beat(h, i_thread);
  if (!h || !is_thread(i_thread)) return;
  const sv_ns now_ns = load(&h->beats[i_thread].ns);
  atomic_store_explicit(&h->beats[i_thread].ns, now_ns + allowed_ns, memory_order_relaxed);
}

void sv_beat_rest(sv_heartbeats *h, int i_thread) {
  if (h && is_thread(i_thread)) atomic_store_explicit(&h->beats[i_thread].ns, 0, memory_order_relaxed);
}

sv_ns sv_beat_age_ns(const sv_beat_of *beats, int i_thread, sv_ns now_ns) {
  const int64_t ns = load(&beats[i_thread].ns);
  return ns > 0 && ns < now_ns ? now_ns - ns : 0;
}

sv_ns sv_beat_longest_ns(const sv_beat_of *beats, int i_thread) { return load(&beats[i_thread].longest_ns); }

int sv_beat_oldest(const sv_beat_of *beats, sv_ns now_ns, sv_ns *age_ns) {
  int i_oldest = SV_BEAT_MAIN;
  *age_ns = 0;
  for (int i = 0; i < SV_CAP_BEATS; i++) {
    const sv_ns age = sv_beat_age_ns(beats, i, now_ns);
    if (age <= *age_ns) continue;
    *age_ns = age;
    i_oldest = i;
  }
  return i_oldest;
}

void sv_beat_name(int i_thread, char name[static 16]) {
  if (i_thread == SV_BEAT_MAIN) sv_copy(name, 16, "main");
  else if (i_thread == SV_BEAT_CAMERAS) sv_copy(name, 16, "cameras");
  else sv_fmt(name, 16, "pool %d", i_thread - SV_BEAT_POOL + 1);
}

// --- pool ----------------------------------------------------------------------------------------

static void watched_task(void *arg, int i_task, int i_thread) {
  sv_watched_pool *w = arg;
  const int i = i_thread ? SV_BEAT_POOL + i_thread - 1 : SV_BEAT_MAIN;
  // The first task of a job: a thread that hangs in it does not rest.
  if (is_thread(i) && load(&w->beats->beats[i].ns) == 0) sv_beat(w->beats, i);
  w->fn(w->arg, i_task, i_thread);
  sv_beat(w->beats, i);
}

static void run(void *self, sv_task_fn fn, void *arg, int n_tasks) {
  sv_watched_pool *w = self;
  w->fn = fn;
  w->arg = arg;
  w->inner.run(w->inner.self, watched_task, w, n_tasks);
  for (int k = 1; k < w->inner.n_threads; k++) sv_beat_rest(w->beats, SV_BEAT_POOL + k - 1);
}

sv_pool sv_watch_pool(sv_watched_pool *w, const sv_pool *inner, sv_heartbeats *beats) {
  sv_pool p = *inner;
  *w = (sv_watched_pool){.inner = *inner, .beats = beats};
  if (!beats) return p;
  p.self = w;
  p.run = run;
  return p;
}
