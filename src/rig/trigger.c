// SPDX-License-Identifier: Apache-2.0
#include "src/rig/trigger.h"

#include <string.h>

static bool is_name(const char *text, size_t n, size_t cap) {
  if (n < 1 || n >= cap) return false;
  for (size_t i = 0; i < n; i++) {
    const char c = text[i];
    const bool is_letter = (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || c == '_';
    if (!is_letter && !(c >= '0' && c <= '9')) return false;
  }
  return true;
}

static void copy(char *to, const char *text, size_t n) {
  memcpy(to, text, n);
  to[n] = 0;
}

bool sv_trigger_parse_line(const char *text, size_t n, sv_trigger *t) {
  const bool is_gpio = n > 5 && !memcmp(text, "gpio:", 5), is_pwm = n > 4 && !memcmp(text, "pwm:", 4);
  if (!is_gpio && !is_pwm) return false;
  const char *chip = text + (is_gpio ? 5 : 4), *end = text + n;
  const char *colon = memchr(chip, ':', (size_t)(end - chip));
  long long offset;
  if (!colon || !is_name(chip, (size_t)(colon - chip), sizeof t->chip)) return false;
  if (!sv_parse_int(colon + 1, (size_t)(end - colon) - 1, &offset) || offset < 0 || offset > 65535)
    return false;
  t->kind = is_gpio ? SV_LINE_GPIO : SV_LINE_PWM;
  copy(t->chip, chip, (size_t)(colon - chip));
  t->offset = (int)offset;
  return true;
}

bool sv_trigger_parse_mode(const char *text, size_t n, sv_trigger_mode *out) {
  const char *colon = memchr(text, ':', n), *dot = memchr(text, '.', n);
  long long value;
  if (!colon || (dot && dot > colon)) return false;
  const char *name = dot ? dot + 1 : text;
  if (dot && !is_name(text, (size_t)(dot - text), sizeof out->module)) return false;
  if (!is_name(name, (size_t)(colon - name), sizeof out->name)) return false;
  if (!sv_parse_int(colon + 1, n - (size_t)(colon - text) - 1, &value)) return false;
  if (value < -2147483647 || value > 2147483647) return false;
  *out = (sv_trigger_mode){.value = (int)value};
  if (dot) copy(out->module, text, (size_t)(dot - text));
  copy(out->name, name, (size_t)(colon - name));
  return true;
}

sv_status sv_trigger_complete(sv_trigger *t, sv_err *err) {
  if (!t->period_ns)
    return sv_fail(
        err, SV_E_RANGE,
        "the trigger's pulses have no period; expected fps= or trigger-period= in the source string, or "
        "\"period_us\" in rig.json");
  if (t->period_ns < SV_TRIGGER_MIN_PERIOD_NS || t->period_ns > SV_TRIGGER_MAX_PERIOD_NS)
    return sv_fail(err, SV_E_RANGE, "a trigger pulse every %g ms; expected 1 ms to 10 s",
                   sv_ns_to_ms(t->period_ns));
  if (!t->width_ns) t->width_ns = t->period_ns < 10 * SV_NS_PER_MS ? t->period_ns / 10 : SV_NS_PER_MS;
  if (t->width_ns < SV_NS_PER_US || t->width_ns >= t->period_ns)
    return sv_fail(err, SV_E_RANGE,
                   "trigger pulses of %g us every %g ms; expected 1 us to less than the period",
                   sv_ns_to_ms(t->width_ns) * 1e3, sv_ns_to_ms(t->period_ns));
  return SV_OK;
}

void sv_trigger_add_line(sv_str *out, const sv_trigger *t) {
  if (t->kind == SV_LINE_NONE) return;
  sv_str_add(out, "%s:%s:%d", t->kind == SV_LINE_GPIO ? "gpio" : "pwm", t->chip, t->offset);
}
