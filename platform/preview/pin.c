// SPDX-License-Identifier: Apache-2.0
#include "platform/preview/pin.h"

#include <stdbool.h>
#include <string.h>

void pv_pin_open(pv_pin *p, uint64_t random, int64_t now_ns) {
  *p = (pv_pin){.until_ns = now_ns + PV_PIN_NS};
  // 10^6 of 2^64: no digits are more likely by more than 1 in 10^13
  for (int i = 0; i < PV_PIN_DIGITS; i++) {
    p->digits[i] = (char)('0' + random % 10);
    random /= 10;
  }
}

// In a time that does not depend on where they differ.
static bool is_equal(const char *given, const char *digits) {
  unsigned differs = 0;
  if (!given || strlen(given) != PV_PIN_DIGITS) return false;
  for (int i = 0; i < PV_PIN_DIGITS; i++) differs |= (unsigned)(given[i] ^ digits[i]);
  return !differs;
}

pv_pin_answer pv_pin_try(pv_pin *p, const char *given, int64_t now_ns) {
  if (!p->digits[0] || now_ns > p->until_ns) return PV_PIN_CLOSED;
  const bool is_right = is_equal(given, p->digits);
  if (is_right || ++p->n_tries == PV_PIN_TRIES) memset(p->digits, 0, sizeof p->digits);
  return is_right ? PV_PIN_RIGHT : PV_PIN_WRONG;
}
