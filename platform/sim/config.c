// SPDX-License-Identifier: Apache-2.0
// The source string: "SCENE[,option=value]...". Every number option is one line of NUMBERS.
#include <math.h>
#include <stddef.h>
#include <string.h>

#include "platform/sim/sim.h"
#include "src/base/mathx.h"

#define FOCAL_PER_WIDTH 1.3 // 42 degrees across, so that a sphere of 1.1 m fits a 4:3 image

typedef struct {
  const char *p;
  size_t n;
} word;

static bool is(word w, const char *name) { return strlen(name) == w.n && memcmp(w.p, name, w.n) == 0; }

// Splits off the text before the first `sep`; false when nothing is left.
static bool next_word(word *rest, char sep, word *out) {
  if (!rest->p) return false;
  const char *hit = memchr(rest->p, sep, rest->n);
  *out = (word){rest->p, hit ? (size_t)(hit - rest->p) : rest->n};
  *rest = hit ? (word){hit + 1, rest->n - out->n - 1} : (word){NULL, 0};
  return true;
}

static const char *const SCENES[] = {
#define X(id, name, arc_deg, distance_m, text) name,
#include "platform/sim/scenes.inc"
#undef X
};
static const double SCENE_ARC_DEG[] = {
#define X(id, name, arc_deg, distance_m, text) arc_deg,
#include "platform/sim/scenes.inc"
#undef X
};
static const double SCENE_DISTANCE_M[] = {
#define X(id, name, arc_deg, distance_m, text) distance_m,
#include "platform/sim/scenes.inc"
#undef X
};
static const char *const SCENE_TEXTS[] = {
#define X(id, name, arc_deg, distance_m, text) text,
#include "platform/sim/scenes.inc"
#undef X
};
static const char *const RIGS[] = {
#define X(id, name, text, angle_deg, forward, layout, rows, cols, overlap) name,
#include "src/rig/devices.inc"
};
static const char *const FAULTS[] = {
#define X(id, name, default_n, text) name,
#include "platform/sim/faults.inc"
#undef X
};
static const int FAULT_N[] = {
#define X(id, name, default_n, text) default_n,
#include "platform/sim/faults.inc"
#undef X
};

typedef struct {
  const char *name;
  size_t offset;
  bool is_int;
  double lo, hi;
} number_option;
#define REAL(name, field, lo, hi)                                                                            \
  { name, offsetof(sv_sim_config, field), false, lo, hi }
#define WHOLE(name, field, lo, hi)                                                                           \
  { name, offsetof(sv_sim_config, field), true, lo, hi }
static const number_option NUMBERS[] = {
    REAL("fps", fps, 0.1, 1000),
    REAL("angle", angle_deg, 0, 60),
    REAL("overlap", overlap, 1, SV_DEVICE_CAP_OVERLAP),
    REAL("arc", arc_deg, 0, 360),
    REAL("turn_deg_s", turn_deg_s, 0, 360),
    REAL("move_m_s", move_m_s, 0, 10),
    REAL("skew_us", skew_us, 0, 1e6),
    REAL("jitter_us", jitter_us, 0, 1e5),
    REAL("drift_ppm", drift_ppm, -1000, 1000),
    REAL("rate_ppm", rate_ppm, -1000, 1000),
    REAL("offset_ms", offset_ms, -1e7, 1e7),
    REAL("delay_us", delay_us, 0, 1e6),
    REAL("delay_jitter_us", delay_jitter_us, 0, 1e6),
    REAL("shutter_us", shutter_us, 0, 1e6),
    REAL("drop", drop, 0, 1),
    REAL("gain", optics.gain, 0, 0.9),
    REAL("white", optics.white_k, 2000, 20000),
    REAL("crosstalk", optics.crosstalk, 0, 0.3),
    REAL("response", optics.response, 0.3, 3),
    REAL("black", optics.black, 0, 0.5),
    REAL("auto_exposure", optics.auto_exposure, 0.05, 20),
    REAL("light", optics.light, 1e-4, 1e4),
    REAL("flat", optics.flat, 0, 1),
    REAL("bracket", optics.bracket, 1e-3, 1e3),
    REAL("readout_ms", optics.readout_ms, 0, 1000),
    REAL("aperture_mm", optics.aperture_mm, 0, 200),
    REAL("focus_m", optics.focus_m, 0.1, 1000),
    WHOLE("samples", optics.n_samples, 1, 1024),
    WHOLE("hot", optics.n_hot, 0, 10000),
    WHOLE("exposures", n_exposures, 1, 100000),
    WHOLE("frames", n_frames, 0, 1e9),
    WHOLE("jpeg", jpeg_quality, 0, 100),
    WHOLE("buffers", n_buffers, 1, SV_SIM_CAP_BUFFERS),
};
#define N_NUMBERS ((int)(sizeof NUMBERS / sizeof *NUMBERS))

static sv_status unknown(sv_err *err, const char *what, word w, const char *const *names, int n) {
  char list[160];
  sv_str s = sv_str_make(list, sizeof list);
  for (int i = 0; i < n; i++) sv_str_add(&s, "%s%s", i ? ", " : "", names[i]);
  return sv_fail(err, SV_E_NOT_FOUND, "sim: no %s called '%.*s'; available: %s", what,
                 (int)(w.n < 40 ? w.n : 40), w.p, list);
}

static int find(word w, const char *const *names, int n) {
  for (int i = 0; i < n; i++)
    if (is(w, names[i])) return i;
  return -1;
}

static sv_status bad(sv_err *err, const char *name, word v, const char *expected) {
  return sv_fail(err, SV_E_ARG, "sim: %s=%.*s: expected %s", name, (int)(v.n < 40 ? v.n : 40), v.p, expected);
}

// Two whole numbers "AxB" from lo to hi.
static bool read_pair(word v, int lo, int hi, int *a, int *b) {
  word rest = v, w[2] = {{0}}, more;
  long long x[2] = {0};
  bool ok = next_word(&rest, 'x', &w[0]) && next_word(&rest, 'x', &w[1]) && !next_word(&rest, 'x', &more);
  for (int i = 0; i < 2 && ok; i++) ok = sv_parse_int(w[i].p, w[i].n, &x[i]) && x[i] >= lo && x[i] <= hi;
  if (ok) {
    *a = (int)x[0];
    *b = (int)x[1];
  }
  return ok;
}

static sv_status read_size(sv_sim_config *c, word v, sv_err *err) {
  bool ok = read_pair(v, 16, 4096, &c->width_px, &c->height_px);
  return ok ? SV_OK : bad(err, "size", v, "WIDTHxHEIGHT, 16 to 4096 pixels each");
}

// pinhole, or kb4:DEG or tiles:DEG.
static sv_status read_lens(sv_sim_config *c, word v, sv_err *err) {
  word rest = v, name = {0}, deg = {0};
  (void)next_word(&rest, ':', &name);
  const bool has_deg = next_word(&rest, ':', &deg);
  c->lens = is(name, "kb4") ? SV_SIM_LENS_KB4 : is(name, "tiles") ? SV_SIM_LENS_TILES : SV_SIM_LENS_PINHOLE;
  bool ok = c->lens || (is(name, "pinhole") && !has_deg);
  if (c->lens)
    ok = has_deg && sv_parse_double(deg.p, deg.n, &c->lens_deg) && c->lens_deg >= 30 && c->lens_deg <= 190;
  return ok ? SV_OK
            : bad(err, "lens", v, "pinhole, kb4:DEG or tiles:DEG, 30 to 190 degrees across the diagonal");
}

static sv_status read_grid(sv_sim_config *c, word v, sv_err *err) {
  bool ok = read_pair(v, 1, SV_CAP_SUB_VIEWS, &c->grid_rows, &c->grid_cols) &&
            c->grid_rows * c->grid_cols <= SV_CAP_SUB_VIEWS;
  return ok ? SV_OK : bad(err, "grid", v, "ROWSxCOLS, 1 to 256 lenses");
}

// read:V:shot:V in either order; one may be omitted.
static sv_status read_noise(sv_sim_config *c, word v, sv_err *err) {
  word rest = v, name, value;
  while (next_word(&rest, ':', &name)) {
    double x;
    bool is_read = is(name, "read"), is_shot = is(name, "shot");
    if ((!is_read && !is_shot) || !next_word(&rest, ':', &value) || !sv_parse_double(value.p, value.n, &x) ||
        !(x >= 0 && x <= 1))
      return bad(err, "noise", v, "read:V:shot:V, variances from 0 to 1 in linear light");
    *(is_read ? &c->noise_read : &c->noise_shot) = x;
  }
  return SV_OK;
}

// cos4, or K1[:K2[:K3]].
static sv_status read_vignetting(sv_sim_config *c, word v, sv_err *err) {
  word rest = v, w;
  double sum = 1, *k = c->optics.vignetting;
  c->optics.is_cos4 = is(v, "cos4");
  k[0] = k[1] = k[2] = 0;
  for (int i = 0; !c->optics.is_cos4 && next_word(&rest, ':', &w); i++) {
    if (i >= 3 || !sv_parse_double(w.p, w.n, &k[i]) || !(k[i] >= -2 && k[i] <= 2))
      return bad(err, "vignetting", v, "cos4, or K1[:K2[:K3]] from -2 to 2");
    sum += k[i];
  }
  return sum > 0 ? SV_OK : bad(err, "vignetting", v, "1 + K1 + K2 + K3 above 0: some light in the corners");
}

static sv_status read_faults(sv_sim_config *c, word v, sv_err *err) {
  word rest = v, one;
  c->n_faults = 0;
  while (next_word(&rest, '+', &one)) {
    word parts = one, name = {0}, w;
    long long args[3] = {0, 5, 0};
    (void)next_word(&parts, ':', &name);
    int kind = find(name, FAULTS, SV_SIM_N_FAULTS);
    if (kind < 0) return unknown(err, "fault", name, FAULTS, SV_SIM_N_FAULTS);
    args[2] = FAULT_N[kind];
    for (int i = 0; next_word(&parts, ':', &w); i++)
      if (i >= 3 || !sv_parse_int(w.p, w.n, &args[i]) || (i < 2 && args[i] < 0) || args[i] > 1000000000 ||
          args[i] < -1000000000 || (kind != SV_SIM_FAULT_CLOCKSTEP && args[i] < 0))
        return bad(err, "fault", one,
                   "NAME[:CAMERA[:SLOT[:N]]], whole numbers; only clockstep takes a negative N");
    if (c->n_faults == SV_SIM_CAP_FAULTS) return bad(err, "fault", v, "at most 8 faults");
    c->faults[c->n_faults++] = (sv_sim_fault){(sv_sim_fault_kind)kind, (int)args[0], (int)args[2], args[1]};
  }
  return SV_OK;
}

static sv_status read_number(sv_sim_config *c, const number_option *o, word v, sv_err *err) {
  double x;
  char expected[80];
  if (!sv_parse_double(v.p, v.n, &x) || !(x >= o->lo && x <= o->hi) || (o->is_int && x != floor(x))) {
    (void)sv_fmt(expected, sizeof expected, "a %snumber from %g to %g", o->is_int ? "whole " : "", o->lo,
                 o->hi);
    return bad(err, o->name, v, expected);
  }
  if (o->is_int) *(int *)((char *)c + o->offset) = (int)x;
  else *(double *)((char *)c + o->offset) = x;
  return SV_OK;
}

static sv_status unknown_option(word name, sv_err *err) {
  static const char *const others[] = {"rig",   "grid",       "size",    "noise", "fault", "seed", "path",
                                       "poses", "vignetting", "shutter", "blur",  "depth", "lock"};
  const int n = (int)(name.n < 20 ? name.n : 20);
  sv_near_name near = sv_near_make(name.p, name.n);
  for (size_t i = 0; i < sizeof others / sizeof *others; i++) sv_near_try(&near, others[i]);
  for (int i = 0; i < N_NUMBERS; i++) sv_near_try(&near, NUMBERS[i].name);
  if (near.name)
    return sv_fail(err, SV_E_NOT_FOUND, "sim: no option '%.*s' (did you mean %s?)", n, name.p, near.name);
  return sv_fail(err, SV_E_NOT_FOUND, "sim: no option '%.*s'; `subview cameras` lists them", n, name.p);
}

static sv_status read_option(sv_sim_config *c, word option, sv_err *err) {
  word v = option, name = {0};
  (void)next_word(&v, '=', &name);
  if (!v.p) v = (word){"", 0};
  if (is(name, "rig")) {
    int rig = find(v, RIGS, SV_N_DEVICES);
    if (rig < 0) return unknown(err, "rig", v, RIGS, SV_N_DEVICES);
    c->rig = (sv_device_id)rig;
    return SV_OK;
  }
  if (is(name, "grid")) return read_grid(c, v, err);
  if (is(name, "lens")) return read_lens(c, v, err);
  if (is(name, "size")) return read_size(c, v, err);
  if (is(name, "noise")) return read_noise(c, v, err);
  if (is(name, "fault")) return read_faults(c, v, err);
  if (is(name, "seed")) {
    long long seed;
    if (!sv_parse_int(v.p, v.n, &seed) || seed < 0 || seed > 0xffffffffll)
      return bad(err, "seed", v, "a whole number from 0 to 4294967295");
    c->seed = (uint32_t)seed;
    return SV_OK;
  }
  if (is(name, "depth")) {
    c->is_deep = is(v, "16");
    return c->is_deep || is(v, "8") ? SV_OK : bad(err, "depth", v, "8 or 16 bits");
  }
  if (is(name, "path")) {
    c->is_handheld = is(v, "handheld");
    c->is_swaying = is(v, "sway");
    c->is_smooth = c->is_handheld || c->is_swaying || is(v, "smooth");
    return c->is_smooth || is(v, "step") ? SV_OK : bad(err, "path", v, "step, smooth, handheld or sway");
  }
  if (is(name, "poses")) {
    c->has_unknown_poses = is(v, "unknown");
    return c->has_unknown_poses || is(v, "known") ? SV_OK : bad(err, "poses", v, "known or unknown");
  }
  if (is(name, "vignetting")) return read_vignetting(c, v, err);
  if (is(name, "shutter")) {
    const char *names[SV_N_SHUTTERS];
    for (int i = 0; i < SV_N_SHUTTERS; i++) names[i] = sv_shutter_name((sv_shutter_direction)i);
    const int direction = find(v, names, SV_N_SHUTTERS);
    if (direction < 0) return unknown(err, "shutter", v, names, SV_N_SHUTTERS);
    c->optics.shutter = (sv_shutter_direction)direction;
    return SV_OK;
  }
  if (is(name, "lock")) {
    static const char *const locks[] = {"given", "on", "shared"};
    const int lock = find(v, locks, 3);
    if (lock < 0) return bad(err, "lock", v, "given, on or shared");
    c->optics.lock = (sv_sim_lock)lock;
    return SV_OK;
  }
  if (is(name, "blur")) {
    c->optics.is_blurred = is(v, "on");
    return c->optics.is_blurred || is(v, "off") ? SV_OK : bad(err, "blur", v, "on or off");
  }
  for (int i = 0; i < N_NUMBERS; i++)
    if (is(name, NUMBERS[i].name)) return read_number(c, &NUMBERS[i], v, err);
  return unknown_option(name, err);
}

double sv_sim_distance_m(const sv_sim_config *c) { return SCENE_DISTANCE_M[c->scene]; }

sv_device_params sv_sim_device(const sv_sim_config *c) {
  return (sv_device_params){.device = c->rig,
                            .width_px = c->width_px,
                            .height_px = c->height_px,
                            .focal_per_width = FOCAL_PER_WIDTH,
                            .distance_m = sv_sim_distance_m(c),
                            .angle_rad = c->angle_deg * SV_PI / 180,
                            .rows = c->grid_rows,
                            .cols = c->grid_cols,
                            .overlap = c->overlap};
}

// Options that are not given default to the device's values.
static void complete(sv_sim_config *c) {
  const sv_device_info *d = sv_device_info_of(c->rig);
  if (c->arc_deg < 0) c->arc_deg = SCENE_ARC_DEG[c->scene];
  if (c->angle_deg < 0) c->angle_deg = d->angle_deg;
  if (c->grid_rows < 1) {
    c->grid_rows = d->rows;
    c->grid_cols = d->cols;
  }
  if (c->overlap < 1) c->overlap = d->overlap;
}

sv_sim_config sv_sim_defaults(void) {
  return (sv_sim_config){.scene = SV_SIM_SCENE_TEXTURED,
                         .rig = SV_DEVICE_STEREO,
                         .width_px = 320,
                         .height_px = 240,
                         .fps = 10,
                         .angle_deg = sv_device_info_of(SV_DEVICE_STEREO)->angle_deg,
                         .grid_rows = 1,
                         .grid_cols = 1,
                         .overlap = 1,
                         .n_exposures = 8,
                         .arc_deg = SCENE_ARC_DEG[SV_SIM_SCENE_TEXTURED],
                         .turn_deg_s = 30,
                         .move_m_s = 0.3,
                         .seed = 1,
                         .delay_us = 3000,
                         .shutter_us = 4000,
                         .optics = sv_sim_optics_defaults(),
                         .n_buffers = 4};
}

sv_status sv_sim_parse(sv_sim_config *out, const char *spec, sv_err *err) {
  sv_sim_config c = sv_sim_defaults();
  word rest = {spec, strlen(spec)}, w = {0};
  (void)next_word(&rest, ',', &w);
  int scene = find(w, SCENES, SV_SIM_N_SCENES);
  if (scene < 0) return unknown(err, "scene", w, SCENES, SV_SIM_N_SCENES);
  c.scene = (sv_sim_scene_id)scene;
  // filled in below from scene and rig unless an option does
  c.arc_deg = c.angle_deg = c.overlap = -1;
  c.grid_rows = c.grid_cols = 0;
  while (next_word(&rest, ',', &w)) {
    sv_status s = read_option(&c, w, err);
    if (s < 0) return s;
  }
  complete(&c);
  sv_status s = sv_sim_check(&c, err);
  if (s < 0) return s;
  *out = c;
  return SV_OK;
}

sv_status sv_sim_check(const sv_sim_config *c, sv_err *err) {
  for (int i = 0; i < N_NUMBERS; i++) {
    const number_option *o = &NUMBERS[i];
    const char *at = (const char *)c + o->offset;
    double x = o->is_int ? *(const int *)at : *(const double *)at;
    if (!(x >= o->lo && x <= o->hi))
      return sv_fail(err, SV_E_ARG, "sim: %s is %g: expected %g to %g", o->name, x, o->lo, o->hi);
  }
  if (c->scene >= SV_SIM_N_SCENES || c->rig >= SV_N_DEVICES || c->n_faults < 0 ||
      c->n_faults > SV_SIM_CAP_FAULTS || c->width_px < 16 || c->width_px > 4096 || c->height_px < 16 ||
      c->height_px > 4096)
    return sv_fail(err, SV_E_ARG, "sim: scene, rig, size or number of faults is out of range");
  sv_device_params device = sv_sim_device(c);
  sv_status s = sv_device_check(&device, err);
  if (s < 0) return s;
  const sv_device_info *info = sv_device_info_of(c->rig);
  if (c->lens != SV_SIM_LENS_PINHOLE && info->layout == SV_LAYOUT_GRID)
    return sv_fail(err, SV_E_ARG,
                   "sim: lens=: rig %s has small lenses of its own; expected mono, stereo or phone",
                   RIGS[c->rig]);
  if (c->jpeg_quality > 0 && sv_sim_is_deep(c))
    return sv_fail(err, SV_E_ARG, "sim: jpeg=%d: frames have 16 bits, which JPEG does not code (rig %s)",
                   c->jpeg_quality, RIGS[c->rig]);
  int n_cameras = sv_device_n_cameras(c->rig);
  for (int i = 0; i < c->n_faults; i++)
    if (c->faults[i].i_camera < 0 || c->faults[i].i_camera >= n_cameras)
      return sv_fail(err, SV_E_ARG, "sim: fault %s names camera %d: rig %s has cameras 0 to %d",
                     FAULTS[c->faults[i].kind], c->faults[i].i_camera, RIGS[c->rig], n_cameras - 1);
  double slack_us = 1e6 / c->fps;
  if (c->skew_us + c->delay_jitter_us > 0.5 * slack_us)
    return sv_fail(err, SV_E_ARG, "sim: skew_us + delay_jitter_us is %g: expected at most half a period, %g",
                   c->skew_us + c->delay_jitter_us, 0.5 * slack_us);
  return SV_OK;
}

void sv_sim_list(sv_str *out) {
  for (int i = 0; i < SV_SIM_N_SCENES; i++) sv_str_add(out, "sim:%-10s %s\n", SCENES[i], SCENE_TEXTS[i]);
  sv_str_add(out, "  options: rig=");
  for (int i = 0; i < SV_N_DEVICES; i++) sv_str_add(out, "%s%s", i ? "|" : "", RIGS[i]);
  sv_str_add(
      out, ", grid=RxC, lens=pinhole|kb4:DEG|tiles:DEG, size=WxH, seed=N, path=step|smooth|handheld|sway, "
           "poses=known|unknown, "
           "noise=read:V:shot:V, depth=8|16, "
           "fault=NAME[:CAMERA[:SLOT[:N]]][+...], vignetting=cos4|K1[:K2[:K3]], shutter=down|up|right|left, "
           "blur=on|off, lock=given|on|shared");
  for (int i = 0; i < N_NUMBERS; i++) sv_str_add(out, ", %s=", NUMBERS[i].name);
  sv_str_add(out, "\n  faults: ");
  for (int i = 0; i < SV_SIM_N_FAULTS; i++) sv_str_add(out, "%s%s", i ? ", " : "", FAULTS[i]);
  sv_str_add(out, "\n");
}
