// SPDX-License-Identifier: Apache-2.0
#include "boards/config.h"

#include <errno.h>
#include <fcntl.h>
#include <string.h>
#include <unistd.h>

#include "boards/board_main.h"

#define CAP_FILE  8192
#define CAP_WORDS 200

static char file[CAP_FILE + 1], text[2 * CAP_FILE];
static char *words[CAP_WORDS + 1];

static int read_file(const char *path, size_t *n) {
  ssize_t got = 0;
  int fd = open(path, O_RDONLY | O_CLOEXEC);
  if (fd < 0) {
    say(2, "subview: %s: cannot be opened: %s\n", path, sv_linux_reason(errno));
    return 1;
  }
  *n = 0;
  while (*n < CAP_FILE && (got = read(fd, file + *n, CAP_FILE - *n)) > 0) *n += (size_t)got;
  int why = errno;
  close(fd);
  if (got < 0) {
    say(2, "subview: %s: cannot be read: %s\n", path, sv_linux_reason(why));
    return 1;
  }
  if (*n == CAP_FILE) {
    say(2, "subview: %s: longer than the %d bytes expected of options\n", path, CAP_FILE - 1);
    return 1;
  }
  file[*n] = 0;
  return 0;
}

// Without blanks at both ends.
static char *trim(char *s) {
  s += strspn(s, " \t\r");
  for (size_t n = strlen(s); n && strchr(" \t\r", s[n - 1]);) s[--n] = 0;
  return s;
}

// "name = value" -> "--name=value" and "name" -> "--name"; false: no room for more.
static bool add_line(char *line, int *n_words, size_t *used) {
  char *value = strchr(line, '=');
  if (value) {
    *value++ = 0;
    value = trim(value);
    if (!*value) return true;
  }
  if (*n_words == CAP_WORDS) return false;
  char *word = text + *used;
  size_t n = sv_fmt(word, sizeof text - *used, "--%s%s%s", trim(line), value ? "=" : "", value ? value : "");
  *used += n + 1;
  words[(*n_words)++] = word;
  return *used < sizeof text;
}

int config_expand(const char *command, int *argc, char ***argv) {
  int at = 1, n_words = 0;
  size_t used = 0, n;
  while (at < *argc && strcmp((*argv)[at], "--config") != 0) at++;
  if (at >= *argc) return 0;
  if (at + 1 >= *argc || !strncmp((*argv)[at + 1], "--", 2))
    return usage_error(command, "--config needs a value");
  int code = read_file((*argv)[at + 1], &n);
  if (code) return code;
  words[n_words++] = (*argv)[0];
  for (char *line = file; line;) {
    char *next = strchr(line, '\n');
    if (next) *next++ = 0;
    char *s = trim(line);
    if (*s && *s != '#' && !add_line(s, &n_words, &used))
      return usage_error(command, "--config %s: more options than %d", (*argv)[at + 1], CAP_WORDS);
    line = next;
  }
  for (int i = 1; i < *argc; i++) {
    if (i == at || i == at + 1) continue;
    if (n_words == CAP_WORDS) return usage_error(command, "more than %d arguments", CAP_WORDS);
    words[n_words++] = (*argv)[i];
  }
  words[n_words] = NULL;
  *argc = n_words;
  *argv = words;
  return 0;
}
