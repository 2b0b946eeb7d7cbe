// SPDX-License-Identifier: Apache-2.0
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "boards/board_main.h"

void say(int fd, const char *fmt, ...) {
  char text[4096];
  va_list ap;
  va_start(ap, fmt);
  size_t n = sv_vfmt(text, sizeof text, fmt, ap);
  va_end(ap);
  if (n >= sizeof text) n = sizeof text - 1;
  for (size_t at = 0; at < n;) {
    ssize_t w = write(fd, text + at, n - at);
    if (w <= 0) return; // a closed terminal is no reason to stop
    at += (size_t)w;
  }
}

int usage_error(const char *command, const char *fmt, ...) {
  char text[512];
  va_list ap;
  va_start(ap, fmt);
  sv_vfmt(text, sizeof text, fmt, ap);
  va_end(ap);
  say(2, "subview %s: %s; try 'subview %s --help'\n", command, text, command);
  return EXIT_USAGE;
}

int fail_with(const sv_err *err) {
  say(2, "subview: %s\n", err->text);
  return 1;
}

void print_version(void) { say(1, "subview " VERSION " (" BOARD_NAME ")\n"); }

static void help(const char *command, const char *summary, const char *example, const opt *o, int n) {
  say(1, "usage: subview %s [options]\n%s\n\noptions:\n", command, summary);
  for (int i = 0; i < n; i++) {
    char left[64];
    sv_fmt(left, sizeof left, "%s%s%s", o[i].name, o[i].arg ? " " : "", o[i].arg ? o[i].arg : "");
    say(1, "  %-22s %s\n", left, o[i].help);
  }
  say(1, "  %-22s %s\n  %-22s %s\n\nexample:\n  %s\n", "--help", "this text", "--version", "the version",
      example);
}

static int set_value(const char *command, const opt *o, const char *text) {
  size_t len = strlen(text);
  if (o->kind == OPT_TEXT) {
    *(const char **)o->value = text;
    return 0;
  }
  if (o->kind == OPT_INT) {
    long long v;
    if (!sv_parse_int(text, len, &v) || (double)v < o->min || (double)v > o->max)
      return usage_error(command, "%s %s: expected a whole number from %.0f to %.0f", o->name, text, o->min,
                         o->max);
    *(long *)o->value = (long)v;
    return 0;
  }
  double v;
  if (!sv_parse_double(text, len, &v) || v < o->min || v > o->max)
    return usage_error(command, "%s %s: expected a number from %g to %g", o->name, text, o->min, o->max);
  *(double *)o->value = v;
  return 0;
}

int options_parse(const char *command, const char *summary, const char *example, const opt *o, int n,
                  int argc, char **argv) {
  for (int i = 1; i < argc; i++) {
    int k = 0;
    if (!strcmp(argv[i], "--help") || !strcmp(argv[i], "-h")) {
      help(command, summary, example, o, n);
      return -1;
    }
    if (!strcmp(argv[i], "--version")) {
      print_version();
      return -1;
    }
    const char *eq = strchr(argv[i], '=');
    size_t len = eq ? (size_t)(eq - argv[i]) : strlen(argv[i]);
    while (k < n && (strlen(o[k].name) != len || strncmp(o[k].name, argv[i], len))) k++;
    if (k == n) return usage_error(command, "unknown option '%s'", argv[i]);
    if (o[k].kind == OPT_FLAG) {
      if (eq) return usage_error(command, "%s takes no value", o[k].name);
      *(bool *)o[k].value = true;
      continue;
    }
    const char *text = eq ? eq + 1 : i + 1 < argc ? argv[++i] : "";
    const bool is_option = !eq && !strncmp(text, "--", 2); // the next one: this one's value was forgotten
    if (!*text || is_option) return usage_error(command, "%s needs a value", o[k].name);
    int r = set_value(command, &o[k], text);
    if (r) return r;
  }
  return 0;
}

int sync_mode_of(const char *name) {
  static const char *const names[] = {"free", "frame-length", "trigger"}; // in the order of sv_sync_method
  for (int i = 0; i < 3; i++)
    if (!strcmp(name, names[i])) return i;
  return -1;
}
