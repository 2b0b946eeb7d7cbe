// SPDX-License-Identifier: Apache-2.0
// subview plan: the memory map of a run on this board, and what else would fit.
#include "boards/board_main.h"
#include "src/run/arrays.h"
#include "src/prior/methods.h"

#define CAP_TRACKED 16 // cameras of a plan with odometry

typedef struct {
  long gaussians, sh, images, threads, arena_mib;
  long odometry; // sub-views of a rig whose poses are not known; 0: they are
  const char *size, *grid, *prior;
  bool is_json;
} plan_options;

static struct {
  sv_app app;
  sv_arena dry;
  sv_sub_view sub[SV_CAP_SUB_VIEWS];
  sv_rig rig;
  sv_camera_caps caps[CAP_TRACKED];
} p;

// Bytes of a run with so many Gaussians and pictures; 0 when the settings are refused.
static size_t bytes_of(const plan_options *o, long gaussians, int sh, long images) {
  int n = o->odometry > 0 ? (int)o->odometry : 1;
  sv_app_cfg c = {.rig = &p.rig,
                  .n_cameras = n,
                  .caps = p.caps,
                  .source_name = "plan",
                  .n_exposures = (int)((images + n - 1) / n),
                  .is_tracking = o->odometry > 0,
                  .skew_limit_ns = 20 * SV_NS_PER_MS,
                  .prior = (sv_prior_method)sv_prior_method_by_name(o->prior),
                  .train = sv_train_defaults(),
                  .steps = 1};
  c.train.n_gaussians = (int)gaussians;
  c.train.sh_degree = sh;
  p.dry = sv_arena_dry();
  return sv_app_plan(&p.app, &c, (int)o->threads, &p.dry, NULL) < 0 ? 0 : p.dry.used_bytes;
}

static sv_arrays arrays_of(const plan_options *o) {
  sv_train_cfg c = sv_train_defaults();
  c.sh_degree = (int)o->sh;
  if (o->grid) c.cap_composites = c.cap_regions = 1;
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

static bool parse_size(const char *text, int *w, int *h) {
  const char *x = text;
  long long a, b;
  size_t n = 0;
  while (x[n] && x[n] != 'x') n++;
  if (!x[n] || !sv_parse_int(x, n, &a)) return false;
  size_t m = 0;
  while (x[n + 1 + m]) m++;
  if (!sv_parse_int(x + n + 1, m, &b) || a < 1 || b < 1 || a > 16384 || b > 16384) return false;
  *w = (int)a, *h = (int)b;
  return true;
}

static void print_text(const plan_options *o, size_t cap, size_t used, int w, int h) {
  static char text[4096];
  sv_str s = sv_str_make(text, sizeof text);
  sv_app_memory_map(&s, &p.dry, false);
  say(1, "board %s: %ld Gaussians of SH degree %ld, %ld pictures of %dx%d, %ld threads\n\n%s", BOARD_NAME,
      o->gaussians, o->sh, o->images, w, h, o->threads, text);
  say(1, "%-22s %12zu\n%-22s %12zu  %s\n\n", "sum", used, "block", cap,
      used <= cap ? "it fits" : "IT DOES NOT FIT");
  say(1, "in this block, with %ld pictures: at most %ld Gaussians at SH 0, %ld at SH 1, %ld at SH 3\n",
      o->images, largest(o, cap, 0, false, 4000000), largest(o, cap, 1, false, 4000000),
      largest(o, cap, 3, false, 4000000));
  say(1, "in this block, with %ld Gaussians at SH %ld: at most %ld pictures\n\n", o->gaussians, o->sh,
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
                       "--odometry: the rig of a multiplexed sensor is not tracked, its lens images overlap");
  if (!o->grid) return 0;
  if (!parse_size(o->grid, &d.rows, &d.cols))
    return usage_error("plan", "--multiplexed %s: expected RxC, lenses in rows and columns", o->grid);
  d.width_px = w, d.height_px = h, d.focal_per_width = 1, d.distance_m = 1;
  if (sv_device_build(&p.rig, &d, &err) < 0)
    return usage_error("plan", "--multiplexed %s: %s", o->grid, err.text);
  return 0;
}

int cmd_plan(int argc, char **argv) {
  plan_options o = {.gaussians = BOARD_GAUSSIANS,
                    .sh = BOARD_SH_DEGREE,
                    .images = 2 * BOARD_EXPOSURES,
                    .threads = BOARD_THREADS,
                    .arena_mib = (long)(BOARD_ARENA_BYTES >> 20),
                    .prior = "none",
                    .size = "640x480"};
  const opt list[] = {
      {"--gaussians", OPT_INT, &o.gaussians, 1, 4000000, "N", "Gaussians (" TEXT_OF(BOARD_GAUSSIANS) ")"},
      {"--sh", OPT_INT, &o.sh, 0, 3, "D", "spherical harmonics degree (" TEXT_OF(BOARD_SH_DEGREE) ")"},
      {"--images", OPT_INT, &o.images, 1, 100000, "N",
       "pictures kept for training, exposures x sub-views (" TEXT_OF(BOARD_EXPOSURES) " x 2)"},
      {"--size", OPT_TEXT, &o.size, 0, 0, "WxH", "their size in pixels (640x480)"},
      {"--multiplexed", OPT_TEXT, &o.grid, 0, 0, "RxC",
       "so many lenses that overlap twice on a sensor of that size; images are exposures then"},
      {"--odometry", OPT_INT, &o.odometry, 0, CAP_TRACKED, "N",
       "find the poses of a rig of N sub-views before training (the source does not tell them)"},
      {"--prior", OPT_TEXT, &o.prior, 0, 0, "METHOD", "with a sparse-view prior: fsgs or sparsegs"},
      {"--threads", OPT_INT, &o.threads, 1, BOARD_CAP_THREADS, "N",
       "threads, each has scratch of its own (" TEXT_OF(BOARD_THREADS) ")"},
      {"--arena", OPT_INT, &o.arena_mib, 1, 65536, "MIB", "size of the block (default: the board's)"},
      {"--json", OPT_FLAG, &o.is_json, 0, 0, NULL, "print one JSON object"},
  };
  int w, h,
      r = options_parse(
          "plan", "Prints what a run takes of the board's one block of memory; exit 1 if it does not fit.",
          "subview plan --gaussians 50000 --sh 3 --images 64 --size 640x480", list,
          sizeof list / sizeof *list, argc, argv);
  if (r) return r < 0 ? 0 : r;
  if (!parse_size(o.size, &w, &h))
    return usage_error("plan", "--size %s: expected WxH with sides of 1 to 16384", o.size);
  if (sv_prior_method_by_name(o.prior) < 0 || (sv_prior_method_by_name(o.prior) > 0 && o.grid))
    return usage_error(
        "plan", "--prior %s: expected none, fsgs or sparsegs, the latter not with --multiplexed", o.prior);
  if ((r = make_rig(&o, w, h)) != 0) return r;
  size_t cap = (size_t)o.arena_mib << 20, used = bytes_of(&o, o.gaussians, (int)o.sh, o.images);
  if (!used) {
    say(2, "subview: these settings make no run (see the limits in --help)\n");
    return 1;
  }
  if (o.is_json) print_json(&o, cap, used, w, h);
  else print_text(&o, cap, used, w, h);
  if (used <= cap) return 0;
  say(2, "subview: this run needs %zu MiB and the block has %zu MiB: take fewer Gaussians or pictures\n",
      (used + 1048575) >> 20, cap >> 20);
  return 1;
}
