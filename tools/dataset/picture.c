// SPDX-License-Identifier: Apache-2.0
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "tools/dataset/dataset.h"

// --- sizes from headers --------------------------------------------------------------------------

static unsigned be16(const uint8_t *p) { return (unsigned)p[0] << 8 | p[1]; }
static unsigned long be32(const uint8_t *p) { return (unsigned long)be16(p) << 16 | be16(p + 2); }

static bool read_at(int fd, off_t at, void *buf, size_t n) { return pread(fd, buf, n, at) == (ssize_t)n; }

// Transparency is in the color type, or in a tRNS chunk before the first IDAT.
static bool peek_png(int fd, lab_peek *out) {
  uint8_t h[26], c[8];
  if (!read_at(fd, 8, h, 18) || memcmp(h + 4, "IHDR", 4) != 0) return false;
  unsigned long w = be32(h + 8), hh = be32(h + 12);
  if (!read_at(fd, 24, h, 2) || w < 1 || hh < 1 || w > SV_BITMAP_CAP_SIDE_PX || hh > SV_BITMAP_CAP_SIDE_PX)
    return false;
  *out = (lab_peek){(int)w, (int)hh, h[1] == 4 || h[1] == 6 ? 4 : 3};
  off_t at = 33;
  for (int i = 0; i < 1000 && out->n_channels == 3 && read_at(fd, at, c, 8); i++) {
    if (memcmp(c + 4, "IDAT", 4) == 0) break;
    if (memcmp(c + 4, "tRNS", 4) == 0) out->n_channels = 4;
    at += 12 + (off_t)be32(c);
  }
  return true;
}

static bool peek_jpeg(int fd, lab_peek *out) {
  uint8_t c[9];
  off_t at = 2;
  for (int i = 0; i < 10000 && read_at(fd, at, c, 4); i++) {
    if (c[0] != 0xff) return false;
    unsigned m = c[1];
    if (m == 0xff) { // fill byte
      at++;
      continue;
    }
    if (m >= 0xc0 && m <= 0xcf && m != 0xc4 && m != 0xc8 && m != 0xcc) { // a frame header
      if (!read_at(fd, at + 4, c, 5)) return false;
      *out = (lab_peek){(int)be16(c + 3), (int)be16(c + 1), 3};
      return out->width_px > 0 && out->height_px > 0;
    }
    if (m == 0xd9 || m == 0xda) return false;
    at += m == 0x01 || (m >= 0xd0 && m <= 0xd8) ? 2 : 2 + (off_t)be16(c + 2);
  }
  return false;
}

sv_status lab_picture_peek(const char *path, lab_peek *out, sv_err *err) {
  static const uint8_t png[8] = {0x89, 'P', 'N', 'G', '\r', '\n', 0x1a, '\n'};
  uint8_t head[8] = {0};
  size_t bytes;
  int fd;
  sv_status s = sv_file_open(path, &fd, &bytes, err);
  if (s != SV_OK) return s;
  bool is_good = read_at(fd, 0, head, 8);
  if (is_good && memcmp(head, png, 8) == 0) is_good = peek_png(fd, out);
  else is_good = is_good && head[0] == 0xff && head[1] == 0xd8 && peek_jpeg(fd, out);
  close(fd);
  return is_good ? SV_OK : sv_fail(err, SV_E_FORMAT, "%s: not a readable PNG or JPEG image", path);
}

// --- decoding ------------------------------------------------------------------------------------

void lab_reduce(const uint8_t *src, int w, int h, int n_channels, int k, uint8_t *dst) {
  size_t n_colour = n_channels == 4 ? 3 : (size_t)n_channels;
  for (int y = 0; y < h / k; y++)
    for (int x = 0; x < w / k; x++) {
      uint64_t sum[4] = {0}, alpha = 0;
      for (int i = 0; i < k * k; i++) {
        const uint8_t *p =
            src + ((size_t)(y * k + i / k) * (size_t)w + (size_t)(x * k + i % k)) * (size_t)n_channels;
        uint64_t a = n_channels == 4 ? p[3] : 1;
        alpha += a;
        for (size_t c = 0; c < n_colour; c++) sum[c] += a * p[c];
      }
      for (size_t c = 0; c < n_colour; c++) *dst++ = (uint8_t)(alpha ? (sum[c] + alpha / 2) / alpha : 0);
      uint64_t n = (uint64_t)k * (uint64_t)k;
      if (n_channels == 4) *dst++ = (uint8_t)((alpha + n / 2) / n);
    }
}

// Straight alpha <-> color times alpha: an interpolated pixel must not take color from a
// transparent neighbor.
static void multiply_alpha(uint8_t *p, size_t n) {
  for (; n--; p += 4)
    for (int c = 0; c < 3; c++) p[c] = (uint8_t)((p[c] * p[3] + 127) / 255);
}
static void divide_alpha(uint8_t *p, size_t n) {
  for (; n--; p += 4)
    for (int c = 0; c < 3; c++) {
      int v = p[3] ? (p[c] * 255 + p[3] / 2) / p[3] : 0;
      p[c] = (uint8_t)(v > 255 ? 255 : v);
    }
}

static sv_status undistort(lab_loader *l, const lab_frame *f, sv_bitmap *b, sv_err *err) {
  sv_status s = lab_undistort_map(l, f, err);
  if (s != SV_OK) return s;
  size_t n = (size_t)b->width_px * (size_t)b->height_px;
  uint8_t *to = malloc(n * (size_t)b->n_channels);
  if (!to) return sv_fail(err, SV_E_NOMEM, "%s: no memory for the undistorted image", f->path);
  if (b->n_channels == 4) multiply_alpha(b->u8, n);
  sv_remap_job job = {.src = b->u8,
                      .src_stride_bytes = (size_t)b->width_px * (size_t)b->n_channels,
                      .n_channels = b->n_channels,
                      .dst = to,
                      .y0 = 0,
                      .y1 = b->height_px};
  sv_remap_apply(&l->map, &job);
  if (b->n_channels == 4) divide_alpha(to, n);
  free(b->u8);
  b->u8 = to;
  return SV_OK;
}

sv_status lab_picture_load(lab_loader *l, const lab_frame *f, int scale, uint8_t *dst, sv_err *err) {
  sv_bitmap b;
  sv_status s = sv_bitmap_read(f->path, &b, err);
  if (s != SV_OK) return s;
  if (b.width_px != f->f.model.width_px || b.height_px != f->f.model.height_px)
    s = sv_fail(err, SV_E_FORMAT, "%s: the image changed while it was read", f->path);
  if (s == SV_OK) s = sv_bitmap_to_8(&b, err);
  if (s == SV_OK) s = sv_bitmap_to_channels(&b, f->n_channels, err);
  if (s == SV_OK && f->lens.is_remapped) s = undistort(l, f, &b, err);
  if (s == SV_OK) {
    if (scale > 1) lab_reduce(b.u8, b.width_px, b.height_px, b.n_channels, scale, dst);
    else memcpy(dst, b.u8, lab_frame_bytes(f));
  }
  sv_bitmap_free(&b);
  return s;
}

typedef struct {
  const lab_views *v;
  uint8_t *const *dst, *const *mask;
  lab_loader *loaders; // one per thread
  sv_err *errs;
} load_job;

static void load_task(void *arg, int i_task, int i_thread) {
  load_job *j = arg;
  int i = j->v->by_lens[i_task];
  if (j->v->frames[i].i_measurement >= 0) return; // has no image of its own
  j->errs[i].status =
      lab_picture_load(&j->loaders[i_thread], &j->v->frames[i], j->v->scale, j->dst[i], &j->errs[i]);
  if (j->errs[i].status == SV_OK && j->mask[i])
    j->errs[i].status =
        lab_mask_load(&j->loaders[i_thread], &j->v->frames[i], j->v->scale, j->mask[i], &j->errs[i]);
}

sv_status lab_pictures_load(const lab_views *v, uint8_t *const *dst, uint8_t *const *mask,
                            const sv_pool *pool, sv_err *err) {
  load_job j = {v, dst, mask, calloc((size_t)pool->n_threads, sizeof(lab_loader)),
                calloc((size_t)v->n, sizeof(sv_err))};
  sv_status s = SV_OK;
  if (!j.loaders || !j.errs) s = sv_fail(err, SV_E_NOMEM, "no memory for loading %d images", v->n);
  else sv_pool_run(pool, load_task, &j, v->n);
  for (int i = 0; i < v->n && s == SV_OK; i++)
    if ((s = j.errs[i].status) != SV_OK && err) *err = j.errs[i];
  for (int i = 0; j.loaders && i < pool->n_threads; i++) lab_loader_free(&j.loaders[i]);
  free(j.loaders);
  free(j.errs);
  return s;
}

// --- depth ---------------------------------------------------------------------------------------

typedef struct {
  const sv_bitmap *b;
  const lab_frame *f;
  const sv_remap *map; // NULL: the view is the file
} depth_source;

// Depth at pixel (x, y) of the full-size view, 0: none. Nearest sample:
// depths of two surfaces must not be mixed.
static double depth_at(const depth_source *d, int x, int y) {
  int sx = x, sy = y;
  if (d->map) {
    const sv_remap_tap *e = &d->map->entries[(size_t)y * (size_t)d->map->width_px + (size_t)x];
    if (e->x == SV_REMAP_NONE) return 0;
    sx = e->x + (e->fx >= 128);
    sy = e->y + (e->fy >= 128);
    if (sx >= d->b->width_px) sx = d->b->width_px - 1;
    if (sy >= d->b->height_px) sy = d->b->height_px - 1;
  }
  size_t i = (size_t)sy * (size_t)d->b->width_px + (size_t)sx;
  double unit = d->f->f.depth_unit > 0 ? d->f->f.depth_unit : LAB_DEPTH_UNIT;
  double v = unit * (d->b->bits == 16 ? d->b->u16[i] : d->b->u8[i]);
  const double *p = d->f->lens.model.p;
  // Of a fisheye the distance; along an axis, nothing is told of what lies beside it.
  if (d->f->lens.is_fisheye) {
    const float xy[2] = {(float)((x + 0.5 - p[2]) / p[0]), (float)((y + 0.5 - p[3]) / p[1])};
    float ray[3];
    if (d->f->f.depth_kind == SV_DEPTH_RAY) return v;
    return sv_fisheye_unproject(&d->f->lens.fisheye, xy, ray) && ray[2] > 0.01f ? v / (double)ray[2] : 0;
  }
  if (d->f->f.depth_kind != SV_DEPTH_RAY) return v;
  double rx = (x + 0.5 - p[2]) / p[0], ry = (y + 0.5 - p[3]) / p[1];
  return v / sqrt(rx * rx + ry * ry + 1);
}

sv_status lab_depth_load(lab_loader *l, const lab_frame *f, int scale, float *dst, sv_err *err) {
  sv_bitmap b;
  sv_status s = sv_bitmap_read(f->depth_path, &b, err);
  if (s != SV_OK) return s;
  if (b.width_px != f->f.model.width_px || b.height_px != f->f.model.height_px || b.n_channels != 1)
    s = sv_fail(err, SV_E_FORMAT, "%s: depth image is %dx%d with %d channels; expected %dx%d with one",
                f->depth_path, b.width_px, b.height_px, b.n_channels, f->f.model.width_px,
                f->f.model.height_px);
  if (s == SV_OK && f->lens.is_remapped) s = lab_undistort_map(l, f, err);
  depth_source d = {&b, f, f->lens.is_remapped ? &l->map : NULL};
  for (int y = 0; s == SV_OK && y < f->view.height_px; y++)
    for (int x = 0; x < f->view.width_px; x++) {
      double sum = 0;
      int n = 0;
      for (int i = 0; i < scale * scale; i++) {
        double z = depth_at(&d, x * scale + i % scale, y * scale + i / scale);
        sum += z;
        n += z > 0;
      }
      *dst++ = n == scale * scale ? (float)(sum / n) : 0.0f; // a block at an edge has no one depth
    }
  sv_bitmap_free(&b);
  return s;
}
