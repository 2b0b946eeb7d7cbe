// SPDX-License-Identifier: Apache-2.0
// subview run: the main job.
#include <string.h>

#include "boards/board_main.h"
#include "platform/codec/codec.h"
#include "src/base/mathx.h"

#define SPIN_US   200 // a training step calls the pool every 100 us or so: sleeping in between costs more
#define N_HELDOUT 8   // views of the simulator that are compared at the end

typedef struct {
  const char *source, *rig, *scene, *out, *sub_views, *sync;
  long exposures, steps, gaussians, sh, threads, seed, skew_ms;
  double time_limit, save_every;
  bool is_resume, is_live, is_json, is_quiet;
} run_options;

// Everything that lives as long as the run; static, so that nothing large is on the stack.
static struct {
  board_source src;
  sv_app app;
  sv_kernels k;
  sv_linux_pool pool;
  sv_linux_background background;
  sv_linux_store store;
  sv_linux_console console;
  sv_codec codec;
  uint8_t *jpeg, *truth;
  size_t cap_jpeg;
  sv_err preview_err;
} run;

// Publishes a picture as NAME.jpg in the run's folder.
static void publish_image(void *self, const char *name, int w, int h, const uint8_t *rgb) {
  (void)self;
  sv_picture pic = {.width_px = w,
                    .height_px = h,
                    .stride_bytes = (size_t)w * 3,
                    .format = SV_PIX_RGB8,
                    .data = (uint8_t *)(uintptr_t)rgb};
  char file[64];
  size_t bytes;
  sv_store st = sv_linux_store_port(&run.store);
  sv_err *err = &run.preview_err;
  if (sv_codec_encode_jpeg(&run.codec, &pic, 92, true, run.jpeg, run.cap_jpeg, &bytes, err) < 0) return;
  sv_fmt(file, sizeof file, "%s.jpg", name);
  if (st.begin(st.self, file, err) < 0) return;
  if (st.write(st.self, run.jpeg, bytes, err) < 0) st.abandon(st.self);
  else if (st.commit(st.self, err) < 0) return;
}

static int sync_mode(const char *name) {
  static const char *const names[] = {"free", "frame-length", "trigger"}; // in the order of sv_intake_mode
  for (int i = 0; i < 3; i++)
    if (!strcmp(name, names[i])) return i;
  return -1;
}

static int parse(int argc, char **argv, run_options *o) {
  *o = (run_options){.exposures = BOARD_EXPOSURES,
                     .gaussians = BOARD_GAUSSIANS,
                     .sh = BOARD_SH_DEGREE,
                     .skew_ms = 20,
                     .threads = BOARD_THREADS,
                     .seed = 1,
                     .save_every = 30,
                     .scene = "static",
                     .sync = "free"};
  const opt list[] = {
      {"--source", OPT_TEXT, &o->source, 0, 0, "S",
       SOURCE_KINDS ", with options (see 'subview cameras --help')"},
      {"--rig", OPT_TEXT, &o->rig, 0, 0, "DIR", "folder with rig.json, when the source brings none"},
      {"--scene", OPT_TEXT, &o->scene, 0, 0, "KIND", "static"},
      {"--exposures", OPT_INT, &o->exposures, 1, 10000, "N", "exposures to capture and train on"},
      {"--sub-views", OPT_TEXT, &o->sub_views, 0, 0, "A,B",
       "train on these sub-views only (names); the others are captured"},
      {"--steps", OPT_INT, &o->steps, 1, 10000000, "N",
       "training steps (default 2000, unless a time limit is given)"},
      {"--time-limit", OPT_REAL, &o->time_limit, 0.001, 1e6, "SEC", "end training after so many seconds"},
      {"--gaussians", OPT_INT, &o->gaussians, 0, 4000000, "N", "Gaussians, a fixed number"},
      {"--sh", OPT_INT, &o->sh, 0, 3, "D", "degree of the colour's spherical harmonics"},
      {"--skew-limit", OPT_INT, &o->skew_ms, 1, 10000, "MS", "largest skew within an exposure (20 ms)"},
      {"--sync", OPT_TEXT, &o->sync, 0, 0, "HOW",
       "what makes the cameras expose together: free (nothing), frame-length (software), trigger (a line)"},
      {"--live", OPT_FLAG, &o->is_live, 0, 0, NULL,
       "go on capturing while training: new exposures take the place of the oldest"},
      {"--threads", OPT_INT, &o->threads, 1, BOARD_CAP_THREADS, "N",
       "threads; the result is the same for any number"},
      {"--seed", OPT_INT, &o->seed, 0, 1e15, "N", "seed of everything random"},
      {"--save-every", OPT_REAL, &o->save_every, 0, 1e6, "SEC",
       "checkpoint and preview while training (30; 0: at the end)"},
      {"--resume", OPT_FLAG, &o->is_resume, 0, 0, NULL, "go on from checkpoint.bin in the output folder"},
      {"--out", OPT_TEXT, &o->out, 0, 0, "DIR", "where model.ply, run.json, preview.jpg, checkpoint.bin go"},
      {"--json", OPT_FLAG, &o->is_json, 0, 0, NULL, "print the figures as one JSON object on stdout"},
      {"--quiet", OPT_FLAG, &o->is_quiet, 0, 0, NULL, "no progress"},
  };
  int r = options_parse(
      "run",
      "Captures exposures (all sub-views of one instant), trains Gaussians on all of them, and saves the "
      "model.",
      "subview run --source sim:textured,rig=stereo --exposures 8 --out out/demo", list,
      sizeof list / sizeof *list, argc, argv);
  if (r) return r;
  if (!o->source) return usage_error("run", "--source is missing");
  if (!o->out) return usage_error("run", "--out is missing");
  if (o->gaussians < 1) return usage_error("run", "--gaussians 0: expected at least 1");
  if (!strcmp(o->scene, "dynamic"))
    return usage_error("run", "--scene dynamic: moving scenes are not supported yet");
  if (strcmp(o->scene, "static")) return usage_error("run", "--scene %s: expected static", o->scene);
  if (sync_mode(o->sync) < 0)
    return usage_error("run", "--sync %s: expected free, frame-length or trigger", o->sync);
  if (!o->steps && !(o->time_limit > 0)) o->steps = 2000;
  return 0;
}

// "left,right" -> bits of the rig's sub-views.
static bool choose_sub_views(const char *list, const sv_rig *rig, uint64_t *mask) {
  while (*list) {
    size_t n = strcspn(list, ",");
    bool is_found = false;
    for (int i = 0; i < rig->n_sub_views; i++)
      if (strlen(rig->sub_views[i].name) == n && !strncmp(rig->sub_views[i].name, list, n)) {
        mask[i / 64] |= 1ull << (i % 64);
        is_found = true;
      }
    if (!is_found) {
      say(2, "subview run: --sub-views %.*s: the rig's sub-views are", (int)n, list);
      for (int i = 0; i < rig->n_sub_views; i++) say(2, " %s", rig->sub_views[i].name);
      say(2, "\n");
      return false;
    }
    list += n + (list[n] == ',');
  }
  return true;
}

// Sources either know all their rig's poses or none.
static bool tells_poses(const sv_source *src) {
  sv_pose pose;
  return src->rig_pose && src->rig_pose(src->self, 0, &pose) >= 0;
}

static sv_app_cfg app_cfg(const run_options *o) {
  sv_app_cfg c = {.rig = run.src.rig,
                  .n_cameras = run.src.source.n_cameras,
                  .caps = run.src.caps,
                  .source_name = o->source,
                  .n_exposures = (int)o->exposures,
                  .skew_limit_ns = o->skew_ms * SV_NS_PER_MS,
                  .sync_mode = (sv_intake_mode)sync_mode(o->sync),
                  .is_live = o->is_live,
                  .preview_every_s = 2,
                  .capture_timeout_ns = 10 * SV_NS_PER_S,
                  .train = sv_train_defaults(),
                  .steps = (uint32_t)o->steps,
                  .time_limit_s = o->time_limit,
                  .is_tracking = !o->is_live && !tells_poses(&run.src.source),
                  .has_bounds = run.src.has_bounds,
                  .bounds = run.src.bounds,
                  .is_resume = o->is_resume,
                  .save_every_s = o->save_every};
  c.train.n_gaussians = (int)o->gaussians;
  c.train.sh_degree = (int)o->sh;
  c.train.seed = (uint64_t)o->seed;
  return c;
}

// Buffers of the preview and of the comparison with the simulator's truth.
static sv_status carve_outputs(sv_arena *a, const sv_app_cfg *cfg, sv_err *err) {
  int w = 1, h = 1;
  sv_app_preview_size(cfg, &w, &h);
  sv_arena_part_begin(a, "preview");
  sv_codec_cfg cc = {.max_width_px = w, .max_height_px = h};
  sv_status s = sv_codec_init(&run.codec, &cc, a);
  if (s < 0) return sv_fail(err, s, "no room for a preview of %dx%d pixels", w, h);
  run.cap_jpeg = (size_t)w * (size_t)h * 3 + 4096;
  run.jpeg = SV_TAKE(a, uint8_t, run.cap_jpeg);
  const sv_camera_model *m = &run.src.rig->sub_views[0].model; // that of the held-out views
  if (run.src.kind == SOURCE_SIM)
    run.truth = SV_TAKE(a, uint8_t, (size_t)m->width_px * (size_t)m->height_px * 3);
  return a->status < 0 ? sv_fail(err, a->status, "no room for the preview") : SV_OK;
}

static void true_pose(void *self, sv_ns time_ns, sv_pose *rig_from_world) {
  sv_sim_rig_pose(self, time_ns, rig_from_world);
}

// Mean PSNR over held-out views of the simulated scene; 0 where there is no truth.
static sv_status heldout_psnr(double *psnr, int *n_views) {
  *psnr = 0;
  *n_views = 0;
  sv_odometry *odo = &run.app.odometry;
  sv_similarity q = {.s = 1};
  if (run.src.kind != SOURCE_SIM) return SV_OK;
  if (odo->is_tracked) q = sv_odometry_from(odo, &run.app.exposures, true_pose, &run.src.u.sim);
  for (int i = 0; i < N_HELDOUT; i++) {
    sv_view v;
    double t, mse;
    sv_sim_heldout_view(&run.src.u.sim, i, N_HELDOUT, &v, &t);
    sv_sim_render(&run.src.u.sim, &v, t, run.truth, NULL);
    if (odo->is_tracked) v = sv_odometry_view(&q, &v); // where that is in the world that was found
    sv_status s = sv_app_mse(&run.app, &v, run.truth, &mse);
    if (s < 0) return s;
    *psnr += -10.0 / 2.302585092994046 * sv_log(mse > 1e-12 ? mse : 1e-12) / N_HELDOUT;
    (*n_views)++;
  }
  return SV_OK;
}

static int report(const run_options *o, sv_err *err) {
  double train_psnr, psnr;
  int n;
  char extra[160];
  if (sv_app_training_psnr(&run.app, &train_psnr) < 0 || heldout_psnr(&psnr, &n) < 0) {
    sv_fail(err, SV_E_RANGE, "the model could not be rendered for its evaluation");
    return fail_with(err);
  }
  if (n)
    sv_fmt(extra, sizeof extra, "\"train_psnr\": %.3f, \"psnr\": %.3f, \"heldout_views\": %d", train_psnr,
           psnr, n);
  else sv_fmt(extra, sizeof extra, "\"train_psnr\": %.3f", train_psnr);
  if (sv_app_save_report(&run.app, extra, err) < 0) return fail_with(err);
  if (o->is_json) {
    say(1,
        "{%s, \"steps\": %u, \"gaussians\": %ld, \"exposures\": %d, \"views\": %d, \"seconds\": %.3f, "
        "\"threads\": %ld, \"isa\": "
        "\"%s\", \"arena_bytes\": %zu, \"digest\": \"%08x%08x\"}\n",
        extra, run.app.trainer.step, o->gaussians, run.app.exposures.n, run.app.n_views, run.app.train_s,
        o->threads, sv_isa_name(run.k.isa), run.app.arena->cap_bytes,
        (unsigned)(sv_train_digest(&run.app.trainer) >> 32), (unsigned)sv_train_digest(&run.app.trainer));
    return 0;
  }
  if (n) say(1, "held-out PSNR %.2f dB (%d views), training views %.2f dB\n", psnr, n, train_psnr);
  else say(1, "training views %.2f dB\n", train_psnr);
  say(1,
      "%d exposures, %d views, %u steps in %.1f s\nsaved: %s/model.ply %s/run.json %s/preview.jpg "
      "%s/checkpoint.bin\n",
      run.app.exposures.n, run.app.n_views, run.app.trainer.step, run.app.train_s, o->out, o->out, o->out,
      o->out);
  return 0;
}

static int run_all(const run_options *o) {
  sv_err err = {0};
  sv_arena arena = board_arena();
  if (source_open(&run.src, o->source, o->rig, (int)o->exposures, true, &arena, &err) < 0)
    return fail_with(&err);
  if (run.src.note[0] && !o->is_quiet) say(2, "subview: %s\n", run.src.note);
  sv_app_cfg cfg = app_cfg(o);
  if (carve_outputs(&arena, &cfg, &err) < 0) return fail_with(&err);
  if (o->sub_views && !choose_sub_views(o->sub_views, run.src.rig, cfg.sub_view_mask)) return EXIT_USAGE;
  sv_linux_console_init(&run.console, 2, o->is_quiet);
  if (sv_linux_catch_signals(&err) < 0) return fail_with(&err);
  if (sv_linux_pool_start(&run.pool, (int)o->threads, SPIN_US, &err) < 0) return fail_with(&err);
  if (sv_linux_store_open(&run.store, o->out, &err) < 0) return fail_with(&err);
  sv_port port = {.clock = run.src.clock,
                  .machine = sv_linux_clock(),
                  .pool = sv_linux_pool_port(&run.pool),
                  .source = run.src.source,
                  .store = sv_linux_store_port(&run.store),
                  .console = sv_linux_console_port(&run.console),
                  .publish = {NULL, publish_image},
                  .decoder = run.src.decoder};
  // Cameras on real time get a thread; the simulator's and a recording's time waits for nobody.
  if (!run.src.is_virtual) port.worker = sv_linux_worker_port(&run.background);
  int code = 0;
  if (sv_app_init(&run.app, &cfg, &run.k, &port, &arena, &err) < 0) code = fail_with(&err);
  if (!code) {
    sv_status s = sv_app_run(&run.app, &err);
    sv_linux_console_finish(&run.console);
    if (s == SV_E_INTERRUPTED && run.app.trainer.step) {
      say(2, "subview: %s\n", err.text);
      s = SV_OK;
    }
    code = s < 0 ? fail_with(&err) : report(o, &err);
    if (!code && run.preview_err.status < 0) code = fail_with(&run.preview_err);
  }
  sv_linux_store_close(&run.store);
  sv_linux_pool_stop(&run.pool);
  return code;
}

int cmd_run(int argc, char **argv) {
  run_options o;
  int r = parse(argc, argv, &o);
  if (r) return r < 0 ? 0 : r;
  uint32_t mask;
  if (!board_kernels(&run.k, &mask)) return EXIT_USAGE;
  int code = run_all(&o);
  source_close(&run.src);
  sv_codec_close(&run.codec);
  return code;
}
