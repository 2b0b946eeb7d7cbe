// SPDX-License-Identifier: Apache-2.0
// Reads NumPy's archives: .npz (a ZIP of .npy files, stored or deflated; APPNOTE.TXT of PKWARE and
// NumPy's NEP 1) and single .npy files. Owns the file's bytes and what it inflates. It runs no
// pickles and reads no archives of 4 GiB or more.
#ifndef SV_TOOLS_COMMON_NPZ_H
#define SV_TOOLS_COMMON_NPZ_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "src/base/file_data.h"
#include "src/base/status.h"

#ifdef __cplusplus
extern "C" {
#endif

#define SV_NPY_CAP_DIMS  8
#define SV_NPZ_CAP_NAME  64
#define SV_NPZ_CAP_ITEMS 256

// An array. Items are little-endian; those of Fortran's order are read in C's order all the same.
typedef struct {
  char name[SV_NPZ_CAP_NAME]; // without .npy
  char kind;                  // 'f' 'i' 'u' 'b' (bool), 'U' (UTF-32 text), 'S' (bytes of text)
  int item_bytes;
  int n_dims; // 0: one item
  size_t dim[SV_NPY_CAP_DIMS], n_items;
  bool is_fortran;
  const uint8_t *data; // [n_items * item_bytes]
  void *block;         // what was inflated; freed by sv_npy_free
} sv_npy;

typedef struct {
  char name[SV_NPZ_CAP_NAME];
  size_t local, packed_bytes, bytes;
  uint32_t crc;
  int method;
} sv_npz_item;

typedef struct {
  sv_file_data file;
  void *block; // the file's bytes when sv_npz_open read them
  sv_npz_item item[SV_NPZ_CAP_ITEMS];
  int n_items;
} sv_npz;

// The file must outlive z. Names of items lose their .npy; other files of the archive are skipped.
sv_status sv_npz_parse(sv_npz *z, const sv_file_data *file, sv_err *err) SV_MUST_USE;
sv_status sv_npz_open(sv_npz *z, const char *path, sv_err *err) SV_MUST_USE;
void sv_npz_close(sv_npz *z);

bool sv_npz_has(const sv_npz *z, const char *name);
// E_NOT_FOUND names the arrays that are there. After success free *a with sv_npy_free, before
// sv_npz_close.
sv_status sv_npz_get(const sv_npz *z, const char *name, sv_npy *a, sv_err *err) SV_MUST_USE;
// A .npy file in memory. *a points into it; `name` is for sentences.
sv_status sv_npy_parse(sv_npy *a, const sv_file_data *file, sv_err *err) SV_MUST_USE;
void sv_npy_free(sv_npy *a);

// Whether the array has these dimensions; 0 stands for any length.
bool sv_npy_is_shape(const sv_npy *a, int n_dims, const size_t *dim);
// Item i in C's order (the last index runs fastest), of kinds f, i, u and b; NAN for text.
double sv_npy_real(const sv_npy *a, size_t i);
// Text i as UTF-8, terminated. False when it does not fit or is not text.
bool sv_npy_text(const sv_npy *a, size_t i, char *out, size_t cap);

#ifdef __cplusplus
}
#endif
#endif
