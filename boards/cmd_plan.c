// SPDX-License-Identifier: Apache-2.0
// subview plan: the memory map of a run on this board, and what else would fit.
#include <string.h>

#include "boards/board_main.h"
#include "boards/mesh_out.h"
#include "src/run/arrays.h"
#include "src/prior/methods.h"

#define CAP_TRACKED 16 // cameras of a plan with odometry

typedef struct {
  options_common common;
  long gaussians, sh, images, threads, arena_mib;
  long odometry;    // sub-views of a rig whose poses are not known; 0: they are
  double history_s; // of a live run of a moving scene; below 0: another run
  const char *size, *frames, *grid, *prior, *depth;
  bool is_json, is_rolling, is_mesh;
} plan_options;

static struct {
  sv_app app;
  sv_arena dry;
  sv_sub_view sub[SV_CAP_SUB_VIEWS];
  sv_rig rig;
  sv_camera_caps caps[CAP_TRACKED];
} p;

static bool is_deep(const plan_options *o) { return o->depth && !strcmp(o->depth, "16"); }

// Bytes of a run with so many Gaussians and pictures; 0 when the settings are refused.
static size_t bytes_of(const plan_options *o, long gaussians, int sh, long images) {
  int n = o->odometry > 0 ? (int)o->odometry : 1;
  sv_app_cfg c = {.rig = &p.rig,
                  .n_cameras = n,
                  .caps = p.caps,
                  .source_name = "plan",
                  .n_exposures = (int)((images + n - 1) / n),
                  .is_deep = is_deep(o),
                  .is_dynamic = o->history_s >= 0,
                  .is_continuous = o->history_s >= 0,
                  .exposure_s = SV_EXPOSURE_S,
                  .history_s = o->history_s,
                  .dynamic = sv_dynamic_defaults(),
                  .is_tracking = o->odometry > 0,
                  .skew_limit_ns = 20 * SV_NS_PER_MS,
                  .prior = (sv_prior_method)sv_prior_method_by_name(o->prior),
                  .train = sv_train_defaults(),
                  .steps = 1};
  c.train.n_gaussians = (int)gaussians;
  c.train.sh_degree = sh;
  p.dry = sv_arena_dry();
  if (sv_app_plan(&p.app, &c, (int)o->threads, &p.dry, NULL) < 0) return 0;
  mesh_out mesh;
  if (o->is_mesh && mesh_out_carve(&mesh, &c, &p.dry, NULL) < 0) return 0;
  return p.dry.used_bytes;
}

static sv_arrays arrays_of(const plan_options *o) {
  sv_train_cfg c = sv_train_defaults();
  c.sh_degree = (int)o->sh;
  if (o->grid) c.cap_measurements = c.cap_regions = 1;
  return sv_arrays_of(&c);
}

// Largest n in [0, max] with bytes(n) <= cap.
static long largest(const plan_options *o, size_t cap, int sh, bool is_images, long max) {
  long lo = 0, hi = max;
  while (lo < hi) {
    long mid = lo + (hi - lo + 1) / 2;
    size_t b = is_images ? bytes_of(o, o->gaussians, (int)o->sh, mid) : bytes_of(o, mid, sh, o->images);
    if (b && b <= cap) lo = mid;
    else hi = mid - 1;
  }
  return lo;
}

static void print_text(const plan_options *o, size_t cap, size_t used, int w, int h) {
  static char text[4096];
  sv_str s = sv_str_make(text, sizeof text);
  sv_app_memory_map(&s, &p.dry, false);
  say(1, "board %s: %ld Gaussians of SH degree %ld, %ld images of %dx%d, %ld threads\n\n%s", BOARD_NAME,
      o->gaussians, o->sh, o->images, w, h, o->threads, text);
  say(1, "%-22s %12zu\n%-22s %12zu  %s\n\n", "sum", used, "block", cap,
      used <= cap ? "it fits" : "IT DOES NOT FIT");
  say(1, "in this block, with %ld images: at most %ld Gaussians at SH 0, %ld at SH 1, %ld at SH 3\n",
      o->images, largest(o, cap, 0, false, 4000000), largest(o, cap, 1, false, 4000000),
      largest(o, cap, 3, false, 4000000));
  say(1, "in this block, with %ld Gaussians at SH %ld: at most %ld images\n\n", o->gaussians, o->sh,
      largest(o, cap, 0, true, 100000));
  sv_arrays f = arrays_of(o);
  s = sv_str_make(text, sizeof text);
  sv_arrays_print(&s, &f, false);
  say(1, "%s", text);
}

static void print_json(const plan_options *o, size_t cap, size_t used, int w, int h) {
  static char text[4096];
  sv_str s = sv_str_make(text, sizeof text);
  sv_app_memory_map(&s, &p.dry, true);
  say(1,
      "{\"board\": \"%s\", \"gaussians\": %ld, \"sh_degree\": %ld, \"images\": %ld, \"width\": %d, "
      "\"height\": %d, \"threads\": %ld, "
      "\"arena_bytes\": %zu, \"used_bytes\": %zu, \"fits\": %s, \"max_gaussians\": %ld, \"max_images\": "
      "%ld, ",
      BOARD_NAME, o->gaussians, o->sh, o->images, w, h, o->threads, cap, used, used <= cap ? "true" : "false",
      largest(o, cap, (int)o->sh, false, 4000000), largest(o, cap, 0, true, 100000));
  bytes_of(o, o->gaussians, (int)o->sh, o->images); // the searches have used the dry arena
  say(1, "\"parts\": [%s], ", text);
  sv_arrays f = arrays_of(o);
  s = sv_str_make(text, sizeof text);
  sv_arrays_print(&s, &f, true);
  say(1, "\"bytes_per_gaussian\": %.2f, \"bytes_per_pixel\": %.3f, \"arrays\": [%s]}\n", f.per_gaussian,
      f.per_pixel, text);
}

static int make_rig(const plan_options *o, int w, int h) {
  sv_device_params d = sv_device_defaults(SV_DEVICE_MULTIPLEXED);
  sv_err err;
  int n = o->odometry > 0 ? (int)o->odometry : 1;
  for (int i = 0; i < n; i++) {
    p.caps[i] = (sv_camera_caps){.width_px = w, .height_px = h};
    p.sub[i] = (sv_sub_view){
        .name = "plan",
        .i_camera = i,
        .model = {.kind = SV_MODEL_PINHOLE, .width_px = w, .height_px = h, .p = {w, w, 0.5 * w, 0.5 * h}},
        .cam_from_rig = sv_pose_identity()};
    p.sub[i].cam_from_rig.t[0] = -i;
  }
  p.rig = (sv_rig){.name = "plan", .n_sub_views = n, .cap_sub_views = SV_CAP_SUB_VIEWS, .sub_views = p.sub};
  if (o->grid && o->odometry)
    return usage_error("plan",
                       "--odometry: not with --multiplexed, whose lens images overlap and cannot be tracked");
  if (!o->grid) return 0;
  if (!size_of(o->grid, &d.rows, &d.cols))
    return usage_error("plan", "--multiplexed %s: expected RxC, lenses in rows and columns", o->grid);
  d.width_px = w;
  d.height_px = h;
  d.focal_per_width = 1;
  d.distance_m = 1;
  if (sv_device_build(&p.rig, &d, &err) < 0)
    return usage_error("plan", "--multiplexed %s: %s", o->grid, err.text);
  return 0;
}

// Cameras whose larger frames are averaged to the images that are trained on.
static int make_frames(const plan_options *o, int w, int h) {
  const sv_reduction to = {.width_px = w, .height_px = h};
  sv_image_map map;
  sv_err err;
  int frame_w, frame_h;
  if (!o->frames) return 0;
  if (!size_of(o->frames, &frame_w, &frame_h))
    return usage_error("plan", "--frames %s: expected WxH with sides of 1 to 16384", o->frames);
  if (o->grid) return usage_error("plan", "--frames: not with --multiplexed, which is trained at its size");
  for (int i = 0; i < p.rig.n_sub_views; i++) {
    sv_camera_model *m = &p.sub[i].model;
    p.caps[i] = (sv_camera_caps){.width_px = frame_w, .height_px = frame_h, .format = SV_PIX_YUYV};
    *m = (sv_camera_model){.kind = SV_MODEL_OPENCV5,
                           .width_px = frame_w,
                           .height_px = frame_h,
                           .p = {frame_w, frame_w, 0.5 * frame_w, 0.5 * frame_h, -0.01}};
    if (sv_sub_view_reduce(&p.sub[i], &to, &map, &err) < 0)
      return usage_error("plan",
                         "--frames %s: cannot be averaged to --size %s: expected the same shape, not smaller",
                         o->frames, o->size);
  }
  return 0;
}

#define AT(field) offsetof(plan_options, field)

static const sv_option rows[] = {
    {"gaussians", SV_OPT_INT, 1, 0, AT(gaussians), "N",
     "number of Gaussians [" SV_TEXT_OF(BOARD_GAUSSIANS) "]", 1, 4000000, NULL},
    {"sh", SV_OPT_INT, 1, 0, AT(sh), "D",
     "degree of the color's spherical harmonics [" SV_TEXT_OF(BOARD_SH_DEGREE) "]", 0, 3, NULL},
    {"images", SV_OPT_INT, 1, 0, AT(images), "N",
     "captured images that are trained on: exposures x sub-views [" SV_TEXT_OF(BOARD_EXPOSURES) " x 2]", 1,
     100000, NULL},
    {"size", SV_OPT_TEXT, 1, 0, AT(size), "WxH", "their size in pixels [640x480]", 0, 0, NULL},
    {"frames", SV_OPT_TEXT, 1, 0, AT(frames), "WxH",
     "size of the cameras' frames, where images are smaller (run --scale, --size) [--size]", 0, 0, NULL},
    {"depth", SV_OPT_WORD, 1, 0, AT(depth), "8|16",
     "bits a value that are kept of pictures (run --depth) [8]", 0, 0, NULL},
    {"multiplexed", SV_OPT_TEXT, 1, 0, AT(grid), "RxC",
     "a multiplexed sensor of that size with R x C lenses, at most two overlapping; images are exposures "
     "then",
     0, 0, NULL},
    {"odometry", SV_OPT_INT, 1, 0, AT(odometry), "N",
     "with odometry for a rig of N sub-views, for sources without poses", 0, CAP_TRACKED, NULL},
    {"rolling", SV_OPT_FLAG, 1, 0, AT(is_rolling), NULL,
     "with cameras of rolling shutters, whose readout times the rig holds", 0, 0, NULL},
    {"prior", SV_OPT_TEXT, 1, 0, AT(prior), "METHOD", "with a sparse-view prior: fsgs or sparsegs", 0, 0,
     NULL},
    {"threads", SV_OPT_INT, 1, 0, AT(threads), "N",
     "threads; each has its own scratch [" SV_TEXT_OF(BOARD_THREADS) "]", 1, BOARD_CAP_THREADS, NULL},
    {"arena", SV_OPT_INT, 1, 0, AT(arena_mib), "MIB", "size of the memory block [the board's]", 1, 65536,
     NULL},
    {"mesh", SV_OPT_FLAG, 1, 0, AT(is_mesh), NULL, "with the memory of run --mesh", 0, 0, NULL},
    {"history", SV_OPT_REAL, 1, 0, AT(history_s), "SEC",
     "a live run of a moving scene ('subview run --scene dynamic --live') that keeps so many seconds of the "
     "past, ten exposures each [another run]",
     0, 3600, NULL},
    {"json", SV_OPT_FLAG, 1, 0, AT(is_json), NULL, "print one JSON object", 0, 0, NULL},
    OPTIONS_COMMON(plan_options)};

static const sv_tool_command command = {
    .name = "plan",
    .args = "[options]",
    .text = "Prints the memory map of a run in the board's memory block; exit 1 if it does not fit.",
    .example = "  "
               "subview plan --gaussians 50000 --sh 3 --images 64 --size 640x480",
    .bit = 1};

int cmd_plan(int argc, char **argv) {
  plan_options o = {.gaussians = BOARD_GAUSSIANS,
                    .sh = BOARD_SH_DEGREE,
                    .history_s = -1,
                    .images = 2 * BOARD_EXPOSURES,
                    .threads = BOARD_THREADS,
                    .arena_mib = (long)(BOARD_ARENA_BYTES >> 20),
                    .prior = "none",
                    .size = "640x480"};
  int w, h, r = options_parse(&command, rows, sizeof rows / sizeof *rows, argc, argv, &o);
  if (r) return r < 0 ? 0 : r;
  if (!size_of(o.size, &w, &h))
    return usage_error("plan", "--size %s: expected WxH with sides of 1 to 16384", o.size);
  if (sv_prior_method_by_name(o.prior) < 0 || (sv_prior_method_by_name(o.prior) > 0 && o.grid))
    return usage_error(
        "plan", "--prior %s: expected none, fsgs or sparsegs, the last two not with --multiplexed", o.prior);
  if (o.history_s >= 0 && (o.grid || is_deep(&o) || o.odometry > 0 || o.is_mesh ||
                           sv_prior_method_by_name(o.prior) > 0 || o.is_rolling))
    return usage_error(
        "plan", "--history: not with --multiplexed, --depth 16, --odometry, --mesh, --prior or --rolling");
  if ((r = make_rig(&o, w, h)) != 0 || (r = make_frames(&o, w, h)) != 0) return r;
  if (is_deep(&o) && (o.grid || o.frames || sv_prior_method_by_name(o.prior) > 0))
    return usage_error("plan", "--depth 16: not with --multiplexed, --frames or --prior");
  for (int i = 0; is_deep(&o) && i < (int)(sizeof p.caps / sizeof *p.caps); i++)
    p.caps[i].format = SV_PIX_RGB16;
  for (int i = 0; o.is_rolling && i < p.rig.n_sub_views; i++) p.sub[i].shutter.readout_s = 0.02;
  size_t cap = (size_t)o.arena_mib << 20, used = bytes_of(&o, o.gaussians, (int)o.sh, o.images);
  if (!used) {
    say(2, "subview: these settings are out of range (see the limits in --help)\n");
    return 1;
  }
  if (o.is_json) print_json(&o, cap, used, w, h);
  else print_text(&o, cap, used, w, h);
  if (used <= cap) return 0;
  say(2, "subview: this run needs %zu MiB and the block has %zu MiB: reduce --gaussians or --images\n",
      (used + 1048575) >> 20, cap >> 20);
  return 1;
}
