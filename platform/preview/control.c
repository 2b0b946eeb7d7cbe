// SPDX-License-Identifier: Apache-2.0
#include "platform/preview/control.h"

#include <string.h>

static bool is_id(const char *id) {
  static const char alphabet[] = "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789-_";
  const size_t n = id ? strlen(id) : 0;
  return n >= PV_MIN_PAGE_ID && n <= PV_CAP_PAGE_ID && strspn(id, alphabet) == n;
}

// Index of the page's seat, -1: it has none. Takes the same time wherever ids differ: they are
// secrets.
static int find(const pv_control *c, const char *id) {
  char padded[PV_CAP_PAGE_ID + 1] = {0};
  int found = -1;
  if (!is_id(id)) return -1;
  memcpy(padded, id, strlen(id));
  for (int i = 0; i < PV_CAP_SEATS; i++) {
    unsigned differs = c->seat[i].number == 0;
    for (int k = 0; k <= PV_CAP_PAGE_ID; k++) differs |= (unsigned)(padded[k] ^ c->seat[i].id[k]);
    if (!differs) found = i;
  }
  return found;
}

static void give(pv_control *c, uint32_t number) {
  c->by = number;
  c->asked = 0;
  c->n_changes++;
}

static void free_seat(pv_control *c, pv_seat *s) {
  const uint32_t number = s->number;
  memset(s, 0, sizeof *s);
  if (c->asked == number) {
    c->asked = 0;
    c->n_changes++;
  }
  if (c->by == number) give(c, c->asked);
}

// A free seat, or that of the page that was silent longest, but not of the one in control.
static pv_seat *make_room(pv_control *c) {
  pv_seat *oldest = NULL;
  for (int i = 0; i < PV_CAP_SEATS; i++) {
    pv_seat *s = &c->seat[i];
    if (!s->number) return s;
    if (s->number != c->by && (!oldest || s->seen_ns < oldest->seen_ns)) oldest = s;
  }
  free_seat(c, oldest);
  return oldest;
}

uint32_t pv_control_enter(pv_control *c, const char *id, int64_t now_ns) {
  if (!is_id(id)) return 0;
  const int i = find(c, id);
  pv_seat *s = i < 0 ? make_room(c) : &c->seat[i];
  if (i < 0) {
    memcpy(s->id, id, strlen(id));
    if (++c->n_given == 0) c->n_given = 1;
    s->number = c->n_given;
  }
  s->seen_ns = now_ns;
  if (!c->by) give(c, s->number);
  return s->number;
}

bool pv_control_may(const pv_control *c, const char *id) {
  if (!c->by) return true;
  const int i = find(c, id);
  return i >= 0 && c->seat[i].number == c->by;
}

bool pv_control_ask(pv_control *c, const char *id, int64_t now_ns) {
  const int i = find(c, id);
  if (i < 0) return false;
  const uint32_t number = c->seat[i].number;
  if (!c->by) give(c, number);
  if (number == c->by || c->asked) return true;
  c->asked = number;
  c->asked_ns = now_ns;
  c->n_changes++;
  return true;
}

bool pv_control_answer(pv_control *c, const char *id, bool is_given) {
  const int i = find(c, id);
  if (i < 0 || c->seat[i].number != c->by || !c->asked) return false;
  give(c, is_given ? c->asked : c->by);
  return true;
}

void pv_control_step(pv_control *c, int64_t now_ns) {
  for (int i = 0; i < PV_CAP_SEATS; i++)
    if (c->seat[i].number && now_ns - c->seat[i].seen_ns > PV_SEAT_LOST_NS) free_seat(c, &c->seat[i]);
  if (c->asked && now_ns - c->asked_ns > PV_ASK_NS) give(c, c->asked);
}
