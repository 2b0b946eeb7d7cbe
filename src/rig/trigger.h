// SPDX-License-Identifier: Apache-2.0
// The line that triggers a rig's cameras: where it is, and what its pulses look like. Platforms
// make the pulses (platform/camera/pulses.h). Owns nothing.
// Never opens a line.
#ifndef SV_RIG_TRIGGER_H
#define SV_RIG_TRIGGER_H

#include <stdbool.h>
#include <stddef.h>

#include "src/base/str.h"
#include "src/base/time.h"

#ifdef __cplusplus
extern "C" {
#endif

typedef enum { SV_LINE_NONE = 0, SV_LINE_GPIO, SV_LINE_PWM } sv_line_kind;

#define SV_TRIGGER_MIN_PERIOD_NS SV_NS_PER_MS
#define SV_TRIGGER_MAX_PERIOD_NS (10 * SV_NS_PER_S)

typedef struct {
  // Where the line is; NONE: the rig has none.
  sv_line_kind kind;
  // The device's name: "gpiochip0", "pwmchip0".
  char chip[32];
  // The line's offset on the GPIO chip, or the channel of the PWM chip.
  int offset;
  // From one pulse to the next, 1 ms to 10 s; 0: not given.
  sv_ns period_ns;
  // How long a pulse is active, less than the period; 0: a tenth of the period, 1 ms at most.
  sv_ns width_ns;
  // The line is low while a pulse is active. Default false.
  bool is_active_low;
  // What makes the sensors wait for pulses: "NAME:VALUE" of a V4L2 control, or
  // "MODULE.PARAMETER:VALUE" of their driver. Empty: nothing has to be set.
  char mode[64];
} sv_trigger;

// A mode taken apart; module is empty for a V4L2 control.
typedef struct {
  char module[32], name[32];
  int value;
} sv_trigger_mode;

// "gpio:gpiochip0:17" or "pwm:pwmchip0:1" in text[0..n). False, and *t as before, for other text.
bool sv_trigger_parse_line(const char *text, size_t n, sv_trigger *t);
// False for text that is no mode. Names have letters, digits and '_'.
bool sv_trigger_parse_mode(const char *text, size_t n, sv_trigger_mode *out);
// Checks period and width (with its default filled in). E_RANGE with a sentence.
sv_status sv_trigger_complete(sv_trigger *t, sv_err *err) SV_MUST_USE;
// Adds the line's name, as it is written.
void sv_trigger_add_line(sv_str *out, const sv_trigger *t);

#ifdef __cplusplus
}
#endif
#endif
