// SPDX-License-Identifier: Apache-2.0
// A moving model as a sequence of frames that can be read from any keyframe on: quantized base
// model, then each frame's differences. Layout: docs/formats.md.
// Owns no memory: the caller gives the state. Never trains, and never evaluates a motion model.
//
// Rows are the floats of sv_gaussian in order: mean 0..2, quaternion 3..6, log-scale 7..9, opacity
// logit 10, SH from 11 on. Frames change rows 0..13 of Gaussians [0, n_moving).
#ifndef SV_FORMAT_SEQUENCE_H
#define SV_FORMAT_SEQUENCE_H

#include <stdbool.h>

#include "src/base/file_data.h"
#include "src/base/unit.h"
#include "src/format/gaussian.h"
#include "src/format/sections.h"

#ifdef __cplusplus
extern "C" {
#endif

// In the index, of a frame: uint64 place in the file, uint32 bytes, uint32 1 for a keyframe.
#define SV_SEQUENCE_INDEX_BYTES 16
#define SV_SEQUENCE_N_MOVED     14 // rows that frames change
#define SV_SEQUENCE_GROUP       12 // frames from one keyframe to the next
#define SV_SEQUENCE_MAX_N       4000000u
#define SV_SEQUENCE_MAX_T       100000u

typedef struct {
  uint32_t n, n_moving;    // Gaussians; Gaussians [0, n_moving) change
  uint32_t n_frames;       // 2..SV_SEQUENCE_MAX_T, evenly from time 0 to 1
  uint32_t group;          // frames from one keyframe to the next, at least 1
  int sh_degree;           // 0..3
  bool is_mip;             // as in the model's PLY
  sv_unit unit;            // likewise
  float dilation_px2;      // 0: not said
  float seconds;           // from the first frame to the last
  float centre[3], radius; // of the scene; the radius sets the step of positions
  char up[4];              // axis that points up; empty: not said
} sv_sequence_head;

static inline int sv_sequence_n_rows(const sv_sequence_head *h) { return SV_GAUSSIAN_N_FLOATS(h->sh_degree); }
// Quantization step of a row; the largest error is half of it. Positions: a power of two of about
// radius / 8192.
float sv_sequence_step(const sv_sequence_head *h, int row);

// Where the writer takes values from. moved: those of the frame that is being written.
typedef struct {
  const void *self;
  float (*base)(const void *self, uint32_t i, int row);
  float (*moved)(const void *self, uint32_t i, int row);
} sv_sequence_source;

typedef struct {
  sv_sequence_head head;
  sv_sequence_source source;
  sv_sections_writer out;
  int32_t *last[2]; // [SV_SEQUENCE_N_MOVED][n_moving] values: of the frame before, and before it
  uint8_t *index;   // [n_frames][16]
  uint64_t at_bytes;
  uint32_t frame;
} sv_sequence_writer;

// A value as the file holds it: the integer nearest to it in steps; quaternions get length 1.
int32_t sv_sequence_quantized(const sv_sequence_head *h, float (*get)(const void *self, uint32_t i, int row),
                              const void *self, uint32_t i, int row);

// Bytes of a writer's state, to be aligned to 8; 0 when the head is out of range.
size_t sv_sequence_writer_bytes(const sv_sequence_head *h);
// Writes the base model. Then sv_sequence_frame for each of n_frames frames, then sv_sequence_end.
// E_ARG when the head is out of range.
sv_status sv_sequence_begin(sv_sequence_writer *w, const sv_sequence_head *h,
                            const sv_sequence_source *source, void *state, sv_sink sink,
                            sv_err *err) SV_MUST_USE;
sv_status sv_sequence_frame(sv_sequence_writer *w, sv_err *err) SV_MUST_USE;
// The same for frames that are coded already (history.h): state of h->n_frames *
// SV_SEQUENCE_INDEX_BYTES, and of the source the base model alone.
sv_status sv_sequence_begin_coded(sv_sequence_writer *w, const sv_sequence_head *h,
                                  const sv_sequence_source *source, void *state, sv_sink sink,
                                  sv_err *err) SV_MUST_USE;
sv_status sv_sequence_put_coded(sv_sequence_writer *w, const uint8_t *data, size_t bytes,
                                sv_err *err) SV_MUST_USE;
sv_status sv_sequence_end(sv_sequence_writer *w, sv_err *err) SV_MUST_USE;

typedef struct {
  sv_sequence_head head;
  sv_sections sections;
  const uint8_t *index, *base;
  size_t base_bytes;
  int32_t *value;   // [n_rows][n]: the base model
  int32_t *last[2]; // [SV_SEQUENCE_N_MOVED][n_moving]: the frame that was read last, the one before
  int64_t frame;    // -1: none
} sv_sequence_reader;

// Reads and checks the head; the file must outlive r. E_FORMAT, E_UNSUPPORTED, E_CORRUPT: a
// sentence says what is wrong.
sv_status sv_sequence_open(sv_sequence_reader *r, const sv_file_data *file, sv_err *err) SV_MUST_USE;
size_t sv_sequence_reader_bytes(const sv_sequence_head *h);
// Decodes the base model into state (sv_sequence_reader_bytes, aligned to 8).
sv_status sv_sequence_read_base(sv_sequence_reader *r, void *state, sv_err *err) SV_MUST_USE;
// Decodes frame k, from its keyframe on where that is needed.
sv_status sv_sequence_read_frame(sv_sequence_reader *r, uint32_t k, sv_err *err) SV_MUST_USE;
// Gaussian i of the base model (frame none read) or of the frame that was read last.
void sv_sequence_get(const sv_sequence_reader *r, uint32_t i, sv_gaussian *out);

#ifdef __cplusplus
}
#endif
#endif
