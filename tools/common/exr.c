// SPDX-License-Identifier: Apache-2.0
#include "tools/common/exr.h"

#include <stdint.h>
#include <string.h>

#if defined(__has_include) && __has_include(<OpenEXR/openexr.h>)
#include <OpenEXR/openexr.h>
#define HAS_EXR 1
#else
#define HAS_EXR 0
#endif

bool lab_has_exr(void) { return HAS_EXR; }

#if HAS_EXR

// The library prints its errors unless it is given this.
static void ignore(exr_const_context_t c, exr_result_t code, const char *text) {
  (void)c;
  (void)code;
  (void)text;
}

static sv_status failed(const char *path, exr_result_t code, sv_err *err) {
  const bool is_missing = code == EXR_ERR_FILE_ACCESS;
  return sv_fail(err, is_missing ? SV_E_IO : SV_E_FORMAT, "%.150s: cannot be read as OpenEXR: %.120s", path,
                 exr_get_default_error_message(code));
}

// Before memory is taken for what a file says of itself.
static sv_status check(exr_const_context_t c, const char *path, const lab_exr_want *want, sv_err *err) {
  exr_storage_t storage;
  exr_attr_box2i_t window;
  const exr_attr_chlist_t *channels;
  int n_parts = 0;
  exr_result_t e = exr_get_count(c, &n_parts);
  if (e == EXR_ERR_SUCCESS) e = exr_get_storage(c, 0, &storage);
  if (e == EXR_ERR_SUCCESS) e = exr_get_data_window(c, 0, &window);
  if (e == EXR_ERR_SUCCESS) e = exr_get_channels(c, 0, &channels);
  if (e != EXR_ERR_SUCCESS) return failed(path, e, err);
  if (n_parts != 1 || storage != EXR_STORAGE_SCANLINE)
    return sv_fail(err, SV_E_UNSUPPORTED,
                   "%.150s: has parts, tiles or depths; expected one image in scan lines", path);
  const int64_t w = (int64_t)window.max.x - window.min.x + 1, h = (int64_t)window.max.y - window.min.y + 1;
  if (w != want->width_px || h != want->height_px)
    return sv_fail(err, SV_E_FORMAT, "%.150s: %lldx%lld pixels; expected %dx%d", path, (long long)w,
                   (long long)h, want->width_px, want->height_px);
  for (int i = 0; i < channels->num_channels; i++) {
    const exr_attr_chlist_entry_t *k = &channels->entries[i];
    if (strcmp(k->name.str, want->channel) == 0 && k->x_sampling == 1 && k->y_sampling == 1) return SV_OK;
  }
  return sv_fail(err, SV_E_FORMAT, "%.150s: has no channel %s of full size (%d others)", path, want->channel,
                 channels->num_channels);
}

// Rows of a chunk go to where the first of them has its place.
static void aim(exr_decode_pipeline_t *p, const lab_exr_want *want, float *row) {
  for (int i = 0; i < p->channel_count; i++) {
    exr_coding_channel_info_t *k = &p->channels[i];
    k->decode_to_ptr = NULL;
    if (strcmp(k->channel_name, want->channel) != 0) continue;
    k->user_data_type = EXR_PIXEL_FLOAT;
    k->user_bytes_per_element = sizeof *row;
    k->user_pixel_stride = sizeof *row;
    k->user_line_stride = (int32_t)sizeof *row * want->width_px;
    k->decode_to_ptr = (uint8_t *)row;
  }
}

static exr_result_t decode(exr_const_context_t c, const lab_exr_want *want, float *dst) {
  exr_decode_pipeline_t p = EXR_DECODE_PIPELINE_INITIALIZER;
  exr_attr_box2i_t window;
  int32_t n_rows = 0;
  exr_result_t e = exr_get_data_window(c, 0, &window);
  if (e == EXR_ERR_SUCCESS) e = exr_get_scanlines_per_chunk(c, 0, &n_rows);
  for (int y = 0; y < want->height_px && e == EXR_ERR_SUCCESS; y += n_rows) {
    exr_chunk_info_t chunk;
    e = exr_read_scanline_chunk_info(c, 0, window.min.y + y, &chunk);
    if (e == EXR_ERR_SUCCESS)
      e = y ? exr_decoding_update(c, 0, &chunk, &p) : exr_decoding_initialize(c, 0, &chunk, &p);
    if (e != EXR_ERR_SUCCESS) break;
    aim(&p, want, dst + (size_t)y * (size_t)want->width_px);
    if (y == 0) e = exr_decoding_choose_default_routines(c, 0, &p);
    if (e == EXR_ERR_SUCCESS) e = exr_decoding_run(c, 0, &p);
  }
  (void)exr_decoding_destroy(c, &p);
  return e;
}

sv_status lab_exr_read(const char *path, const lab_exr_want *want, float *dst, sv_err *err) {
  exr_context_initializer_t how = EXR_DEFAULT_CONTEXT_INITIALIZER;
  exr_context_t c;
  how.error_handler_fn = ignore;
  how.flags = EXR_CONTEXT_FLAG_DISABLE_CHUNK_RECONSTRUCTION; // what is damaged is refused
  exr_result_t e = exr_start_read(&c, path, &how);
  if (e != EXR_ERR_SUCCESS) return failed(path, e, err);
  sv_status s = check(c, path, want, err);
  if (s == SV_OK && (e = decode(c, want, dst)) != EXR_ERR_SUCCESS) s = failed(path, e, err);
  (void)exr_finish(&c);
  return s;
}

#else

sv_status lab_exr_read(const char *path, const lab_exr_want *want, float *dst, sv_err *err) {
  (void)want;
  (void)dst;
  return sv_fail(err, SV_E_UNSUPPORTED, "%.150s: this build reads no OpenEXR (libopenexr-dev was missing)",
                 path);
}

#endif
