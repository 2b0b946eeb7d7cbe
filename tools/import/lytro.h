// SPDX-License-Identifier: Apache-2.0
// Raw files of Lytro cameras, by their public descriptions: .lfp and .lfr containers (12 bytes of
// magic, then sections with a length, a SHA-1 in text and data), and the white images MOD_*.TXT
// with MOD_*.RAW. Owns nothing: what it parses points into the caller's bytes.
#ifndef SV_TOOLS_IMPORT_LYTRO_H
#define SV_TOOLS_IMPORT_LYTRO_H

#include <stdbool.h>

#include "src/base/file_data.h"
#include "tools/common/imageio.h"

#ifdef __cplusplus
extern "C" {
#endif

typedef struct {
  int width_px, height_px, bits; // 10 or 12 bits a pixel, packed
  // By place in the 2x2 tile of the mosaic, row by row:
  int channel[4];               // 0 red, 1 green, 2 blue
  double black[4], white[4];    // levels
  double balance[4];            // factors of the white balance
  double focal_m, f_number;     // 0: not said
  double lens_pitch_m, pixel_m; // of the microlenses and the sensor; 0: not said
  double zoom, focus;           // steps of the lens's motors
  const uint8_t *raw;           // packed pixels
  size_t raw_bytes;
} lab_lytro;

// A container. E_FORMAT, E_UNSUPPORTED (other packing, or a file without raw data).
sv_status lab_lytro_parse(lab_lytro *l, const sv_file_data *file, sv_err *err) SV_MUST_USE;
// The description of a raw file, JSON; `raw` are the packed pixels.
sv_status lab_lytro_describe(lab_lytro *l, const sv_file_data *json, const sv_file_data *raw,
                             sv_err *err) SV_MUST_USE;
// Linear light in 16 bits: RGB, demosaiced bilinearly with the white balance, or with is_grey the
// mosaic alone, each pixel between its levels. Free with sv_bitmap_free.
sv_status lab_lytro_develop(const lab_lytro *l, bool is_grey, sv_bitmap *out, sv_err *err) SV_MUST_USE;

// A container from disk, developed.
sv_status lab_lytro_read(const char *path, lab_lytro *l, sv_bitmap *out, sv_err *err) SV_MUST_USE;
// Of the white images in a folder the one nearest in zoom and focus, without those that are dark;
// its path in `path`.
sv_status lab_lytro_white(const char *folder, const lab_lytro *of, char *path, sv_bitmap *out,
                          sv_err *err) SV_MUST_USE;

#ifdef __cplusplus
}
#endif
#endif
