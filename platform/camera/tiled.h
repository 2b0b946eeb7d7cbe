// SPDX-License-Identifier: Apache-2.0
// Splits images that hold several synchronous cameras in tiles (stereo USB cameras, HATs that
// stitch two or four sensors into one stream) into that many cameras. Nothing is copied: a tile
// points into its image, which returns to its source when all of its tiles are back. Tiles of
// compressed images carry their position (coded_x0_px, ...).
#ifndef SV_PLATFORM_CAMERA_TILED_H
#define SV_PLATFORM_CAMERA_TILED_H

#include "src/base/arena.h"
#include "src/port/port.h"

#ifdef __cplusplus
extern "C" {
#endif

#define SV_TILED_CAP_TILES   16
#define SV_TILED_CAP_BUFFERS 64

typedef struct {
  sv_source inner;
  int cols, rows;
  sv_camera_caps *caps; // [inner.n_cameras] of the whole images
  uint16_t *on_loan;    // [inner.n_cameras][SV_TILED_CAP_BUFFERS] a bit per tile
  bool has_frame;       // tiles from i_tile on are not delivered yet
  sv_frame frame;
  int i_tile;
} sv_tiled;

// Splits each camera of `inner` into cols x rows, numbered row by row. E_ARG with a sentence when
// its images cannot be divided this way (whole tiles; even positions for Y'CbCr and Bayer,
// multiples of four pixels for packed samples).
sv_status sv_tiled_init(sv_tiled *t, const sv_source *inner, int cols, int rows, sv_arena *arena,
                        sv_err *err) SV_MUST_USE;
sv_source sv_tiled_source(sv_tiled *t); // `t` must not move

#ifdef __cplusplus
}
#endif
#endif
