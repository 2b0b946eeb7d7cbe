// SPDX-License-Identifier: Apache-2.0
// libjpeg's memory manager over the codec's block. Memory is taken in order and nothing is freed
// before the image is done, so both of libjpeg's pools are the same block.
#include <stdlib.h>
#include <string.h>

#include "platform/codec/codec_mem.h"

#include <jerror.h>

// Rows and objects start on 64 bytes, and rows are whole multiples: the SIMD code of libjpeg-turbo
// reads and writes up to the end of the last vector.
#define ALIGN 64

struct jvirt_barray_control {
  JBLOCKARRAY rows; // NULL before realize
  JDIMENSION n_rows, n_blocks;
  boolean is_zeroed;
  struct jvirt_barray_control *next;
};

void *sv_codec_block_take(sv_codec *c, size_t bytes) {
  if (bytes > c->block_bytes) return NULL;
  bytes = (bytes + ALIGN - 1) & ~(size_t)(ALIGN - 1);
  if (bytes > c->block_bytes - c->used_bytes) return NULL;
  void *p = c->block + c->used_bytes;
  c->used_bytes += bytes;
  if (c->used_bytes > c->high_bytes) c->high_bytes = c->used_bytes;
  return p;
}

static sv_jpeg_common *common(j_common_ptr cinfo) { return (sv_jpeg_common *)cinfo->err; }

static void *take(j_common_ptr cinfo, int pool_id, size_t bytes) {
  (void)pool_id;
  void *p = sv_codec_block_take(common(cinfo)->codec, bytes);
  if (!p) ERREXIT1(cinfo, JERR_OUT_OF_MEMORY, 0); // does not return
  return p;
}

static JSAMPARRAY take_sarray(j_common_ptr cinfo, int pool_id, JDIMENSION width, JDIMENSION n_rows) {
  size_t row = ((size_t)width * sizeof(JSAMPLE) + ALIGN - 1) & ~(size_t)(ALIGN - 1);
  JSAMPARRAY rows = take(cinfo, pool_id, n_rows * sizeof *rows);
  JSAMPLE *data = take(cinfo, pool_id, row * n_rows);
  for (JDIMENSION i = 0; i < n_rows; i++) rows[i] = data + row * i;
  return rows;
}

static JBLOCKARRAY take_barray(j_common_ptr cinfo, int pool_id, JDIMENSION width, JDIMENSION n_rows) {
  JBLOCKARRAY rows = take(cinfo, pool_id, n_rows * sizeof *rows);
  JBLOCK *data = take(cinfo, pool_id, (size_t)width * n_rows * sizeof(JBLOCK));
  for (JDIMENSION i = 0; i < n_rows; i++) rows[i] = data + (size_t)width * i;
  return rows;
}

// Sample arrays of a whole image serve color quantization and full-image buffers, which are not
// used.
static jvirt_sarray_ptr want_sarray(j_common_ptr cinfo, int pool_id, boolean is_zeroed, JDIMENSION width,
                                    JDIMENSION n_rows, JDIMENSION n_access) {
  (void)pool_id, (void)is_zeroed, (void)width, (void)n_rows, (void)n_access;
  ERREXIT(cinfo, JERR_NOT_COMPILED);
  return NULL;
}

static JSAMPARRAY access_sarray(j_common_ptr cinfo, jvirt_sarray_ptr array, JDIMENSION i_row,
                                JDIMENSION n_rows, boolean is_writable) {
  (void)array, (void)i_row, (void)n_rows, (void)is_writable;
  ERREXIT(cinfo, JERR_BAD_VIRTUAL_ACCESS);
  return NULL;
}

static jvirt_barray_ptr want_barray(j_common_ptr cinfo, int pool_id, boolean is_zeroed, JDIMENSION width,
                                    JDIMENSION n_rows, JDIMENSION n_access) {
  (void)n_access; // the whole array is kept
  jvirt_barray_ptr v = take(cinfo, pool_id, sizeof *v);
  *v = (struct jvirt_barray_control){NULL, n_rows, width, is_zeroed, common(cinfo)->virt_arrays};
  common(cinfo)->virt_arrays = v;
  return v;
}

static void realize(j_common_ptr cinfo) {
  for (jvirt_barray_ptr v = common(cinfo)->virt_arrays; v; v = v->next) {
    if (v->rows) continue;
    v->rows = take_barray(cinfo, JPOOL_IMAGE, v->n_blocks, v->n_rows);
    // Always zeroed: a damaged file may leave parts unwritten that are visible.
    memset(v->rows[0], 0, (size_t)v->n_blocks * v->n_rows * sizeof(JBLOCK));
  }
}

static JBLOCKARRAY access_barray(j_common_ptr cinfo, jvirt_barray_ptr v, JDIMENSION i_row, JDIMENSION n_rows,
                                 boolean is_writable) {
  (void)is_writable;
  if (!v->rows || i_row > v->n_rows || n_rows > v->n_rows - i_row) ERREXIT(cinfo, JERR_BAD_VIRTUAL_ACCESS);
  return v->rows + i_row;
}

static void free_pool(j_common_ptr cinfo, int pool_id) {
  (void)pool_id;
  common(cinfo)->virt_arrays = NULL; // the block itself is emptied when the next image begins
}

static void self_destruct(j_common_ptr cinfo) { (void)cinfo; }

void sv_jpeg_mem_init(sv_jpeg_common *j, j_common_ptr cinfo) {
  j->heap_mem = cinfo->mem;
  j->mem = (struct jpeg_memory_mgr){.alloc_small = take,
                                    .alloc_large = take,
                                    .alloc_sarray = take_sarray,
                                    .alloc_barray = take_barray,
                                    .request_virt_sarray = want_sarray,
                                    .request_virt_barray = want_barray,
                                    .realize_virt_arrays = realize,
                                    .access_virt_sarray = access_sarray,
                                    .access_virt_barray = access_barray,
                                    .free_pool = free_pool,
                                    .self_destruct = self_destruct,
                                    .max_memory_to_use = 0,
                                    .max_alloc_chunk = 1000000000L};
  cinfo->mem = &j->mem;
}
