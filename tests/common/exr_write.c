// SPDX-License-Identifier: Apache-2.0
#include "tests/common/exr_write.h"

#include <stdint.h>

#include "tests/common/test.h"

#if defined(__has_include) && __has_include(<OpenEXR/openexr.h>)
#include <OpenEXR/openexr.h>

static void encode(exr_context_t c, const exr_image *im) {
  exr_encode_pipeline_t p = EXR_ENCODE_PIPELINE_INITIALIZER;
  int32_t n_rows;
  assert_int_equal(exr_get_scanlines_per_chunk(c, 0, &n_rows), EXR_ERR_SUCCESS);
  for (int y = 0; y < im->height_px; y += n_rows) {
    exr_chunk_info_t chunk;
    assert_int_equal(exr_write_scanline_chunk_info(c, 0, y, &chunk), EXR_ERR_SUCCESS);
    exr_result_t e = y ? exr_encoding_update(c, 0, &chunk, &p) : exr_encoding_initialize(c, 0, &chunk, &p);
    assert_int_equal(e, EXR_ERR_SUCCESS);
    p.channels[0].user_data_type = EXR_PIXEL_FLOAT;
    p.channels[0].user_bytes_per_element = sizeof(float);
    p.channels[0].user_pixel_stride = sizeof(float);
    p.channels[0].user_line_stride = (int32_t)sizeof(float) * im->width_px;
    p.channels[0].encode_from_ptr = (const uint8_t *)(im->values + (size_t)y * (size_t)im->width_px);
    if (y == 0) assert_int_equal(exr_encoding_choose_default_routines(c, 0, &p), EXR_ERR_SUCCESS);
    assert_int_equal(exr_encoding_run(c, 0, &p), EXR_ERR_SUCCESS);
  }
  (void)exr_encoding_destroy(c, &p);
}

void exr_write(const char *path, const exr_image *im) {
  exr_context_initializer_t how = EXR_DEFAULT_CONTEXT_INITIALIZER;
  exr_context_t c;
  int part;
  assert_int_equal(exr_start_write(&c, path, EXR_WRITE_FILE_DIRECTLY, &how), EXR_ERR_SUCCESS);
  assert_int_equal(exr_add_part(c, "image", EXR_STORAGE_SCANLINE, &part), EXR_ERR_SUCCESS);
  assert_int_equal(
      exr_initialize_required_attr_simple(c, part, im->width_px, im->height_px, EXR_COMPRESSION_ZIP),
      EXR_ERR_SUCCESS);
  assert_int_equal(exr_add_channel(c, part, im->channel, EXR_PIXEL_FLOAT, EXR_PERCEPTUALLY_LOGARITHMIC, 1, 1),
                   EXR_ERR_SUCCESS);
  assert_int_equal(exr_write_header(c), EXR_ERR_SUCCESS);
  encode(c, im);
  assert_int_equal(exr_finish(&c), EXR_ERR_SUCCESS);
}

#else

void exr_write(const char *path, const exr_image *im) {
  (void)path;
  (void)im;
}

#endif
