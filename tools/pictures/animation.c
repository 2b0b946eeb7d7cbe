// SPDX-License-Identifier: Apache-2.0
#include "tools/pictures/animation.h"

#include <stdlib.h>

#include "tools/common/fileio.h"

#if defined(__has_include) && __has_include(<webp/mux.h>) && __has_include(<webp/encode.h>)
#include <webp/encode.h>
#include <webp/mux.h>

#define QUALITY 85 // 0 to 100, lossy
#define METHOD  4  // effort, 0 (fast) to 6

struct lab_animation {
  WebPAnimEncoder *encoder;
  WebPConfig config;
  int width_px, height_px, frame_ms, n_frames;
};

bool lab_animation_is_built(void) { return true; }

sv_status lab_animation_begin(lab_animation **out, int w, int h, int frame_ms, sv_err *err) {
  WebPAnimEncoderOptions o;
  *out = NULL;
  if (w > WEBP_MAX_DIMENSION || h > WEBP_MAX_DIMENSION)
    return sv_fail(err, SV_E_RANGE, "a WebP has at most %d pixels a side, not %dx%d", WEBP_MAX_DIMENSION, w,
                   h);
  lab_animation *a = calloc(1, sizeof *a);
  if (!a) return sv_fail(err, SV_E_NOMEM, "no memory for an animation");
  a->width_px = w;
  a->height_px = h;
  a->frame_ms = frame_ms;
  bool is_good = WebPAnimEncoderOptionsInit(&o) && WebPConfigInit(&a->config);
  a->config.quality = QUALITY;
  a->config.method = METHOD;
  o.anim_params.loop_count = 0; // for ever
  if (is_good) a->encoder = WebPAnimEncoderNew(w, h, &o);
  if (a->encoder) {
    *out = a;
    return SV_OK;
  }
  lab_animation_free(a);
  return sv_fail(err, SV_E_NOMEM, "libwebp could not start an animation of %dx%d", w, h);
}

// rgb NULL: the end of the last frame.
static bool put(lab_animation *a, const uint8_t *rgb) {
  WebPPicture p;
  int at_ms = a->n_frames * a->frame_ms;
  if (!rgb) return WebPAnimEncoderAdd(a->encoder, NULL, at_ms, NULL);
  if (!WebPPictureInit(&p)) return false;
  p.width = a->width_px;
  p.height = a->height_px;
  p.use_argb = 1;
  bool is_good =
      WebPPictureImportRGB(&p, rgb, 3 * a->width_px) && WebPAnimEncoderAdd(a->encoder, &p, at_ms, &a->config);
  WebPPictureFree(&p);
  a->n_frames += is_good;
  return is_good;
}

sv_status lab_animation_add(lab_animation *a, const uint8_t *rgb, sv_err *err) {
  if (put(a, rgb)) return SV_OK;
  return sv_fail(err, SV_E_NOMEM, "libwebp could not add frame %d: %s", a->n_frames,
                 WebPAnimEncoderGetError(a->encoder));
}

sv_status lab_animation_write(lab_animation *a, const char *path, sv_err *err) {
  WebPData data;
  WebPDataInit(&data);
  if (!put(a, NULL) || !WebPAnimEncoderAssemble(a->encoder, &data))
    return sv_fail(err, SV_E_NOMEM, "%s: libwebp could not finish the animation: %s", path,
                   WebPAnimEncoderGetError(a->encoder));
  sv_status s = sv_file_write(path, data.bytes, data.size, err);
  WebPDataClear(&data);
  return s;
}

void lab_animation_free(lab_animation *a) {
  if (a) WebPAnimEncoderDelete(a->encoder);
  free(a);
}

#else

bool lab_animation_is_built(void) { return false; }
sv_status lab_animation_begin(lab_animation **out, int w, int h, int frame_ms, sv_err *err) {
  (void)frame_ms;
  *out = NULL;
  return sv_fail(err, SV_E_UNSUPPORTED, "this build has no libwebp for an animation of %dx%d", w, h);
}
sv_status lab_animation_add(lab_animation *a, const uint8_t *rgb, sv_err *err) {
  (void)a;
  (void)rgb;
  return sv_fail(err, SV_E_UNSUPPORTED, "this build has no libwebp");
}
sv_status lab_animation_write(lab_animation *a, const char *path, sv_err *err) {
  (void)a;
  return sv_fail(err, SV_E_UNSUPPORTED, "%s: this build has no libwebp", path);
}
void lab_animation_free(lab_animation *a) { (void)a; }

#endif
