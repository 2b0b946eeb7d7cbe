// SPDX-License-Identifier: Apache-2.0
// The last seconds of a live run, for a page that asks for them: the file of its history as one
// snapshot, which stays as it is while the run goes on.
#include <string.h>

#include "src/preview/preview.h"

#define PERIOD_S 1.0 // copying takes the run's time

typedef struct {
  uint8_t *to;
  size_t n, cap;
} slot;

static sv_status append(void *self, const void *data, size_t bytes, sv_err *err) {
  slot *s = self;
  if (bytes > s->cap - s->n) return sv_fail(err, SV_E_FULL, "the history is larger than the feed");
  memcpy(s->to + s->n, data, bytes);
  s->n += bytes;
  return SV_OK;
}

void sv_preview_show_history(sv_preview *l) {
  const sv_clock *m = &l->cfg.port->machine;
  const double now = sv_ns_to_s(m->now_ns(m->self));
  slot s = {.cap = l->feed ? sv_feed_cap(l->feed, SV_FEED_HISTORY) : 0};
  sv_err err;
  if (!s.cap || now < l->next_history_s) return;
  l->next_history_s = now + PERIOD_S;
  s.to = sv_feed_begin(l->feed, SV_FEED_HISTORY);
  const sv_sink sink = {&s, append};
  if (l->cfg.calls.write_history(l->cfg.calls.self, sink, &err) >= 0)
    sv_feed_commit(l->feed, SV_FEED_HISTORY, s.n);
  else l->cfg.calls.log(l->cfg.calls.self, SV_LOG_WARN, err.text);
}
