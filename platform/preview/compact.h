// SPDX-License-Identifier: Apache-2.0
// C only: the feed is.
// Gaussians as the page's viewer takes them (page/sorter.js decodes).
//
// The compact form, little endian: a header of 128 bytes, then one block after another,
//   n x 3 f32          places
//   n x 11 u16         f16 scale x y z (linear) | i16 quaternion w x y z of 32767 | f16 SH degree 0
//                      of R G B |
//                      f16 opacity logit
//   n x 3 ((d+1)^2 - 1) i8   higher SH of degree d, coefficient-major, in units of `sh unit`;
//                            padded to 4 bytes
//   n_moving x n_motion f32  motion of the first n_moving (src/port/feed.h), with bodies theirs
//                            behind it
//   n_eyes x 7 f32           cameras of the images: eye 3, forward 3, tangent of half the diagonal
//                            angle
// Header: u32 magic "SVG2", n, step, sequence number (low), is_mip | background << 8 (0xRRGGBB), SH
// degree, n_moving, n_motion, motion, n_pos, n_rot, n_colour; f32 low-pass in square pixels;
// n_bodies, n_knots, flags | n_eyes << 8;
// f32 centre 3, radius, eye 3, up 3, fov_y, time_min, time_max, seconds, t0, sh unit.
#ifndef SV_PLATFORM_PREVIEW_COMPACT_H
#define SV_PLATFORM_PREVIEW_COMPACT_H

#include <stddef.h>

#include "src/port/feed.h"

// Floats of motion behind the rows, those of the bodies among them.
uint64_t pv_compact_motion_floats(const sv_feed_model *m);
size_t pv_compact_bytes(const sv_feed_model *m);
// m: with its rows behind it, checked; out: [pv_compact_bytes].
void pv_compact_put(const sv_feed_model *m, uint64_t seq, uint8_t *out);

#endif
