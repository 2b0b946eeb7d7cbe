// SPDX-License-Identifier: Apache-2.0
// An instance: its settings, and how it divides the caller's block.
#include "src/library/instance.h"

#include "src/base/mathx.h"
#include "src/base/str.h"
#include "src/splat/constants.h"
#include "src/train/objective.h"
#include "src/train/stereo.h"

#define QUEUE_LEN 4 // frames of one camera that may wait for those of the others

#define SAME(name) _Static_assert((int)SUBVIEW_##name == (int)SV_##name, #name)
SAME(OK);
SAME(AGAIN);
SAME(END);
SAME(E_ARG);
SAME(E_NOMEM);
SAME(E_IO);
SAME(E_FORMAT);
SAME(E_RANGE);
SAME(E_UNSUPPORTED);
SAME(E_NOT_FOUND);
SAME(E_DEVICE);
SAME(E_FULL);
SAME(E_CORRUPT);
_Static_assert(sizeof(subview_error) == sizeof(sv_err), "subview_error");
_Static_assert(sizeof(subview_pose) == sizeof(sv_pose), "subview_pose");
_Static_assert(sizeof(subview_gaussian) == sizeof(sv_gaussian), "subview_gaussian");

static subview_pose pose_out(const sv_pose *p) {
  subview_pose out;
  memcpy(&out, p, sizeof out);
  return out;
}

// --- settings ------------------------------------------------------------------------------------

const char *subview_version(void) { return SUBVIEW_VERSION; }
const char *subview_error_text(subview_status s) { return sv_status_text(s); }

subview_pose subview_pose_identity(void) {
  const sv_pose p = sv_pose_identity();
  return pose_out(&p);
}

subview_pose subview_pose_mul(const subview_pose *a_from_b, const subview_pose *b_from_c) {
  const sv_pose a = pose_in(a_from_b), b = pose_in(b_from_c), c = sv_pose_mul(&a, &b);
  return pose_out(&c);
}

subview_status subview_pose_look_at(subview_pose *cam_from_world, const double eye[3], const double at[3],
                                    const double up[3]) {
  sv_pose p;
  if (!sv_pose_look_at(&p, eye, at, up)) return SV_E_ARG;
  *cam_from_world = pose_out(&p);
  return SV_OK;
}

subview_camera subview_camera_defaults(int width_px, int height_px) {
  return (subview_camera){.width_px = width_px,
                          .height_px = height_px,
                          .p = {width_px, width_px, 0.5 * width_px, 0.5 * height_px},
                          .cam_from_rig = subview_pose_identity()};
}

subview_config subview_defaults(void) {
  const sv_train_cfg t = sv_train_defaults();
  return (subview_config){.n_exposures = 1,
                          .n_gaussians = t.n_gaussians,
                          .sh_degree = t.sh_degree,
                          .n_steps = t.expected_steps,
                          .seed = t.seed,
                          .skew_limit_s = 0.002};
}

static sv_pixel_format format_of(subview_pixels p) {
  static const sv_pixel_format all[] = {SV_PIX_RGB8,  SV_PIX_BGR8, SV_PIX_RGBX8, SV_PIX_BGRX8,
                                        SV_PIX_GREY8, SV_PIX_YUYV, SV_PIX_UYVY,  SV_PIX_NV12};
  return (unsigned)p < sizeof all / sizeof *all ? all[p] : SV_PIX_NONE;
}

static sv_camera_caps caps_of(const subview_camera *c, int i, bool has_own_clock) {
  const sv_pixel_format format = format_of(c->pixels);
  sv_camera_caps caps = {.width_px = c->width_px,
                         .height_px = c->height_px,
                         .format = format,
                         .clock = has_own_clock ? SV_CLOCK_CAMERA : SV_CLOCK_MONOTONIC,
                         .stamp = SV_STAMP_START,
                         .frame_bytes = sv_pixel_frame_bytes(format, c->width_px, c->height_px),
                         .yuv = (sv_yuv_kind)c->yuv};
  sv_fmt(caps.name, sizeof caps.name, "camera %d", i);
  return caps;
}

static sv_sub_view sub_view_of(const subview_camera *c, int i) {
  static const sv_model_kind kinds[] = {SV_MODEL_PINHOLE, SV_MODEL_OPENCV4, SV_MODEL_OPENCV5,
                                        SV_MODEL_OPENCV8, SV_MODEL_KB4};
  sv_sub_view v = {.i_camera = i, .cam_from_rig = pose_in(&c->cam_from_rig)};
  v.model = (sv_camera_model){.kind = kinds[c->lens], .width_px = c->width_px, .height_px = c->height_px};
  memcpy(v.model.p, c->p, sizeof c->p);
  sv_fmt(v.name, sizeof v.name, "camera %d", i);
  return v;
}

static sv_status check_camera(const subview_camera *c, int i, sv_err *err) {
  if (c->width_px < 1 || c->height_px < 1 || c->width_px > 16384 || c->height_px > 16384)
    return sv_fail(err, SV_E_ARG, "camera %d: %dx%d pixels, expected 1 to 16384 a side", i, c->width_px,
                   c->height_px);
  if (format_of(c->pixels) == SV_PIX_NONE || (unsigned)c->yuv > SUBVIEW_YUV_709_FULL ||
      (unsigned)c->lens > SUBVIEW_LENS_FISHEYE)
    return sv_fail(err, SV_E_ARG, "camera %d: unknown pixel layout, colour matrix or lens model", i);
  if (!(c->p[0] > 0 && c->p[1] > 0))
    return sv_fail(err, SV_E_ARG, "camera %d: focal lengths of %g and %g px, expected more than 0", i,
                   c->p[0], c->p[1]);
  if (sv_rotation_error(c->cam_from_rig.r) > 1e-3)
    return sv_fail(err, SV_E_ARG, "camera %d: the matrix of its pose is not a rotation", i);
  return SV_OK;
}

static sv_status check(const subview_config *c, sv_err *err) {
  if (!c->cameras || c->n_cameras < 1 || c->n_cameras > SV_CAP_SUB_VIEWS)
    return sv_fail(err, SV_E_ARG, "%d cameras, expected 1 to %d", c->n_cameras, SV_CAP_SUB_VIEWS);
  if (c->n_exposures < 1 || c->n_exposures > 1000000 / c->n_cameras)
    return sv_fail(err, SV_E_ARG, "%d exposures, expected 1 to %d", c->n_exposures, 1000000 / c->n_cameras);
  if (c->n_steps < 1) return sv_fail(err, SV_E_ARG, "%d steps, expected 1 or more", c->n_steps);
  if (!(c->skew_limit_s > 0 && c->skew_limit_s < 10))
    return sv_fail(err, SV_E_ARG, "a skew limit of %g s, expected more than 0 and less than 10",
                   c->skew_limit_s);
  if (c->has_bounds && !(c->radius > 0))
    return sv_fail(err, SV_E_ARG, "a scene of radius %g m, expected more than 0", (double)c->radius);
  if (c->pool.run && (c->pool.n_threads < 1 || c->pool.n_threads > 256))
    return sv_fail(err, SV_E_ARG, "%d threads, expected 1 to 256", c->pool.n_threads);
  for (int i = 0; i < c->n_cameras; i++) {
    sv_status s = check_camera(&c->cameras[i], i, err);
    if (s < 0) return s;
  }
  return SV_OK;
}

static int n_threads_of(const subview_config *c) { return c->pool.run ? c->pool.n_threads : 1; }

static void widen(sv_train_cfg *t, int width_px, int height_px) {
  const size_t px = sv_plane_floats(width_px, height_px);
  t->cap_width_px = sv_maxi(t->cap_width_px, width_px);
  t->cap_height_px = sv_maxi(t->cap_height_px, height_px);
  if (px > t->cap_pixels) t->cap_pixels = px;
}

static sv_train_cfg train_cfg(const subview_config *c) {
  sv_train_cfg t = sv_train_defaults();
  double f_min = c->cameras[0].p[0], f_max = f_min;
  t.n_gaussians = c->n_gaussians;
  t.sh_degree = c->sh_degree;
  t.seed = c->seed;
  t.expected_steps = c->n_steps;
  t.cap_views = c->n_exposures * c->n_cameras;
  t.n_threads = n_threads_of(c);
  t.cap_width_px = 1;
  t.cap_height_px = 1;
  for (int i = 0; i < c->n_cameras; i++) {
    widen(&t, c->cameras[i].width_px, c->cameras[i].height_px);
    f_min = sv_mind(f_min, c->cameras[i].p[0]);
    f_max = sv_maxd(f_max, c->cameras[i].p[0]);
  }
  if (c->render_width_px > 0 && c->render_height_px > 0) widen(&t, c->render_width_px, c->render_height_px);
  t.is_antialiased = f_max > (double)SV_MIP_FOCAL_RATIO * f_min;
  sv_sampling sampling = {.n_exposures = c->n_exposures, .n_sub_views = c->n_cameras};
  for (int i = 0; i < c->n_cameras; i++)
    sampling.largest_px = sv_maxi(sampling.largest_px, c->cameras[i].width_px * c->cameras[i].height_px);
  sv_train_set_objective(&t, &sampling);
  return t;
}

// --- memory --------------------------------------------------------------------------------------

static sv_sync_cfg sync_cfg(const subview_config *c, const sv_sync_camera *cameras) {
  return (sv_sync_cfg){.n_cameras = c->n_cameras,
                       .cameras = cameras,
                       .clock_mode = c->has_own_clocks ? SV_SYNC_CLOCK_ESTIMATE : SV_SYNC_CLOCK_COMMON,
                       .skew_limit_ns = (sv_ns)(c->skew_limit_s * 1e9),
                       .queue_len = QUEUE_LEN};
}

// A pool of one camera's images needs its rig of one; all such pools together are at least as large
// as the real one.
static sv_status count_exposures(const subview_config *c, sv_arena *a, sv_err *err) {
  sv_status s = SV_OK;
  for (int i = 0; i < c->n_cameras && s >= 0; i++) {
    sv_sub_view view = sub_view_of(&c->cameras[i], 0);
    sv_camera_caps caps = caps_of(&c->cameras[i], 0, false);
    sv_rig rig = {.n_sub_views = 1, .cap_sub_views = 1, .sub_views = &view};
    sv_exposures pool;
    const sv_exposures_cfg ec = {.rig = &rig,
                                 .cap_exposures = c->n_exposures,
                                 .caps = &caps,
                                 .n_cameras = 1,
                                 .n_threads = n_threads_of(c)};
    s = sv_exposures_init(&pool, &ec, a, err);
  }
  return s;
}

static size_t scratch_bytes(const sv_train_cfg *t) {
  const size_t fill = sv_init_scratch_bytes(t->n_gaussians, t->n_gaussians), sweep = sv_sweep_bytes(t);
  return (fill > sweep ? fill : sweep) + 4096;
}

// What does not depend on whether the arena is dry. The trainer has named parts of its own, so it
// comes before.
static void carve_scratch(subview *s, const subview_config *c, const sv_train_cfg *t, sv_arena *a) {
  sv_arena_part_begin(a, "start-up scratch");
  sv_point *points = SV_TAKE(a, sv_point, c->n_gaussians);
  sv_view *views = SV_TAKE(a, sv_view, t->cap_views);
  sv_arena scratch = sv_arena_sub(a, scratch_bytes(t));
  if (!s) return;
  s->points = points;
  s->views = views;
  s->scratch = scratch;
}

static sv_status check_train(const sv_train_cfg *t, sv_err *err) {
  if (t->n_gaussians < 1 || t->n_gaussians > 4000000)
    return sv_fail(err, SV_E_ARG, "%d Gaussians, expected 1 to 4000000", t->n_gaussians);
  if (t->sh_degree < 0 || t->sh_degree > 3)
    return sv_fail(err, SV_E_ARG, "an SH degree of %d, expected 0 to 3", t->sh_degree);
  return SV_OK;
}

subview_status subview_bytes(const subview_config *config, size_t *bytes, subview_error *error) {
  sv_arena a = sv_arena_dry();
  sv_status s = check(config, err_of(error));
  if (s < 0) return s;
  const sv_train_cfg t = train_cfg(config);
  const sv_sync_camera any = {0}; // sizes do not depend on what cameras say
  const sv_sync_cfg sc = sync_cfg(config, &any);
  if ((s = check_train(&t, err_of(error))) < 0) return s;
  SV_TAKE(&a, subview, 1);
  SV_TAKE(&a, sv_camera_caps, config->n_cameras);
  SV_TAKE(&a, sv_sub_view, config->n_cameras);
  if ((s = count_exposures(config, &a, err_of(error))) < 0) return s;
  SV_TAKE(&a, sv_sync_camera, config->n_cameras);
  SV_TAKE(&a, uint8_t, sv_sync_bytes(&sc));
  SV_TAKE(&a, sv_frame, config->n_cameras);
  SV_TAKE(&a, uint8_t, sv_trainer_bytes(&t));
  carve_scratch(NULL, config, &t, &a);
  *bytes = a.used_bytes + SUBVIEW_ALIGN; // of a block that begins anywhere
  return SV_OK;
}

static sv_status carve(subview *s, const subview_config *c, sv_err *err) {
  sv_arena *a = &s->arena;
  s->caps = SV_TAKE(a, sv_camera_caps, c->n_cameras);
  sv_status r = sv_rig_init(&s->rig, c->n_cameras, a);
  if (r < 0 || !s->caps) return SV_E_NOMEM;
  for (int i = 0; i < c->n_cameras; i++) {
    s->caps[i] = caps_of(&c->cameras[i], i, c->has_own_clocks);
    s->rig.sub_views[i] = sub_view_of(&c->cameras[i], i);
  }
  s->rig.n_sub_views = c->n_cameras;
  sv_arena_part_begin(a, "exposures");
  const sv_exposures_cfg ec = {.rig = &s->rig,
                               .cap_exposures = c->n_exposures,
                               .caps = s->caps,
                               .n_cameras = c->n_cameras,
                               .n_threads = n_threads_of(c)};
  if ((r = sv_exposures_init(&s->exposures, &ec, a, err)) < 0) return r;
  sv_sync_camera *cameras = SV_TAKE(a, sv_sync_camera, c->n_cameras);
  if (!cameras) return SV_E_NOMEM;
  for (int i = 0; i < c->n_cameras; i++) cameras[i] = sv_sync_camera_of(&s->caps[i]);
  const sv_sync_cfg sc = sync_cfg(c, cameras);
  if ((r = sv_sync_init(&s->sync, &sc, a)) < 0) return r;
  s->frames = SV_TAKE(a, sv_frame, c->n_cameras);
  const sv_train_cfg t = train_cfg(c);
  if ((r = sv_trainer_init(&s->trainer, &t, (sv_compute){&s->kernels, &s->pool}, a, err)) < 0) return r;
  carve_scratch(s, c, &t, a);
  return a->status;
}

subview_status subview_init(subview **out, const subview_config *config, void *block, size_t bytes,
                            subview_error *error) {
  sv_err *err = err_of(error);
  size_t needed;
  *out = NULL;
  sv_status r = subview_bytes(config, &needed, error);
  if (r < 0) return r;
  sv_arena arena = sv_arena_make(block, bytes);
  sv_arena_part_begin(&arena, "instance");
  subview *s = SV_TAKE(&arena, subview, 1);
  if (s) {
    memset(s, 0, sizeof *s);
    s->arena = arena;
    s->pool = sv_pool_serial();
    if (config->pool.run) s->pool = (sv_pool){config->pool.self, config->pool.n_threads, config->pool.run};
    sv_kernels_init(&s->kernels, ~0u);
    s->n_steps = config->n_steps;
    s->has_bounds = config->has_bounds;
    memcpy(s->bounds.centre, config->centre, sizeof s->bounds.centre);
    s->bounds.radius = config->radius;
    r = carve(s, config, err);
  }
  if (!s || r == SV_E_NOMEM)
    return sv_fail(err, SV_E_NOMEM, "the block has %zu bytes, expected at least %zu", bytes, needed);
  if (r < 0) return r;
  sv_arena_seal(&s->arena);
  *out = s;
  return SV_OK;
}

subview_status subview_memory_part(const subview *s, int i, subview_part *out) {
  if (i < 0 || i >= s->arena.n_parts) return SV_E_RANGE;
  *out = (subview_part){s->arena.parts[i].name, s->arena.parts[i].bytes};
  return SV_OK;
}
