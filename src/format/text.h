// SPDX-License-Identifier: Apache-2.0
// Lines and words of a text in memory, shared by the readers of PLY and COLMAP.
#ifndef SV_FORMAT_TEXT_H
#define SV_FORMAT_TEXT_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <string.h>

typedef struct {
  const char *t; // not terminated
  size_t n;      // bytes
} sv_word;

typedef struct {
  const char *name; // of the file, for errors
  const uint8_t *buf;
  size_t bytes, at; // at: where the next line begins
  int line;         // number of the line last read, from 1
} sv_text;

// The next line without its end and the blanks before that; false at the end of the buffer.
static inline bool sv_text_line(sv_text *l, sv_word *out) {
  if (l->at >= l->bytes) return false;
  const char *from = (const char *)l->buf + l->at, *nl = (const char *)memchr(from, '\n', l->bytes - l->at);
  size_t n = nl ? (size_t)(nl - from) : l->bytes - l->at;
  l->at += nl ? n + 1 : n;
  l->line++;
  while (n && (from[n - 1] == '\r' || from[n - 1] == ' ' || from[n - 1] == '\t')) n--;
  out->t = from;
  out->n = n;
  return true;
}

// Removes the first word of the line; empty when none is left.
static inline sv_word sv_word_next(sv_word *line) {
  size_t i = 0, j;
  while (i < line->n && (line->t[i] == ' ' || line->t[i] == '\t')) i++;
  for (j = i; j < line->n && line->t[j] != ' ' && line->t[j] != '\t';) j++;
  sv_word w = {line->t + i, j - i};
  line->t += j;
  line->n -= j;
  return w;
}

static inline bool sv_word_is(sv_word w, const char *s) { return strlen(s) == w.n && !memcmp(w.t, s, w.n); }

#endif
