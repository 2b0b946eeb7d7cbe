// SPDX-License-Identifier: Apache-2.0
#include "src/rig/sizes.h"

#include <math.h>

#define SAME_PX 0.01 // areas that differ by less are the same

static bool is_known(const sv_sensor_area *a) { return a->sensor_width_px > 0 && a->width_px > 0; }

// One size is a scaled form of the other, within the rounding of a pixel of the smaller one. Equal
// along one axis only: a crop.
static bool has_shape(int w, int h, int of_w, int of_h) {
  if ((w == of_w) != (h == of_h)) return false;
  const double off_px = w <= of_w ? fabs(h - (double)w * of_h / of_w) : fabs(of_h - (double)of_w * h / w);
  return off_px <= 1.0;
}

static void apply(sv_camera_model *model, const sv_image_map *m, int width_px, int height_px) {
  double *p = model->p;
  p[0] *= m->a[0];
  p[1] *= m->a[1];
  p[2] = m->a[0] * p[2] + m->b[0];
  p[3] = m->a[1] * p[3] + m->b[1];
  model->width_px = width_px;
  model->height_px = height_px;
}

bool sv_model_resize(sv_camera_model *m, int w, int h, sv_image_map *map) {
  if (!has_shape(w, h, m->width_px, m->height_px)) return false;
  *map = (sv_image_map){{(double)w / m->width_px, (double)h / m->height_px}, {0, 0}};
  apply(m, map, w, h);
  return true;
}

static const sv_sensor_area *mode_area(const sv_sub_view *v, const sv_image_mode *frame) {
  if (is_known(&frame->area)) return &frame->area;
  for (int i = 0; i < v->n_modes; i++)
    if (v->modes[i].width_px == frame->width_px && v->modes[i].height_px == frame->height_px)
      return &v->modes[i].area;
  return NULL;
}

// The area of the calibrated images, in pixels of the sensor that `frame` is of. Some drivers count
// a binned sensor, or a signal, in its own pixels: another count of the same shape is taken for the
// same sensor. NULL, or why there is none.
static const char *calibrated_area(const sv_sub_view *v, const sv_sensor_area *frame, sv_sensor_area *out) {
  const int w = frame->sensor_width_px, h = frame->sensor_height_px;
  const sv_sensor_area *c = &v->area;
  if (!is_known(c)) {
    *out = (sv_sensor_area){w, h, 0, 0, w, h};
    return has_shape(v->model.width_px, v->model.height_px, w, h)
               ? NULL
               : "the calibrated images do not have the shape of the whole sensor";
  }
  const double x = (double)w / c->sensor_width_px, y = (double)h / c->sensor_height_px;
  *out = (sv_sensor_area){w, h, x * c->x0_px, y * c->y0_px, x * c->width_px, y * c->height_px};
  return has_shape(c->sensor_width_px, c->sensor_height_px, w, h)
             ? NULL
             : "the camera reports a sensor of another shape than that of the rig";
}

static bool is_same_area(const sv_sensor_area *a, const sv_sensor_area *b) {
  return fabs(a->x0_px - b->x0_px) < SAME_PX && fabs(a->y0_px - b->y0_px) < SAME_PX &&
         fabs(a->width_px - b->width_px) < SAME_PX && fabs(a->height_px - b->height_px) < SAME_PX;
}

// From pixels of an image of `from` to those of an image of `to`, both of the same sensor.
static sv_image_map between(const sv_sensor_area *from, const sv_sub_view *v, const sv_sensor_area *to,
                            const sv_image_mode *frame) {
  const double sx = frame->width_px / to->width_px, sy = frame->height_px / to->height_px;
  sv_image_map m;
  m.a[0] = sx * from->width_px / v->model.width_px;
  m.a[1] = sy * from->height_px / v->model.height_px;
  m.b[0] = sx * (from->x0_px - to->x0_px);
  m.b[1] = sy * (from->y0_px - to->y0_px);
  return m;
}

static sv_status unexplained(const sv_sub_view *v, const sv_image_mode *f, const char *why, sv_err *err) {
  return sv_fail(
      err, SV_E_RANGE,
      "sub-view \"%s\" was calibrated at %dx%d pixels and its camera delivers %dx%d: %s; expected frames "
      "of that size, or \"sensor\" in rig.json",
      v->name, v->model.width_px, v->model.height_px, f->width_px, f->height_px, why);
}

// A crop is read in its share of the time, as lines are read one after the other.
static void fit_shutter(sv_shutter *s, const sv_sensor_area *from, const sv_sensor_area *to) {
  const bool is_across = s->direction == SV_SHUTTER_RIGHT || s->direction == SV_SHUTTER_LEFT;
  // both of one sensor, which they may count in other pixels
  const double was = is_across ? (double)from->width_px / from->sensor_width_px
                               : (double)from->height_px / from->sensor_height_px;
  const double is =
      is_across ? (double)to->width_px / to->sensor_width_px : (double)to->height_px / to->sensor_height_px;
  s->readout_s *= is / was;
}

sv_status sv_sub_view_fit(sv_sub_view *v, const sv_image_mode *frame, sv_size_fit *how, sv_image_map *map,
                          sv_err *err) {
  const sv_camera_model *m = &v->model;
  const sv_sensor_area *to = mode_area(v, frame);
  const bool is_size = m->width_px == frame->width_px && m->height_px == frame->height_px;
  sv_sensor_area from;
  *map = (sv_image_map){{1, 1}, {0, 0}};
  *how = SV_FIT_SAME;
  if (v->footprint.width_px > 0 || (is_size && (!to || !is_known(&v->area)))) return SV_OK;
  if (!to) {
    if (!sv_model_resize(&v->model, frame->width_px, frame->height_px, map))
      return unexplained(v, frame,
                         "another shape, and nobody reports what part of the sensor the frames show", err);
    *how = SV_FIT_ASSUMED;
    return SV_OK;
  }
  const char *why = calibrated_area(v, to, &from);
  if (why) return unexplained(v, frame, why, err);
  if (is_size && is_same_area(&from, to)) return SV_OK;
  const bool is_whole = m->width_px == from.sensor_width_px && m->height_px == from.sensor_height_px;
  const bool is_counted = !is_known(&v->area) || v->area.sensor_width_px == to->sensor_width_px;
  *how = is_counted && (is_known(&v->area) || is_whole) ? SV_FIT_REPORTED : SV_FIT_ASSUMED;
  *map = between(&from, v, to, frame);
  apply(&v->model, map, frame->width_px, frame->height_px);
  fit_shutter(&v->shutter, &from, to);
  v->area = *to;
  return SV_OK;
}

sv_status sv_sub_view_reduce(sv_sub_view *v, const sv_reduction *r, sv_image_map *map, sv_err *err) {
  const int w = v->model.width_px, h = v->model.height_px;
  const int new_w = r->k ? w / r->k : r->width_px, new_h = r->k ? h / r->k : r->height_px;
  *map = (sv_image_map){{1, 1}, {0, 0}};
  if (new_w == w && new_h == h) return SV_OK;
  if (new_w < 1 || new_h < 1 || new_w > w || new_h > h || (!r->k && !has_shape(new_w, new_h, w, h)))
    return sv_fail(
        err, SV_E_RANGE,
        "sub-view \"%s\" has images of %dx%d pixels, which cannot be trained at %dx%d; expected a smaller "
        "size of the same shape",
        v->name, w, h, new_w, new_h);
  v->source_width_px = r->k ? new_w * r->k : w;
  v->source_height_px = r->k ? new_h * r->k : h;
  map->a[0] = (double)new_w / v->source_width_px;
  map->a[1] = (double)new_h / v->source_height_px;
  apply(&v->model, map, new_w, new_h);
  return SV_OK;
}

sv_image_map sv_image_map_then(const sv_image_map *f, const sv_image_map *s) {
  return (sv_image_map){{s->a[0] * f->a[0], s->a[1] * f->a[1]},
                        {s->a[0] * f->b[0] + s->b[0], s->a[1] * f->b[1] + s->b[1]}};
}

// The pixels [*i0, *i1) of the source that destination pixel i shows, at least one; false: none of
// them is inside.
static bool shown(double a, double b, int i, int n, int *i0, int *i1) {
  *i0 = (int)floor((i - b) / a + 1e-6);
  *i1 = (int)ceil((i + 1 - b) / a - 1e-6);
  if (*i1 <= *i0) *i1 = *i0 + 1;
  return *i0 >= 0 && *i1 <= n;
}

void sv_mask_map(const sv_mask_image *src, const sv_image_map *m, const sv_mask_image *dst, uint8_t *out) {
  for (int y = 0; y < dst->height_px; y++)
    for (int x = 0; x < dst->width_px; x++) {
      int x0, x1, y0, y1;
      bool counts = shown(m->a[0], m->b[0], x, src->width_px, &x0, &x1);
      counts = shown(m->a[1], m->b[1], y, src->height_px, &y0, &y1) && counts;
      for (int j = y0; counts && j < y1; j++)
        for (int i = x0; counts && i < x1; i++)
          counts = src->px[(size_t)j * (size_t)src->width_px + (size_t)i] != 0;
      out[(size_t)y * (size_t)dst->width_px + (size_t)x] = counts ? 255 : 0;
    }
}
