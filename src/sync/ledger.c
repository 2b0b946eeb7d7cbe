// SPDX-License-Identifier: Apache-2.0
// What is counted: the ledger's balance, the names of reasons and events, the skew histogram.
#include "src/sync/sync.h"

const char *sv_drop_name(sv_drop_reason r) {
  switch (r) {
#define X(NAME, name)                                                                                        \
  case SV_DROP_##NAME:                                                                                       \
    return #name;
#include "src/sync/sv_drop.inc"
#undef X
  default: return "?";
  }
}

const char *sv_sync_event_name(sv_sync_event_kind k) {
  switch (k) {
#define X(NAME, name)                                                                                        \
  case SV_SYNC_EVENT_##NAME:                                                                                 \
    return #name;
#include "src/sync/sv_sync_event.inc"
#undef X
  default: return "?";
  }
}

uint64_t sv_ledger_dropped(const sv_ledger *l) {
  uint64_t sum = 0;
  for (int i = 0; i < SV_N_DROPS; i++) sum += l->dropped[i];
  return sum;
}

bool sv_ledger_is_exact(const sv_ledger *l) {
  return l->captured == l->delivered + l->pending + sv_ledger_dropped(l);
}

const sv_ledger *sv_sync_ledger(const sv_sync *s, int i_camera) {
  return i_camera < 0 || i_camera >= s->cfg.n_cameras ? NULL : &s->streams[i_camera].ledger;
}

sv_ledger sv_sync_ledger_sum(const sv_sync *s) {
  sv_ledger sum = {0};
  for (int c = 0; c < s->cfg.n_cameras; c++) {
    const sv_ledger *l = &s->streams[c].ledger;
    sum.captured += l->captured;
    sum.delivered += l->delivered;
    sum.pending += l->pending;
    for (int i = 0; i < SV_N_DROPS; i++) sum.dropped[i] += l->dropped[i];
  }
  return sum;
}

static int bin_of(sv_ns skew_ns) {
  uint64_t v = (uint64_t)skew_ns;
  int octave = 0;
  for (; v >= 16; v >>= 1) octave++;
  return v < 8 ? (int)v : octave * 8 + (int)v;
}

void sv_skew_add(sv_skew_stats *k, sv_ns skew_ns) {
  k->bins[bin_of(skew_ns)]++;
  k->n++;
  if (skew_ns > k->max_ns) k->max_ns = skew_ns;
}

// Upper edge of a bin: bins 0..7 hold one value each, then eight bins an octave.
sv_ns sv_skew_edge_ns(int i) {
  if (i < 8) return i;
  int octave = i / 8 - 1, part = i % 8;
  if (octave >= 59) return INT64_MAX;
  return ((sv_ns)(9 + part) << octave) - 1;
}

void sv_skew_remove(sv_skew_stats *k, sv_ns skew_ns) {
  int i = SV_SKEW_BINS - 1;
  k->bins[bin_of(skew_ns)]--;
  k->n--;
  while (i >= 0 && !k->bins[i]) i--;
  sv_ns edge_ns = i < 0 ? 0 : sv_skew_edge_ns(i);
  if (skew_ns == k->max_ns && edge_ns < skew_ns) k->max_ns = edge_ns;
}

sv_ns sv_skew_percentile_ns(const sv_skew_stats *s, double percent) {
  if (!s->n) return 0;
  double want = (double)s->n * percent / 100;
  uint64_t sum = 0;
  for (int i = 0; i < SV_SKEW_BINS; i++) {
    sum += s->bins[i];
    if (sum && (double)sum >= want) return sv_skew_edge_ns(i) < s->max_ns ? sv_skew_edge_ns(i) : s->max_ns;
  }
  return s->max_ns;
}
