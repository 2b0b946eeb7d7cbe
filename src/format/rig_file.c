// SPDX-License-Identifier: Apache-2.0
#include "src/format/rig_file.h"

#include <string.h>

#include "src/format/cameramodel.h"
#include "src/format/json.h"
#include "src/format/photometry_json.h"

static const char *const forward_names[3] = {"direct", "light_field", "multiplexed"};

// Reads a file into what is left of scratch and returns the unused rest.
static sv_status load(const sv_file_reader *files, const char *name, sv_arena *scratch, char **text,
                      size_t *bytes, sv_err *err) {
  size_t mark = sv_arena_mark(scratch), cap = scratch->cap_bytes - scratch->used_bytes;
  if (cap < 2 * SV_ARENA_ALIGN)
    return sv_fail(err, SV_E_NOMEM, "%s: no scratch memory is left to read it", name);
  cap -= SV_ARENA_ALIGN;
  *text = SV_TAKE(scratch, char, cap);
  if (!*text) return sv_fail(err, scratch->status, "%s: no scratch memory is left to read it", name);
  sv_status s = files->read(files->self, name, *text, cap, bytes, err);
  sv_arena_reset(scratch, mark);
  if (s != SV_OK) return s;
  if (*bytes > cap) return sv_fail(err, SV_E_NOMEM, "%s: larger than the %zu bytes of scratch", name, cap);
  return SV_TAKE(scratch, char, *bytes)
             ? SV_OK
             : sv_fail(err, scratch->status, "%s: no scratch memory is left", name);
}

// Names become file names: no separators, nothing hidden.
static sv_status check_name(const sv_json *j, int i, const char *name, sv_err *err) {
  if (!name[0] || name[0] == '.')
    return sv_json_fail(j, i, err, SV_E_FORMAT, "a name that does not start with '.' was expected");
  for (const char *c = name; *c; c++)
    if (*c == '/' || *c == '\\' || (unsigned char)*c < 0x20)
      return sv_json_fail(j, i, err, SV_E_FORMAT, "\"%s\" holds a separator or control byte", name);
  return SV_OK;
}

static sv_status required_string(const sv_json *j, int i_object, const char *key, char *out, size_t cap,
                                 sv_err *err) {
  sv_status s = sv_json_get_string(j, i_object, key, out, cap, err);
  if (s == SV_END) return sv_json_missing(j, i_object, key, err);
  // Written again it would be another name, and a longer one.
  if (s == SV_OK && !sv_is_utf8(out))
    s = sv_json_fail(j, sv_json_get(j, i_object, key), err, SV_E_FORMAT, "\"%s\" is not valid UTF-8", key);
  return s;
}

static sv_status read_footprint(const sv_json *j, int i_view, sv_sub_view *v, sv_err *err) {
  int i = sv_json_get(j, i_view, "footprint");
  double r[4];
  v->footprint = (sv_footprint){.x0_px = 0};
  if (i < 0) return SV_OK;
  sv_status s = sv_json_doubles(j, i, r, 4, err);
  if (s != SV_OK) return s;
  for (int k = 0; k < 4; k++)
    if (!(r[k] >= (k < 2 ? 0 : 1) && r[k] <= 32767 && r[k] == (double)(int)r[k]))
      return sv_json_fail(j, i, err, SV_E_RANGE, "x, y, width and height in whole pixels were expected");
  v->footprint =
      (sv_footprint){.x0_px = (int)r[0], .y0_px = (int)r[1], .width_px = (int)r[2], .height_px = (int)r[3]};
  return SV_OK;
}

// How the sensor is read: a global shutter when nothing is said.
static sv_status read_shutter(const sv_json *j, int i_view, sv_sub_view *v, sv_err *err) {
  char name[16] = "down";
  double ms = 0;
  sv_status s = sv_json_get_double(j, i_view, "readout_ms", &ms, err);
  if (s < 0) return s;
  if (!(ms >= 0 && ms <= 1000))
    return sv_json_fail(j, sv_json_get(j, i_view, "readout_ms"), err, SV_E_RANGE,
                        "a readout of 0 to 1000 ms was expected");
  s = sv_json_get_string(j, i_view, "shutter", name, sizeof name, err);
  if (s < 0) return s;
  const int direction = sv_shutter_by_name(name);
  if (direction < 0)
    return sv_json_fail(j, sv_json_get(j, i_view, "shutter"), err, SV_E_FORMAT,
                        "\"%s\" is not one of down, up, right, left", name);
  v->shutter = (sv_shutter){1e-3 * ms, (sv_shutter_direction)direction};
  return SV_OK;
}

// "noise": {"read": R, "shot": S}
static sv_status read_noise(const sv_json *j, int i_view, sv_sub_view *v, sv_err *err) {
  const int i = sv_json_get(j, i_view, "noise");
  if (i < 0) return SV_OK;
  if (!sv_json_is_object(j, i))
    return sv_json_fail(j, i, err, SV_E_FORMAT, "noise is an object with \"read\" and \"shot\"");
  sv_status s = sv_json_get_double(j, i, "read", &v->noise.read, err);
  if (s >= 0) s = sv_json_get_double(j, i, "shot", &v->noise.shot, err);
  if (s < 0) return s;
  if (!(v->noise.read >= 0 && v->noise.read <= 1 && v->noise.shot >= 0 && v->noise.shot <= 1))
    return sv_json_fail(j, i, err, SV_E_RANGE, "variances of 0 to 1 were expected");
  return SV_OK;
}

typedef char image_name[sizeof((sv_coverage_names *)0)->name[0]];

// Only checks and keeps the name of an image; empty when there is none.
static sv_status read_image(const sv_json *j, int i_view, const char *key, image_name name, sv_err *err) {
  *name = 0;
  sv_status s = sv_json_get_string(j, i_view, key, name, sizeof(image_name), err);
  if (s == SV_OK) s = check_name(j, sv_json_get(j, i_view, key), name, err);
  return s == SV_END ? SV_OK : s;
}

static sv_status read_images(const sv_json *j, int i_view, const sv_rig *rig, sv_coverage_names *names,
                             sv_err *err) {
  const sv_sub_view *v = &rig->sub_views[rig->n_sub_views];
  image_name coverage, mask;
  sv_status s = read_image(j, i_view, "coverage", coverage, err);
  if (s == SV_OK) s = read_image(j, i_view, "mask", mask, err);
  if (s == SV_OK && *coverage && !v->footprint.width_px) // meaningless without its rectangle
    s = sv_json_fail(j, sv_json_get(j, i_view, "coverage"), err, SV_E_FORMAT,
                     "a coverage without a footprint; [x, y, w, h] was expected");
  if (s == SV_OK && *mask && rig->forward == SV_FORWARD_MULTIPLEXED)
    s = sv_json_fail(j, sv_json_get(j, i_view, "mask"), err, SV_E_UNSUPPORTED,
                     "a mask of a sub-view that shares its pixels with others; masks are for direct and "
                     "light_field rigs");
  if (s != SV_OK || !names) return s;
  sv_copy(names->name[rig->n_sub_views], sizeof coverage, coverage);
  sv_copy(names->mask[rig->n_sub_views], sizeof mask, mask);
  return SV_OK;
}

typedef struct {
  sv_rig *rig;
  sv_coverage_names *names; // may be NULL
  const sv_file_reader *files;
  int n_cameras;
  sv_arena *scratch;
} reader;

static sv_status read_model(const reader *r, const sv_json *j, int i_view, sv_sub_view *v, sv_err *err) {
  char file[96], *text;
  size_t bytes, mark = sv_arena_mark(r->scratch);
  // scratch is reset later
  sv_arena *splines = r->rig->splines == r->scratch ? NULL : r->rig->splines;
  sv_status s = required_string(j, i_view, "model", file, sizeof file, err);
  if (s == SV_OK) s = check_name(j, sv_json_get(j, i_view, "model"), file, err);
  if (s != SV_OK) return s;
  s = load(r->files, file, r->scratch, &text, &bytes, err);
  if (s == SV_OK)
    s = sv_cameramodel_read_splined(&(sv_file_data){file, text, bytes}, splines, &v->model, &v->cam_from_rig,
                                    err);
  sv_arena_reset(r->scratch, mark);
  if (s != SV_OK) return s;
  const sv_footprint *f = &v->footprint;
  if (f->width_px && (f->width_px != v->model.width_px || f->height_px != v->model.height_px))
    return sv_json_fail(j, i_view, err, SV_E_FORMAT, "the footprint is %dx%d, but the image of %s is %dx%d",
                        f->width_px, f->height_px, file, v->model.width_px, v->model.height_px);
  return SV_OK;
}

// "area": [x, y, w, h] of a sensor; all of it where there is none.
static sv_status read_area(const sv_json *j, int i_object, const int sensor[2], sv_sensor_area *out,
                           sv_err *err) {
  const int i = sv_json_get(j, i_object, "area");
  double a[4] = {0, 0, sensor[0], sensor[1]};
  sv_status s = i < 0 ? SV_OK : sv_json_doubles(j, i, a, 4, err);
  if (s != SV_OK) return s;
  if (!(a[0] >= 0 && a[1] >= 0 && a[2] >= 1 && a[3] >= 1 && a[0] + a[2] <= sensor[0] &&
        a[1] + a[3] <= sensor[1]))
    return sv_json_fail(j, i, err, SV_E_RANGE,
                        "x, y, width and height inside of the sensor's %dx%d pixels were expected", sensor[0],
                        sensor[1]);
  *out = (sv_sensor_area){sensor[0], sensor[1], a[0], a[1], a[2], a[3]};
  return SV_OK;
}

static sv_status read_size(const sv_json *j, int i_object, int size[2], sv_err *err) {
  const int i = sv_json_get(j, i_object, "size");
  double v[2];
  if (i < 0) return sv_json_missing(j, i_object, "size", err);
  sv_status s = sv_json_doubles(j, i, v, 2, err);
  for (int k = 0; s == SV_OK && k < 2; k++) {
    if (!(v[k] >= 1 && v[k] <= 32767 && v[k] == (double)(int)v[k]))
      return sv_json_fail(j, i, err, SV_E_RANGE, "width and height in whole pixels were expected");
    size[k] = (int)v[k];
  }
  return s;
}

// "sensor": {"size": [W, H], "area": [x, y, w, h], "modes": [{"size": [w, h], "area": [...]}, ...]}
static sv_status read_sensor(const sv_json *j, int i_view, sv_sub_view *v, sv_err *err) {
  const int i = sv_json_get(j, i_view, "sensor");
  int sensor[2], size[2];
  if (i < 0) return SV_OK;
  if (!sv_json_is_object(j, i))
    return sv_json_fail(j, i, err, SV_E_FORMAT, "a sensor is an object with \"size\"");
  sv_status s = read_size(j, i, sensor, err);
  if (s == SV_OK) s = read_area(j, i, sensor, &v->area, err);
  const int i_modes = sv_json_get(j, i, "modes");
  if (s != SV_OK || i_modes < 0) return s;
  if (!sv_json_is_array(j, i_modes) || sv_json_size(j, i_modes) > SV_CAP_SENSOR_MODES)
    return sv_json_fail(j, i_modes, err, SV_E_FORMAT, "an array of at most %d modes was expected",
                        SV_CAP_SENSOR_MODES);
  for (int k = sv_json_first(j, i_modes); s == SV_OK && k >= 0; k = sv_json_next(j, k)) {
    sv_sensor_mode *m = &v->modes[v->n_modes];
    if (!sv_json_is_object(j, k))
      return sv_json_fail(j, k, err, SV_E_FORMAT, "a mode is an object with \"size\"");
    s = read_size(j, k, size, err);
    if (s == SV_OK) s = read_area(j, k, sensor, &m->area, err);
    if (s != SV_OK) return s;
    m->width_px = size[0];
    m->height_px = size[1];
    v->n_modes++;
  }
  return s;
}

static sv_status read_photometric(const sv_json *j, int i_view, const sv_rig *rig, sv_photometry *p,
                                  sv_err *err) {
  const int i = sv_json_get(j, i_view, "photometric");
  if (i >= 0 && rig->forward == SV_FORWARD_MULTIPLEXED)
    return sv_json_fail(j, i, err, SV_E_UNSUPPORTED,
                        "a photometric calibration of a sub-view that shares its pixels with others; it is "
                        "for direct and light_field rigs");
  return sv_photometry_json_read(j, i_view, p, err);
}

static sv_status read_sub_view(const reader *r, const sv_json *j, int i, sv_err *err) {
  sv_sub_view *v = &r->rig->sub_views[r->rig->n_sub_views];
  long long camera = 0;
  memset(v, 0, sizeof *v);
  if (!sv_json_is_object(j, i)) return sv_json_fail(j, i, err, SV_E_FORMAT, "a sub-view is not an object");
  sv_status s = required_string(j, i, "name", v->name, sizeof v->name, err);
  if (s == SV_OK) s = check_name(j, sv_json_get(j, i, "name"), v->name, err);
  if (s != SV_OK) return s;
  for (int k = 0; k < r->rig->n_sub_views; k++)
    if (sv_str_eq(r->rig->sub_views[k].name, v->name))
      return sv_json_fail(j, i, err, SV_E_FORMAT, "the name \"%s\" is used twice", v->name);
  s = sv_json_get_int(j, i, "camera", (sv_json_range){0, SV_CAP_SUB_VIEWS - 1}, &camera, err);
  if (s == SV_END) return sv_json_missing(j, i, "camera", err);
  if (s != SV_OK) return s;
  if (r->n_cameras >= 0 && camera >= r->n_cameras)
    return sv_json_fail(j, i, err, SV_E_RANGE, "camera %lld is asked for, the source has %d", camera,
                        r->n_cameras);
  v->i_camera = (int)camera;
  s = read_footprint(j, i, v, err);
  if (s == SV_OK) s = read_shutter(j, i, v, err);
  if (s == SV_OK) s = read_noise(j, i, v, err);
  if (s == SV_OK) s = read_images(j, i, r->rig, r->names, err);
  if (s == SV_OK) s = read_sensor(j, i, v, err);
  if (s == SV_OK) s = read_photometric(j, i, r->rig, &v->photometric, err);
  if (s == SV_OK) s = read_model(r, j, i, v, err);
  if (s == SV_OK) r->rig->n_sub_views++;
  return s;
}

static sv_status get_us(const sv_json *j, int i_object, const char *key, sv_ns *ns, sv_err *err) {
  double us = 0;
  sv_status s = sv_json_get_double(j, i_object, key, &us, err);
  if (s != SV_OK) return s == SV_END ? SV_OK : s;
  if (!(us >= 1 && us <= 1e7))
    return sv_json_fail(j, sv_json_get(j, i_object, key), err, SV_E_RANGE,
                        "1 to 1e7 microseconds were expected");
  *ns = (sv_ns)(us * 1e3 + 0.5);
  return SV_OK;
}

// "trigger": {"line": "gpio:gpiochip0:17", "period_us": P, "width_us": W, "polarity": "high" |
// "low", "mode": "imx296.trigger_mode:1"}; all but the line are optional.
static sv_status read_trigger(const sv_json *j, sv_trigger *t, sv_err *err) {
  const int i = sv_json_get(j, 0, "trigger");
  char line[64], polarity[8] = "high";
  sv_trigger_mode mode;
  *t = (sv_trigger){.kind = SV_LINE_NONE};
  if (i < 0) return SV_OK;
  if (!sv_json_is_object(j, i))
    return sv_json_fail(j, i, err, SV_E_FORMAT, "a trigger is an object with \"line\"");
  sv_status s = required_string(j, i, "line", line, sizeof line, err);
  if (s == SV_OK && !sv_trigger_parse_line(line, strlen(line), t))
    s = sv_json_fail(j, sv_json_get(j, i, "line"), err, SV_E_FORMAT,
                     "gpio:CHIP:LINE or pwm:CHIP:CHANNEL was expected");
  if (s == SV_OK) s = get_us(j, i, "period_us", &t->period_ns, err);
  if (s == SV_OK) s = get_us(j, i, "width_us", &t->width_ns, err);
  if (s != SV_OK) return s;
  s = sv_json_get_string(j, i, "polarity", polarity, sizeof polarity, err);
  t->is_active_low = sv_str_eq(polarity, "low");
  if (s >= 0 && !t->is_active_low && !sv_str_eq(polarity, "high"))
    return sv_json_fail(j, sv_json_get(j, i, "polarity"), err, SV_E_FORMAT, "high or low was expected");
  if (s < 0) return s;
  s = sv_json_get_string(j, i, "mode", t->mode, sizeof t->mode, err);
  if (s == SV_OK && !sv_trigger_parse_mode(t->mode, strlen(t->mode), &mode))
    return sv_json_fail(j, sv_json_get(j, i, "mode"), err, SV_E_FORMAT,
                        "CONTROL:VALUE or MODULE.PARAMETER:VALUE was expected");
  return s < 0 ? s : SV_OK;
}

static sv_status read_top(const reader *r, const sv_json *j, sv_err *err) {
  char forward[16];
  long long version;
  sv_status s = sv_json_get_int(j, 0, "version", (sv_json_range){1, 1}, &version, err);
  if (s == SV_END) return sv_json_missing(j, 0, "version", err);
  if (s == SV_OK) s = required_string(j, 0, "name", r->rig->name, sizeof r->rig->name, err);
  if (s == SV_OK) s = required_string(j, 0, "forward", forward, sizeof forward, err);
  if (s != SV_OK) return s;
  int f = 0, i_views = sv_json_get(j, 0, "sub_views");
  while (f < 3 && !sv_str_eq(forward, forward_names[f])) f++;
  if (f == 3)
    return sv_json_fail(j, sv_json_get(j, 0, "forward"), err, SV_E_FORMAT,
                        "\"%s\" is not one of direct, light_field, multiplexed", forward);
  r->rig->forward = (sv_forward_kind)f;
  s = read_trigger(j, &r->rig->trigger, err);
  r->rig->scale_sigma = 0;
  if (s == SV_OK) s = sv_json_get_double(j, 0, "scale_sigma", &r->rig->scale_sigma, err);
  if (s < 0) return s;
  if (!(r->rig->scale_sigma >= 0 && r->rig->scale_sigma < 1))
    return sv_json_fail(j, sv_json_get(j, 0, "scale_sigma"), err, SV_E_RANGE,
                        "\"scale_sigma\" is %g, expected 0 to 1", r->rig->scale_sigma);
  r->rig->n_sub_views = 0;
  if (!sv_json_is_array(j, i_views) || !sv_json_size(j, i_views))
    return sv_json_fail(j, i_views < 0 ? 0 : i_views, err, SV_E_FORMAT,
                        "\"sub_views\" was expected, an array of at least one");
  if (sv_json_size(j, i_views) > r->rig->cap_sub_views)
    return sv_json_fail(j, i_views, err, SV_E_FULL, "%d sub-views, there is room for %d",
                        sv_json_size(j, i_views), r->rig->cap_sub_views);
  for (int i = sv_json_first(j, i_views); i >= 0; i = sv_json_next(j, i)) {
    s = read_sub_view(r, j, i, err);
    if (s != SV_OK) return s;
  }
  return SV_OK;
}

sv_status sv_rig_read(sv_rig *rig, const sv_file_reader *files, int n_cameras, sv_arena *scratch,
                      sv_err *err) {
  return sv_rig_read_coverage(rig, NULL, files, n_cameras, scratch, err);
}

sv_status sv_rig_read_coverage(sv_rig *rig, sv_coverage_names *names, const sv_file_reader *files,
                               int n_cameras, sv_arena *scratch, sv_err *err) {
  static const char json_name[] = "rig.json";
  size_t mark = sv_arena_mark(scratch), bytes = 0;
  char *text;
  int n_tok = 0;
  sv_json j;
  reader r = {rig, names, files, n_cameras, scratch};
  sv_status s = load(files, json_name, scratch, &text, &bytes, err);
  if (s == SV_OK) s = sv_json_count(json_name, text, bytes, &n_tok, err);
  if (s == SV_OK) {
    jsmntok_t *tok = SV_TAKE(scratch, jsmntok_t, n_tok);
    if (!tok)
      s = sv_fail(err, SV_E_NOMEM, "%s: no scratch memory is left for its %d tokens", json_name, n_tok);
    else s = sv_json_parse(&j, &(sv_file_data){json_name, text, bytes}, tok, n_tok, err);
  }
  if (s == SV_OK)
    s = sv_json_is_object(&j, 0) ? read_top(&r, &j, err)
                                 : sv_json_fail(&j, 0, err, SV_E_FORMAT, "an object was expected");
  sv_arena_reset(scratch, mark);
  return s;
}

sv_status sv_rig_json_write(sv_str *out, const sv_rig *rig) {
  return sv_rig_json_write_coverage(out, rig, NULL);
}

static void add_image(sv_str *out, const char *key, const char *name) {
  if (!*name) return;
  sv_str_add(out, ", \"%s\": \"", key);
  sv_str_add_json(out, name);
  sv_str_add(out, "\"");
}

static void add_area(sv_str *out, const sv_sensor_area *a) {
  sv_str_add(out, "\"area\": [%.17g, %.17g, %.17g, %.17g]", a->x0_px, a->y0_px, a->width_px, a->height_px);
}

static void add_sensor(sv_str *out, const sv_sub_view *v) {
  if (!v->area.sensor_width_px) return;
  sv_str_add(out, ", \"sensor\": {\"size\": [%d, %d], ", v->area.sensor_width_px, v->area.sensor_height_px);
  add_area(out, &v->area);
  if (v->n_modes) sv_str_add(out, ", \"modes\": [");
  for (int i = 0; i < v->n_modes; i++) {
    sv_str_add(out, "%s{\"size\": [%d, %d], ", i ? ", " : "", v->modes[i].width_px, v->modes[i].height_px);
    add_area(out, &v->modes[i].area);
    sv_str_add(out, "}");
  }
  sv_str_add(out, "%s}", v->n_modes ? "]" : "");
}

static void add_photometric(sv_str *out, const sv_photometry *p) {
  if (p->is_known) sv_str_add(out, ", ");
  sv_photometry_json_write(out, p);
}

static void add_trigger(sv_str *out, const sv_trigger *t) {
  if (t->kind == SV_LINE_NONE) return;
  sv_str_add(out, "  \"trigger\": {\"line\": \"");
  sv_trigger_add_line(out, t);
  sv_str_add(out, "\"");
  if (t->period_ns) sv_str_add(out, ", \"period_us\": %.17g", (double)t->period_ns * 1e-3);
  if (t->width_ns) sv_str_add(out, ", \"width_us\": %.17g", (double)t->width_ns * 1e-3);
  if (t->is_active_low) sv_str_add(out, ", \"polarity\": \"low\"");
  if (t->mode[0]) sv_str_add(out, ", \"mode\": \"%s\"", t->mode);
  sv_str_add(out, "},\n");
}

sv_status sv_rig_json_write_coverage(sv_str *out, const sv_rig *rig, const sv_coverage_names *names) {
  sv_str_add(out, "{\n  \"version\": 1,\n  \"name\": \"");
  sv_str_add_json(out, rig->name);
  sv_str_add(out, "\",\n  \"forward\": \"%s\",\n", forward_names[rig->forward]);
  add_trigger(out, &rig->trigger);
  if (rig->scale_sigma > 0) sv_str_add(out, "  \"scale_sigma\": %.3g,\n", rig->scale_sigma);
  sv_str_add(out, "  \"sub_views\": [");
  for (int i = 0; i < rig->n_sub_views; i++) {
    const sv_sub_view *v = &rig->sub_views[i];
    sv_str_add(out, "%s\n    {\"name\": \"", i ? "," : "");
    sv_str_add_json(out, v->name);
    sv_str_add(out, "\", \"model\": \"");
    sv_str_add_json(out, v->name);
    sv_str_add(out, ".cameramodel\", \"camera\": %d", v->i_camera);
    if (v->footprint.width_px)
      sv_str_add(out, ", \"footprint\": [%d, %d, %d, %d]", v->footprint.x0_px, v->footprint.y0_px,
                 v->footprint.width_px, v->footprint.height_px);
    if (v->shutter.readout_s > 0)
      sv_str_add(out, ", \"readout_ms\": %.6g, \"shutter\": \"%s\"", 1e3 * v->shutter.readout_s,
                 sv_shutter_name(v->shutter.direction));
    if (v->noise.read > 0 || v->noise.shot > 0)
      sv_str_add(out, ", \"noise\": {\"read\": %.6g, \"shot\": %.6g}", v->noise.read, v->noise.shot);
    add_sensor(out, v);
    add_photometric(out, &v->photometric);
    if (names) add_image(out, "coverage", names->name[i]);
    if (names) add_image(out, "mask", names->mask[i]);
    sv_str_add(out, "}");
  }
  sv_str_add(out, "\n  ]\n}\n");
  return out->is_cut ? SV_E_NOMEM : SV_OK;
}
