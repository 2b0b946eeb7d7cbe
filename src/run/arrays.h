// SPDX-License-Identifier: Apache-2.0
// Bytes of the trainer per Gaussian and per pixel of the largest image, array by array: shows where
// memory can be saved. Owns nothing. Bytes that grow with neither (scratch of the threads, tables)
// are in the memory map alone. Never allocates: it asks the trainer for its size.
#ifndef SV_RUN_ARRAYS_H
#define SV_RUN_ARRAYS_H

#include "src/base/str.h"
#include "src/train/train.h"

#ifdef __cplusplus
extern "C" {
#endif

#define SV_ARRAYS_CAP_ROWS 24

typedef struct {
  const char *name;
  double per_gaussian, per_pixel; // bytes
} sv_array_row;

typedef struct {
  int n_rows;
  sv_array_row row[SV_ARRAYS_CAP_ROWS];
  // As the trainer's own layout grows: the rows add up to it. What they leave out would be a row
  // "other".
  double per_gaussian, per_pixel;
} sv_arrays;

// Of a still scene with cfg's SH degree, losses and several pictures a step. A picture is padded to
// multiples of 32 pixels a side, which is not counted here.
sv_arrays sv_arrays_of(const sv_train_cfg *cfg);
// Lines of text, or the elements of a JSON array.
void sv_arrays_print(sv_str *out, const sv_arrays *f, bool is_json);

#ifdef __cplusplus
}
#endif
#endif
