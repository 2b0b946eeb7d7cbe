// SPDX-License-Identifier: Apache-2.0
// C only: the server's pin is. What the page needs before a scan: a chessboard to print, and a code
// and a PIN for another device. Makes answers, and leaves sending them to server.c. Never decides
// who may ask.
#ifndef SV_PLATFORM_PREVIEW_ACCESS_H
#define SV_PLATFORM_PREVIEW_ACCESS_H

#include <stdbool.h>

#include "platform/preview/pin.h"

struct MHD_Connection;
struct MHD_Response;

typedef struct {
  struct MHD_Response *response; // NULL: no memory
  unsigned code;
  const char *type;
} pv_answer;

// GET /board.svg /board.pdf ?board=9x6&paper=a4
pv_answer pv_board(struct MHD_Connection *c, bool is_pdf);
// POST /calibrate?board=9x6&mm=24&lens=normal|fisheye -> the command (SV_PREVIEW_CALIBRATE). lens
// may be missing: normal. False: no such board or lens.
bool pv_calibrate_command(struct MHD_Connection *c, uint8_t bytes[6]);
// POST /qr: the link of this server with the token, as the host that was asked for, in SVG.
pv_answer pv_link_code(const char *scheme, const char *host, const char *token);
// POST /pin: opens a PIN. JSON with the PIN and its seconds.
pv_answer pv_pin_new(pv_pin *p, int64_t now_ns);
// POST /pair with X-Subview-Pin: the token.
pv_answer pv_pair(pv_pin *p, const char *given, const char *token, int64_t now_ns);

#endif
