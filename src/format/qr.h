// SPDX-License-Identifier: Apache-2.0
// QR codes (ISO/IEC 18004) of short texts such as a link: byte mode, error correction level L,
// versions 1 to 9. Owns nothing: the caller has the code and the buffers of its pictures. Never
// reads codes.
#ifndef SV_FORMAT_QR_H
#define SV_FORMAT_QR_H

#include <stdint.h>

#include "src/base/str.h"

#ifdef __cplusplus
extern "C" {
#endif

#define SV_QR_CAP_SIDE 53  // of version 9
#define SV_QR_CAP_TEXT 230 // bytes

typedef struct {
  int side;                                       // modules
  uint8_t module[SV_QR_CAP_SIDE][SV_QR_CAP_SIDE]; // [y][x] SV_QR_DARK and what sv_qr_make needs
} sv_qr;
#define SV_QR_DARK 1

// False: the text is longer than SV_QR_CAP_TEXT.
bool sv_qr_make(sv_qr *q, const char *text);
// Lines for a terminal with UTF-8 and colors, two rows of modules a line, dark on white whatever
// the terminal's colors are. At most SV_QR_CAP_LINES bytes.
#define SV_QR_CAP_LINES (8u << 10)
void sv_qr_lines(const sv_qr *q, sv_str *out);
// A picture of one path, for a page. At most SV_QR_CAP_SVG bytes.
#define SV_QR_CAP_SVG (32u << 10)
void sv_qr_svg(const sv_qr *q, sv_str *out);

#ifdef __cplusplus
}
#endif
#endif
