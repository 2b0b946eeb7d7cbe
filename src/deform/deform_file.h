// SPDX-License-Identifier: Apache-2.0
// The motion of a model as a file of its own beside the model's PLY, which stays one that every
// viewer opens: a checksummed container (format/sections.h) of kind "MOTN". Little endian, float32:
//   "HEAD"  sv_deform_head up to n_bodies
//   "ROWS"  of a clip [ceil(n_moving/16)][rows of kernels/motion/motion.h][16], of a field its
//           parameters (field.h)
// Version 2, with rigid bodies (bodies.h), has besides
//   "BODY"  i32 n_bodies (number 0, which rests, among them), n_knots; centres [n_bodies][3]
//   "TIME"  [n_knots] rising
//   "KNOT"  [n_bodies][n_knots] of quaternion w x y z, displacement
//   "OF  "  u8 [n_moving] body of each Gaussian that moves
#ifndef SV_DEFORM_DEFORM_FILE_H
#define SV_DEFORM_DEFORM_FILE_H

#include "src/deform/deform.h"
#include "src/format/sections.h"

#ifdef __cplusplus
extern "C" {
#endif

// What the file says about itself, and what memory a reader has to have.
typedef struct {
  int32_t kind, n_gaussians, n_moving;
  int32_t functions, n_pos, n_rot, n_colour;
  float t0; // Of a field: its sizes and its box.
  int32_t n_channels, n_levels, mult[SV_FIELD_CAP_LEVELS], base, n_times, width, is_shared, has_colour;
  float lo[3], inv[3];
  uint64_t model_digest;     // sv_deform_model_digest of the Gaussians that it belongs to
  int32_t n_bodies, n_knots; // of "BODY"; 0 without
} sv_deform_head;

uint64_t sv_deform_model_digest(const sv_gaussians *g);
sv_status sv_deform_write(const sv_deform *d, const sv_gaussians *g, sv_sink sink, sv_err *err) SV_MUST_USE;

// Its memory, without moments; what sv_deform_read carves.
sv_status sv_deform_carve(sv_deform *d, const sv_deform_head *head, const sv_gaussians *g, int n_threads,
                          sv_arena *arena) SV_MUST_USE;
typedef struct {
  sv_sections sections;
  sv_deform_head head;
} sv_deform_file;
// Verifies the whole file and reads its head; the file must outlive f. E_FORMAT, E_CORRUPT,
// E_UNSUPPORTED.
sv_status sv_deform_open(sv_deform_file *f, const sv_file_data *file, sv_err *err) SV_MUST_USE;
// Carves d for g as the head says, to be used with at most n_threads, and fills it. E_RANGE when
// the file belongs to other Gaussians than g.
sv_status sv_deform_read(sv_deform *d, const sv_deform_file *f, const sv_gaussians *g, int n_threads,
                         sv_arena *arena, sv_err *err) SV_MUST_USE;

#ifdef __cplusplus
}
#endif
#endif
