// SPDX-License-Identifier: Apache-2.0
// The base room: status codes, arena, text, rings, random numbers, exact mathematics, small
// vectors. Owns nothing but its arguments. Every function that can fail returns sv_status; where
// outside data is involved it also fills an sv_err with one sentence: what, where, what was
// expected. Never includes another room, never calls the system, libm or the heap.
#ifndef SV_BASE_STATUS_H
#define SV_BASE_STATUS_H

#ifdef __cplusplus
extern "C" {
#endif

typedef enum {
#define X(name, code, sentence) SV_##name = (code),
#include "src/base/status.inc"
#undef X
} sv_status_code;

typedef int sv_status;

#if defined(__GNUC__)
#define SV_MUST_USE          __attribute__((warn_unused_result))
#define SV_PRINTF(fmt, args) __attribute__((format(printf, fmt, args)))
#else
#define SV_MUST_USE
#define SV_PRINTF(fmt, args)
#endif

// The code's name ("E_NOMEM") and its sentence; "?" for a number that is not in the list.
const char *sv_status_name(sv_status s);
const char *sv_status_text(sv_status s);

// One failure in one sentence. `text` is always terminated; longer sentences are cut.
typedef struct {
  sv_status status;
  char text[256];
} sv_err;

// Stores status and sentence (formats of sv_fmt, str.h) and returns `s`. `e` may be NULL.
sv_status sv_fail(sv_err *e, sv_status s, const char *fmt, ...) SV_PRINTF(3, 4);

#ifdef __cplusplus
}
#endif
#endif
