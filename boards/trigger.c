// SPDX-License-Identifier: Apache-2.0
// The external trigger of cameras: options of the source string, the line, and what became of it.
#include <string.h>

#include "boards/board_main.h"

static bool is_key(const char *word, size_t n, const char *key) {
  return n > strlen(key) && !memcmp(word, key, strlen(key));
}

static bool read_us(const char *text, size_t n, sv_ns *ns) {
  double us;
  if (!sv_parse_double(text, n, &us) || !(us >= 1 && us <= 1e7)) return false;
  *ns = (sv_ns)(us * 1e3 + 0.5);
  return true;
}

static bool read_polarity(const char *text, size_t n, bool *is_low) {
  *is_low = n == 3 && !memcmp(text, "low", 3);
  return *is_low || (n == 4 && !memcmp(text, "high", 4));
}

static bool read_mode(const char *text, size_t n, sv_trigger *t) {
  sv_trigger_mode m;
  if (n >= sizeof t->mode || !sv_trigger_parse_mode(text, n, &m)) return false;
  memcpy(t->mode, text, n);
  t->mode[n] = 0;
  return true;
}

sv_status trigger_option(sv_trigger *t, const char *word, size_t n, sv_err *err) {
  static const struct {
    const char *key, *expected;
  } options[] = {{"trigger=", "gpio:CHIP:LINE or pwm:CHIP:CHANNEL"},
                 {"trigger-period=", "1000 to 1e7 microseconds"},
                 {"trigger-width=", "1 to 1e7 microseconds"},
                 {"trigger-polarity=", "high or low"},
                 {"trigger-mode=", "CONTROL:VALUE or MODULE.PARAMETER:VALUE"}};
  int k = 0;
  while (k < 5 && !is_key(word, n, options[k].key)) k++;
  if (k == 5) return SV_AGAIN;
  const char *text = word + strlen(options[k].key);
  const size_t len = n - strlen(options[k].key);
  const bool is_good = k == 0   ? sv_trigger_parse_line(text, len, t)
                       : k == 1 ? read_us(text, len, &t->period_ns)
                       : k == 2 ? read_us(text, len, &t->width_ns)
                       : k == 3 ? read_polarity(text, len, &t->is_active_low)
                                : read_mode(text, len, t);
  if (is_good) return SV_OK;
  return sv_fail(err, SV_E_ARG, "source option %.*s: expected %s", (int)(n < 80 ? n : 80), word,
                 options[k].expected);
}

// The source string's word counts before that of the rig.
static sv_trigger merge(const board_source *s) {
  const sv_trigger *said = &s->trigger;
  sv_trigger t = s->rig ? s->rig->trigger : (sv_trigger){.kind = SV_LINE_NONE};
  if (said->kind != SV_LINE_NONE) {
    const sv_trigger rig = t;
    t = *said;
    if (!t.period_ns) t.period_ns = rig.period_ns;
    if (!t.width_ns) t.width_ns = rig.width_ns;
    if (!t.mode[0]) memcpy(t.mode, rig.mode, sizeof t.mode);
    return t;
  }
  if (said->width_ns) t.width_ns = said->width_ns;
  if (!t.period_ns || said->period_ns) t.period_ns = said->period_ns;
  if (said->mode[0]) memcpy(t.mode, said->mode, sizeof t.mode);
  t.is_active_low = t.is_active_low || said->is_active_low;
  return t;
}

sv_status trigger_open(board_source *s, sv_err *err) {
  const sv_pulses_sys sys = sv_pulses_linux();
  sv_trigger t = merge(s);
  if (s->kind == SOURCE_SIM) return SV_OK; // its line needs no pulses
  if (s->kind == SOURCE_REPLAY)
    return sv_fail(
        err, SV_E_UNSUPPORTED,
        "a capture folder has no trigger line: its frames were exposed when it was captured; expected "
        "--sync free");
  if (t.kind == SV_LINE_NONE)
    return sv_fail(err, SV_E_UNSUPPORTED,
                   "--sync trigger: no trigger line is named; expected trigger=gpio:CHIP:LINE or "
                   "trigger=pwm:CHIP:CHANNEL in the source string, or \"trigger\" in rig.json");
  sv_status r = sv_pulses_open(&s->pulses, &t, &sys, err);
  for (int i = 0; r >= 0 && i < s->source.n_cameras; i++)
    s->caps[i].fps = 1e9 / (double)s->pulses.trigger.period_ns;
  return r;
}

void trigger_report(sv_str *out, const board_source *s) {
  const sv_trigger *t = &s->pulses.trigger;
  const sv_pulses_stats *p = &s->pulses.stats;
  if (t->kind == SV_LINE_NONE) return;
  sv_str_add(out, "\"trigger\": {\"line\": \"");
  sv_trigger_add_line(out, t);
  sv_str_add(out, "\", \"period_us\": %.3f, \"width_us\": %.3f", (double)t->period_ns * 1e-3,
             (double)t->width_ns * 1e-3);
  if (t->kind == SV_LINE_GPIO) // of a PWM channel only its hardware knows
    sv_str_add(out,
               ", \"pulses\": %llu, \"skipped\": %llu, \"is_realtime\": %s, \"late_us\": {\"p50\": %.1f, "
               "\"p99\": %.1f, \"max\": %.1f}",
               (unsigned long long)p->n_pulses, (unsigned long long)p->n_skipped,
               p->is_realtime ? "true" : "false", (double)sv_pulses_late_ns(p, 50) * 1e-3,
               (double)sv_pulses_late_ns(p, 99) * 1e-3, (double)p->max_late_ns * 1e-3);
  sv_str_add(out, "}");
}

void trigger_close(board_source *s) {
  const sv_pulses_stats *p = &s->pulses.stats;
  const bool was_open = s->pulses.trigger.kind != SV_LINE_NONE;
  sv_pulses_close(&s->pulses);
  if (was_open && p->error) // then no frames came, and the capture has said so
    say(2, "subview: the trigger line failed: %s\n", sv_linux_reason(p->error));
}

void trigger_say(const board_source *s) {
  const sv_pulses_stats *p = &s->pulses.stats;
  if (s->pulses.trigger.kind != SV_LINE_GPIO) return;
  say(2, "subview: %llu trigger pulses, late by %.0f us (median), %.0f us (99 %%), %.0f us (maximum)%s\n",
      (unsigned long long)p->n_pulses, (double)sv_pulses_late_ns(p, 50) * 1e-3,
      (double)sv_pulses_late_ns(p, 99) * 1e-3, (double)p->max_late_ns * 1e-3,
      p->is_realtime ? "" : "; without real-time priority (it needs the right to it: LimitRTPRIO, or root)");
  if (p->n_skipped)
    say(2, "subview: %llu trigger pulses were left out, a period late: the processor was busy\n",
        (unsigned long long)p->n_skipped);
}
