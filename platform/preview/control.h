// SPDX-License-Identifier: Apache-2.0
// Who controls a run when several pages are open: one page does, the others watch and may ask for
// control. Owns a fixed table of the pages that have the token. Reads no clock: each call is given
// the time.
#ifndef SV_PLATFORM_PREVIEW_CONTROL_H
#define SV_PLATFORM_PREVIEW_CONTROL_H

#include <stdbool.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

#define PV_CAP_SEATS    16 // pages with the token; the one that was silent longest makes room
#define PV_CAP_PAGE_ID  32
#define PV_MIN_PAGE_ID  16
#define PV_SEAT_LOST_NS 20000000000LL // a page reports every 5 s; a hidden one is late
#define PV_ASK_NS       20000000000LL // without an answer the asking page gets control

typedef struct {
  char id[PV_CAP_PAGE_ID + 1]; // secret of the page, so that no other page can pass for it
  uint32_t number;             // its public name, 0: free
  int64_t seen_ns;
} pv_seat;

typedef struct {
  pv_seat seat[PV_CAP_SEATS];
  uint32_t n_given; // seats so far
  uint32_t by;      // the page that controls, 0: none
  uint32_t asked;   // the page that asks for control, 0: none
  int64_t asked_ns;
  uint64_t n_changes; // of by and asked
} pv_control;

// A page with the token is there. It gets control when no page has it. Returns its number, 0: id is
// none (PV_MIN_PAGE_ID to PV_CAP_PAGE_ID letters, digits, - or _).
uint32_t pv_control_enter(pv_control *c, const char *id, int64_t now_ns);
// May this page change the run? id NULL: a program without a page, which may while no page has
// control.
bool pv_control_may(const pv_control *c, const char *id);
// Asks for control, which it gets at once when no page has it. False: no such page.
bool pv_control_ask(pv_control *c, const char *id, int64_t now_ns);
// The answer of the page that has control. False: it has not, or nobody asks.
bool pv_control_answer(pv_control *c, const char *id, bool is_given);
// Pages that went away lose their seats; a question without an answer is answered with yes.
void pv_control_step(pv_control *c, int64_t now_ns);

#ifdef __cplusplus
}
#endif
#endif
