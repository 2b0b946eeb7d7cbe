// SPDX-License-Identifier: Apache-2.0
// Writes .npz archives as NumPy does, for tests: arrays of little-endian numbers or UTF-32 text,
// stored or deflated. It owns nothing but the archive that it builds; it never checks its input.
#ifndef SV_TESTS_COMMON_NPZ_WRITE_H
#define SV_TESTS_COMMON_NPZ_WRITE_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

typedef struct {
  uint8_t *data; // grows; freed by npz_free
  size_t bytes;
  struct {
    char name[40];
    size_t local, packed_bytes, bytes;
    uint32_t crc;
  } item[16];
  int n_items;
  bool is_deflated;
} npz_archive;

// descr: NumPy's type, as "<f8"; shape: as "(2, 3)" or "()".
typedef struct {
  const char *name, *descr, *shape;
  const void *items;
  size_t bytes;
} npz_array;

// A whole .npy file in a malloc'ed block.
uint8_t *npy_make(const npz_array *a, bool is_fortran, size_t *bytes);
void npz_add(npz_archive *z, const npz_array *a);
void npz_finish(npz_archive *z); // the list of files; z->data is the archive then
// The same, and writes it. Aborts the test when that fails.
void npz_save(npz_archive *z, const char *path);
void npz_free(npz_archive *z);

#ifdef __cplusplus
}
#endif
#endif
