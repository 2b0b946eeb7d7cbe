// SPDX-License-Identifier: Apache-2.0
#include "platform/preview/access.h"

#if defined(__has_include) && __has_include(<microhttpd.h>)
#include <microhttpd.h>
#include <stdlib.h>
#include <string.h>
#include <sys/random.h>

#include "platform/linux/preview.h"
#include "src/format/board_print.h"
#include "src/format/qr.h"

#define PLAIN "text/plain; charset=utf-8"

static pv_answer answer_of(unsigned code, const char *type, const char *text) {
  return (pv_answer){
      MHD_create_response_from_buffer(strlen(text), (void *)(uintptr_t)text, MHD_RESPMEM_MUST_COPY), code,
      type};
}

// With text on the heap, which it takes.
static pv_answer answer_with(const char *type, char *text, size_t bytes) {
  pv_answer a = {MHD_create_response_from_buffer(bytes, text, MHD_RESPMEM_MUST_FREE), MHD_HTTP_OK, type};
  if (!a.response) free(text);
  return a;
}

pv_answer pv_board(struct MHD_Connection *c, bool is_pdf) {
  const char *board = MHD_lookup_connection_value(c, MHD_GET_ARGUMENT_KIND, "board");
  const char *paper = MHD_lookup_connection_value(c, MHD_GET_ARGUMENT_KIND, "paper");
  int corners[2];
  sv_board_print b;
  sv_err err = {0};
  if (!sv_board_print_parse(board ? board : "9x6", corners))
    return answer_of(MHD_HTTP_BAD_REQUEST, PLAIN, "board: expected inner corners such as 9x6\n");
  if (sv_board_print_fit(&b, paper ? paper : "a4", corners, 0, &err) < 0)
    return answer_of(MHD_HTTP_BAD_REQUEST, PLAIN, err.text);
  char *text = malloc(SV_BOARD_PRINT_CAP_TEXT);
  if (!text) return (pv_answer){0};
  sv_str out = sv_str_make(text, SV_BOARD_PRINT_CAP_TEXT);
  (is_pdf ? sv_board_print_pdf : sv_board_print_svg)(&b, &out);
  return answer_with(is_pdf ? "application/pdf" : "image/svg+xml", text, out.len);
}

bool pv_calibrate_command(struct MHD_Connection *c, uint8_t bytes[6]) {
  const char *board = MHD_lookup_connection_value(c, MHD_GET_ARGUMENT_KIND, "board");
  const char *mm = MHD_lookup_connection_value(c, MHD_GET_ARGUMENT_KIND, "mm");
  const char *lens = MHD_lookup_connection_value(c, MHD_GET_ARGUMENT_KIND, "lens");
  int corners[2];
  double side_mm;
  if (!board || !mm || !sv_board_print_parse(board, corners) || !sv_parse_double(mm, strlen(mm), &side_mm) ||
      !(side_mm >= 1 && side_mm <= 6000) || (lens && strcmp(lens, "normal") && strcmp(lens, "fisheye")))
    return false;
  const int tenths = (int)(10 * side_mm + 0.5);
  bytes[0] = SV_PREVIEW_CALIBRATE;
  bytes[1] = (uint8_t)corners[0];
  bytes[2] = (uint8_t)corners[1];
  bytes[3] = (uint8_t)(tenths >> 8);
  bytes[4] = (uint8_t)tenths;
  bytes[5] = lens && !strcmp(lens, "fisheye");
  return true;
}

pv_answer pv_link_code(const char *scheme, const char *host, const char *token) {
  char link[SV_QR_CAP_TEXT + 2];
  static sv_qr q;
  if (sv_fmt(link, sizeof link, "%s://%s/#%s", scheme, host, token) > SV_QR_CAP_TEXT || !sv_qr_make(&q, link))
    return answer_of(MHD_HTTP_NOT_FOUND, PLAIN, "the link is too long for a code\n");
  char *text = malloc(SV_QR_CAP_SVG);
  if (!text) return (pv_answer){0};
  sv_str out = sv_str_make(text, SV_QR_CAP_SVG);
  sv_qr_svg(&q, &out);
  return answer_with("image/svg+xml", text, out.len);
}

pv_answer pv_pin_new(pv_pin *p, int64_t now_ns) {
  uint64_t random;
  char text[64];
  if (getrandom(&random, sizeof random, 0) != (ssize_t)sizeof random)
    return answer_of(MHD_HTTP_SERVICE_UNAVAILABLE, PLAIN, "the system gives no random numbers\n");
  pv_pin_open(p, random, now_ns);
  sv_fmt(text, sizeof text, "{\"pin\":\"%s\",\"seconds\":%d}", p->digits, (int)(PV_PIN_NS / 1000000000));
  return answer_of(MHD_HTTP_OK, "application/json", text);
}

pv_answer pv_pair(pv_pin *p, const char *given, const char *token, int64_t now_ns) {
  switch (pv_pin_try(p, given, now_ns)) {
  case PV_PIN_RIGHT: return answer_of(MHD_HTTP_OK, PLAIN, token);
  case PV_PIN_WRONG: return answer_of(MHD_HTTP_FORBIDDEN, PLAIN, "wrong PIN\n");
  default:
    return answer_of(
        MHD_HTTP_GONE, PLAIN,
        "no PIN is open: ask for one on a device that has the page (Settings, Another device)\n");
  }
}
#endif
