// SPDX-License-Identifier: Apache-2.0
// Inside the codec: the block both libraries work in, and the state that lives in the arena.
#ifndef SV_PLATFORM_CODEC_CODEC_MEM_H
#define SV_PLATFORM_CODEC_CODEC_MEM_H

#include <setjmp.h>
#include <stdio.h> // jpeglib.h wants FILE

#include <jpeglib.h>

#include "platform/codec/codec.h"

// A decoder or encoder object of libjpeg with its error exit.
typedef struct {
  struct jpeg_error_mgr errors;
  struct jpeg_memory_mgr mem;       // ours, over the block
  struct jpeg_memory_mgr *heap_mem; // libjpeg's own, for init and close
  jmp_buf exit;
  sv_codec *codec;
  int n_damages; // warnings that mean lost image data
  char text[JMSG_LENGTH_MAX];
  struct jvirt_barray_control *virt_arrays; // coefficient arrays requested, not yet allocated
} sv_jpeg_common;

typedef struct {
  sv_jpeg_common common; // first: err points into it
  struct jpeg_decompress_struct d;
  struct jpeg_source_mgr source;
  struct jpeg_progress_mgr progress;
} sv_jpeg_decoder;

typedef struct {
  sv_jpeg_common common;
  struct jpeg_compress_struct c;
  struct jpeg_destination_mgr dest;
} sv_jpeg_encoder;

typedef struct {
  sv_jpeg_decoder dec;
  sv_jpeg_encoder enc;
  bool has_dec, has_enc; // created, must be destroyed
} sv_codec_state;

void *sv_codec_block_take(sv_codec *c, size_t bytes); // NULL when the block is exhausted
void sv_jpeg_errors_init(sv_jpeg_common *j, j_common_ptr cinfo, sv_codec *c);
void sv_jpeg_mem_init(sv_jpeg_common *j, j_common_ptr cinfo);
sv_status sv_jpeg_open(sv_codec *c);
void sv_jpeg_close(sv_codec *c);

#endif
