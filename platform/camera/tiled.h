// SPDX-License-Identifier: Apache-2.0
// One picture that holds several synchronous cameras in tiles (stereo USB cameras, HATs that stitch
// two or four sensors into one stream) as that many cameras. Nothing is copied: a tile points into
// its picture, which goes back to its source when all of its tiles have come back. Tiles of
// compressed pictures name their place (coded_x0_px, ...).
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
  sv_camera_caps *caps; // [inner.n_cameras] of the whole pictures
  uint16_t *on_loan;    // [inner.n_cameras][SV_TILED_CAP_BUFFERS] a bit per tile
  bool has_frame;       // tiles from i_tile on are still to be handed out
  sv_frame frame;
  int i_tile;
} sv_tiled;

// Splits each camera of `inner` into cols x rows, numbered row by row. E_ARG with a sentence when
// its pictures cannot be divided so (whole tiles; even places for Y'CbCr and Bayer, multiples of
// four pixels for packed samples).
sv_status sv_tiled_init(sv_tiled *t, const sv_source *inner, int cols, int rows, sv_arena *arena,
                        sv_err *err) SV_MUST_USE;
sv_source sv_tiled_source(sv_tiled *t); // `t` must not move

#ifdef __cplusplus
}
#endif
#endif
