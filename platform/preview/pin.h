// SPDX-License-Identifier: Apache-2.0
// The PIN by which a second device gets the link's token without typing 32 characters. One PIN is
// open at a time: for two minutes, five tries and one device. Owns its digits. Reads no clock and
// no random numbers: each call is given them.
#ifndef SV_PLATFORM_PREVIEW_PIN_H
#define SV_PLATFORM_PREVIEW_PIN_H

#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

#define PV_PIN_DIGITS 6
#define PV_PIN_NS     120000000000LL
#define PV_PIN_TRIES  5 // an attacker is right with a chance of 5 in 1,000,000

typedef struct {
  char digits[PV_PIN_DIGITS + 1]; // empty: none is open
  int n_tries;                    // wrong ones so far
  int64_t until_ns;
} pv_pin;

typedef enum { PV_PIN_RIGHT, PV_PIN_WRONG, PV_PIN_CLOSED } pv_pin_answer;

// Opens a new PIN in place of the earlier one. random: 64 random bits.
void pv_pin_open(pv_pin *p, uint64_t random, int64_t now_ns);
// given NULL: none. RIGHT closes the PIN, as the last wrong try does.
pv_pin_answer pv_pin_try(pv_pin *p, const char *given, int64_t now_ns);

#ifdef __cplusplus
}
#endif
#endif
