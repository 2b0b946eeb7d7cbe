// SPDX-License-Identifier: Apache-2.0
// subview run: the main job.
#include <math.h>
#include <string.h>
#include <unistd.h>

#include "boards/board_main.h"
#include "boards/calibrate.h"
#include "boards/guide.h"
#include "boards/mesh_out.h"
#include "boards/outputs.h"
#include "boards/preview.h"
#include "boards/run_options.h"
#include "boards/scans.h"
#include "platform/codec/codec.h"
#include "platform/linux/watch.h"
#include "src/base/mathx.h"
#include "src/metric/metric.h"

// A training step calls the pool every 100 us or so: sleeping in between costs more
#define SPIN_US 200

// Everything that lives as long as the run; static, so that nothing large is on the stack.
static struct {
  board_source src;
  sv_app app;
  sv_kernels k;
  sv_linux_pool pool;
  sv_linux_background background;
  sv_linux_console console;
  sv_linux_watch watch;
  outputs out;
  sv_imu imu;           // of --imu
  mesh_out mesh;        // of --mesh
  uint8_t *truth;       // a held-out view of the simulator
  uint8_t *small_truth; // at the size that is trained on; may be the same
  float *area_scratch;
  // with --depth 16: both as light, [3][height][width], and what that is made smaller with
  uint16_t *light, *small_light;
  uint32_t *sums;
  bool is_calibrating; // asked for on the page: before the next run
  bool is_retry;       // the cameras of the same scan are tried again
  sv_err told;         // why they failed last time
} run;

// self is the page's.
static void publish_image(void *self, const char *name, int w, int h, const uint8_t *rgb) {
  (void)self;
  outputs_publish(&run.out, name, w, h, rgb);
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

// Which exposures are kept: as --every says, else as suits the source.
static sv_spacing_cfg spacing_of(const run_options *o) {
  sv_spacing_cfg c = {.every_ns = (sv_ns)(o->every_s * 1e9), .is_by_motion = o->is_by_motion};
  double fps = 0;
  for (int i = 0; i < run.src.source.n_cameras; i++) {
    fps = fmax(fps, run.src.caps[i].fps);
    c.n_brackets = sv_maxi(c.n_brackets, run.src.caps[i].n_brackets);
  }
  if (fps > 0) c.early_ns = (sv_ns)(0.5e9 / fps);
  if (o->every || o->is_continuous) return c;
  if (run.src.kind == SOURCE_REPLAY) {
    // Up to two frames before the end, in case the last ones are not whole.
    if (o->exposures > 1 && sv_replay_most_exposures(&run.src.u.replay) > o->exposures)
      c.every_ns = (sv_replay_span_ns(&run.src.u.replay) - 4 * c.early_ns) /
                   sv_maxi((int)o->exposures / sv_maxi(c.n_brackets, 1) - 1, 1);
  } else if (run.src.kind != SOURCE_SIM && !o->is_dynamic) c.is_by_motion = true;
  return c;
}

static sv_app_cfg app_cfg(const run_options *o) {
  sv_app_cfg c = {.rig = run.src.rig,
                  .n_cameras = run.src.source.n_cameras,
                  .caps = run.src.caps,
                  .source_name = o->source,
                  .n_exposures = (int)o->exposures,
                  .skew_limit_ns = o->skew_ms * SV_NS_PER_MS,
                  .spacing = spacing_of(o),
                  .guidance = guide_cfg(&run.src, o->arc_deg),
                  .hold_out = (float)o->hold_out,
                  .least_db_per_s = o->least_db_per_s,
                  .is_held_released = o->is_held_released,
                  .sync_method = (sv_sync_method)o->i_sync,
                  .is_continuous = o->is_continuous,
                  .is_dynamic = o->is_dynamic,
                  .exposure_s = o->exposure_s,
                  .history_s = o->is_dynamic && o->is_continuous ? o->history_s : 0,
                  .preview_every_s = 2,
                  .capture_timeout_ns = 10 * SV_NS_PER_S,
                  .train = sv_train_defaults(),
                  .dynamic = sv_dynamic_defaults(),
                  .steps = (uint32_t)o->steps,
                  .time_limit_s = o->time_limit,
                  .is_tracking = !o->is_continuous && !source_tells_poses(&run.src),
                  .imu = o->imu ? &run.imu : NULL,
                  .is_blur_kept = o->is_blur_kept,
                  .prior = (sv_prior_method)o->i_prior,
                  .optimizer = o->i_optimizer + 1,
                  .appearance = o->appearance_mode,
                  .is_deep = o->depth && !strcmp(o->depth, "16"),
                  .is_shutter_ignored = !strcmp(o->shutter, "global"),
                  .is_refining = o->is_refining,
                  .has_bounds = run.src.has_bounds,
                  .bounds = run.src.bounds,
                  .is_resume = o->is_resume,
                  .save_every_s = o->save_every,
                  .picture_every_s = o->picture_every,
                  .board_name = BOARD_NAME,
                  .has_preview = o->preview || o->has_feed || o->display,
                  .has_screen = o->display != NULL,
                  .is_session = o->is_session,
                  .starts_at_once = o->is_interrupted};
  // Its pixels show several sub-views, so none can be held out: the steps end the run.
  if (o->quality && c.rig->forward == SV_FORWARD_MULTIPLEXED) c.hold_out = 0;
  if (!(c.hold_out > 0)) {
    c.least_db_per_s = 0;
    c.is_held_released = false;
  }
  c.train.n_gaussians = (int)o->gaussians;
  c.train.sh_degree = (int)o->sh;
  c.train.seed = (uint64_t)o->seed;
  return c;
}

static void carve_truth(sv_arena *a, bool is_deep) {
  const sv_sub_view *v = &run.src.rig->sub_views[0]; // that of the held-out views
  const sv_camera_caps *c = &run.src.caps[v->i_camera];
  const size_t px = (size_t)v->model.width_px * (size_t)v->model.height_px;
  run.truth = run.small_truth =
      SV_TAKE(a, uint8_t, v->source_width_px ? (size_t)c->width_px * (size_t)c->height_px * 3 : 3 * px);
  if (!v->source_width_px) return;
  run.small_truth = SV_TAKE(a, uint8_t, 3 * px);
  run.area_scratch = SV_TAKE(a, float, SV_AREA_SCRATCH_FLOATS(v->source_width_px));
  if (!is_deep) return;
  run.light = SV_TAKE(a, uint16_t, 3 * (size_t)c->width_px * (size_t)c->height_px);
  run.small_light = SV_TAKE(a, uint16_t, 3 * px);
  run.sums = SV_TAKE(a, uint32_t, v->source_width_px);
}

// Buffers of the preview and of the comparison with the simulator's truth.
static sv_status carve_outputs(sv_arena *a, const sv_app_cfg *cfg, sv_err *err) {
  int w = 1, h = 1;
  sv_pictures_size(cfg->rig, cfg->caps, cfg->n_cameras, &w, &h);
  sv_arena_part_begin(a, "preview");
  sv_status s = outputs_carve(&run.out, a, w, h, err);
  if (s < 0) return s;
  if (run.src.kind == SOURCE_SIM) carve_truth(a, cfg->is_deep);
  return a->status < 0 ? sv_fail(err, a->status, "no room for the preview") : SV_OK;
}

static void true_pose(void *self, sv_ns time_ns, sv_pose *rig_from_world) {
  sv_sim_rig_pose(self, time_ns, rig_from_world);
}

// As deep pictures are made smaller: the mean is that of the light.
static void reduce_light(const sv_sub_view *s, int stride_px) {
  const sv_noise *curve = &run.src.u.sim.noise;
  const size_t n_from = (size_t)stride_px * (size_t)s->source_height_px,
               n_to = (size_t)s->model.width_px * (size_t)s->model.height_px;
  for (size_t i = 0; i < 3 * n_from; i++)
    run.light[i % 3 * n_from + i / 3] = (uint16_t)(65535 * curve->linear8[run.truth[i]] + 0.5f);
  sv_deep_reduce(&(sv_deep_reduction){.src = run.light,
                                      .src_plane = n_from,
                                      .src_stride = (size_t)stride_px,
                                      .src_width_px = s->source_width_px,
                                      .src_height_px = s->source_height_px,
                                      .dst = run.small_light,
                                      .dst_width_px = s->model.width_px,
                                      .dst_height_px = s->model.height_px,
                                      .row1 = s->model.height_px,
                                      .scratch = run.sums});
  for (size_t i = 0; i < 3 * n_to; i++)
    run.small_truth[i] =
        curve->srgb8[sv_noise_quantise((float)run.small_light[i % 3 * n_to + i / 3] * (1 / 65535.0f))];
}

// A held-out view and its truth, which are of the simulator's size, made smaller as the images for
// training were.
static void reduce_truth(sv_view *v) {
  const sv_sub_view *s = &run.src.rig->sub_views[0];
  if (!s->source_width_px) return;
  const int w = s->model.width_px, h = s->model.height_px;
  const float x = (float)w / (float)s->source_width_px, y = (float)h / (float)s->source_height_px;
  if (run.app.cfg.is_deep) reduce_light(s, v->width_px);
  else
    run.k.area(&(sv_area_args){.src = run.truth,
                               .src_stride_bytes = 3 * (size_t)v->width_px,
                               .src_width_px = s->source_width_px,
                               .src_height_px = s->source_height_px,
                               .dst = run.small_truth,
                               .dst_stride_bytes = 3 * (size_t)w,
                               .dst_width_px = w,
                               .dst_height_px = h,
                               .row1 = h,
                               .scratch = run.area_scratch});
  v->width_px = w;
  v->height_px = h;
  v->fx *= x;
  v->cx *= x;
  v->fy *= y;
  v->cy *= y;
}

// Mean PSNR over held-out views of the simulated scene; 0 where there is no truth.
static sv_status heldout_psnr(double *psnr, int *n_views) {
  *psnr = 0;
  *n_views = 0;
  sv_odometry *odo = &run.app.odometry;
  sv_similarity q = {.s = 1};
  if (run.src.kind != SOURCE_SIM) return SV_OK;
  // A live model of a moving scene is that of its newest exposure, and of where the rig was then.
  const bool is_live = run.app.cfg.is_dynamic && run.app.cfg.is_continuous;
  const sv_ns newest_ns = run.app.moving.last_ns;
  if (odo->is_tracked) q = sv_odometry_from(odo, &run.app.exposures, true_pose, &run.src.u.sim);
  for (int i = 0; i < SV_SIM_N_HELDOUT; i++) {
    sv_view v;
    double t = sv_ns_to_s(newest_ns - SV_SIM_EPOCH_NS), mse;
    if (is_live) sv_sim_heldout_view_at(&run.src.u.sim, i, newest_ns, &v);
    else sv_sim_heldout_view(&run.src.u.sim, i, SV_SIM_N_HELDOUT, &v, &t);
    v.time = sv_app_time_of(&run.app, is_live ? newest_ns : sv_sim_slot_ns(&run.src.u.sim, v.i_exposure));
    sv_sim_render(&run.src.u.sim, &v, t, run.truth, NULL);
    reduce_truth(&v);
    if (odo->is_tracked) v = sv_odometry_view(&q, &v); // where that is in the world that was found
    // The truth is that of normal light.
    const float light = run.app.exposures.white / sv_sim_light(&run.src.u.sim);
    sv_status s = sv_driver_lit_mse(&run.app.trainer, &v, light, run.small_truth, &mse);
    if (s < 0) return s;
    *psnr += sv_psnr_of_mse(mse) / SV_SIM_N_HELDOUT;
    (*n_views)++;
  }
  return SV_OK;
}

// Training images tell how well they are fitted, not how good the model is.
static void say_quality(double psnr, int n_heldout, double train_psnr, double held_psnr) {
  const sv_app_moving *m = &run.app.moving;
  if (n_heldout) say(1, "held-out PSNR %.2f dB (%d views)\n", psnr, n_heldout);
  if (held_psnr > 0)
    say(1, "held-out pixels %.2f dB%s\n", held_psnr,
        run.app.released_psnr > 0 ? " before the end, which trained on them, too" : "");
  if (n_heldout || held_psnr > 0) return;
  if (m->n_scored)
    say(1, "newest exposures %.2f dB at the end of their turn (mean of the last 50 or so)\n", m->psnr_late);
  else say(1, "no held-out views; the captured images are fitted with %.2f dB\n", train_psnr);
}

static int report(const run_options *o, sv_err *err) {
  double train_psnr, psnr;
  int n;
  char extra[512];
  sv_str x = sv_str_make(extra, sizeof extra);
  const sv_app_moving *m = &run.app.moving;
  if (sv_driver_training_psnr(&run.app.trainer, &train_psnr) < 0 || heldout_psnr(&psnr, &n) < 0) {
    sv_fail(err, SV_E_RANGE, "the model could not be rendered to measure its PSNR");
    return fail_with(err);
  }
  double held_psnr;
  if (sv_app_held_out_psnr(&run.app, run.app.trainer.n_views, &held_psnr) < 0) held_psnr = 0;
  sv_str_add(&x, "\"train_psnr\": %.3f", train_psnr);
  if (held_psnr > 0) sv_str_add(&x, ", \"held_out_psnr\": %.3f", held_psnr);
  if (n) sv_str_add(&x, ", \"psnr\": %.3f, \"heldout_views\": %d", psnr, n);
  if (o->i_capture_cpu >= 0) sv_str_add(&x, ", \"capture_cpu\": %d", o->i_capture_cpu);
  if (run.src.pulses.trigger.kind) sv_str_add(&x, ", ");
  trigger_report(&x, &run.src);
  if (sv_app_save_report(&run.app, extra, err) < 0) return fail_with(err);
  if (o->is_json) {
    if (m->n_scored)
      sv_str_add(&x, ", \"live_psnr\": %.3f, \"live_psnr_late\": %.3f", m->psnr_sum / (double)m->n_scored,
                 m->psnr_late);
    say(1,
        "{%s, \"steps\": %u, \"gaussians\": %ld, \"exposures\": %d, \"views\": %d, \"seconds\": %.3f, "
        "\"threads\": %ld, \"isa\": "
        "\"%s\", \"arena_bytes\": %zu, \"digest\": \"%08x%08x\"}\n",
        extra, run.app.trainer.step, o->gaussians, run.app.exposures.n, sv_driver_n_views(&run.app.trainer),
        run.app.driver.train_s, o->threads, sv_isa_name(run.k.isa), run.app.arena->cap_bytes,
        (unsigned)(sv_train_digest(&run.app.trainer) >> 32), (unsigned)sv_train_digest(&run.app.trainer));
    return 0;
  }
  if (!o->is_quiet) trigger_say(&run.src);
  say_quality(psnr, n, train_psnr, held_psnr);
  say(1, "%d exposures, %d views, %u steps in %.1f s\n", run.app.exposures.n,
      sv_driver_n_views(&run.app.trainer), run.app.trainer.step, run.app.driver.train_s);
  outputs_say(&run.out);
  return 0;
}

// Exit code of a run whose files are in the second place, at least in part.
static int tell_rescue(const run_options *o) {
  say(2,
      "subview: %s did not take all files; the others are in %s; copy them before the machine is switched "
      "off\n",
      o->out, run.out.rescue.dir);
  return EXIT_RESCUED;
}

// A run that goes on capturing uses the others later, in the place of the oldest.
static void say_spread(const run_options *o) {
  if (run.src.kind != SOURCE_REPLAY || o->is_continuous || o->is_quiet) return;
  int n = sv_replay_most_exposures(&run.src.u.replay);
  if (n <= o->exposures) return;
  if (o->every)
    say(2, "subview: the capture has up to %d exposures, --exposures asks for %ld\n", n, o->exposures);
  else
    say(2,
        "subview: the capture has up to %d exposures; using %ld spread over all of it (--every 0: the first "
        "ones)\n",
        n, o->exposures);
}

// Opens source, outputs and app. After a failure err says what happened, and *what names the part
// for the list and the page.
static sv_status set_up(const run_options *o, sv_arena *arena, const char **what, sv_err *err) {
  *what = "cameras";
  const source_cfg sc = {.spec = o->source,
                         .rig_path = o->rig,
                         .n_exposures = (int)o->exposures,
                         .needs_rig = true,
                         .reads_shutters = !strcmp(o->shutter, "rolling"),
                         .reduction = o->reduction,
                         .is_triggered = o->i_sync == SV_SYNC_METHOD_TRIGGER};
  sv_status s = source_open(&run.src, &sc, arena, err);
  if (s < 0 && run.src.source.n_cameras > 0) *what = "rig";
  if (s < 0) return s;
  if (run.src.note[0] && !o->is_quiet) say(2, "subview: %s\n", run.src.note);
  say_spread(o);
  *what = "options";
  if (o->imu && (s = imu_read(&run.imu, o->imu, arena, err)) < 0) return s;
  sv_app_cfg cfg = app_cfg(o);
  *what = "memory";
  if ((s = carve_outputs(arena, &cfg, err)) < 0) return s;
  if (o->is_mesh && (s = mesh_out_carve(&run.mesh, &cfg, arena, err)) < 0) return s;
  *what = "options";
  if (o->sub_views && !choose_sub_views(o->sub_views, run.src.rig, cfg.sub_view_mask)) return SV_E_ARG;
  *what = "folder";
  if (o->out && (s = outputs_open(&run.out, o, &run.app, sv_linux_console_port(&run.console), err)) < 0)
    return s;
  sv_port port = {.clock = run.src.clock,
                  .machine = sv_linux_clock(),
                  .pool = sv_linux_pool_port(&run.pool),
                  .source = run.src.source,
                  .console = sv_linux_console_port(&run.console),
                  .publish = {.image = publish_image},
                  .decoder = run.src.decoder,
                  .thermometer = sv_linux_thermometer(&run.watch),
                  .heartbeats = &run.watch.beats};
  // Cameras on real time get a thread; the simulator's and a recording's time waits for nobody.
  if (!run.src.is_virtual) {
    port.worker = sv_linux_worker_port(&run.background);
    run.background.cpu = o->i_capture_cpu;
  }
  preview_publish(&port.publish);
  port.display = preview_display();
  outputs_port(&run.out, &port);
  *what = "memory";
  return sv_app_init(&run.app, &cfg, &run.k, &port, arena, err);
}

static bool is_first_run(const run_options *o) {
  char path[SV_LINUX_CAP_PATH + 16];
  sv_fmt(path, sizeof path, "%s/run.json", o->out);
  return access(path, F_OK) != 0;
}

static sv_status save_mesh(const run_options *o, sv_err *err) {
  const sv_status s = mesh_out_save(&run.mesh, &run.app, err);
  if (s >= 0 && !o->is_quiet && !o->is_json)
    say(1, "mesh: %s/mesh.ply, %d vertices, %d triangles, voxels of %g\n", o->out, run.mesh.n_vertices,
        run.mesh.n_triangles, run.mesh.voxel);
  return s;
}

static int do_run(const run_options *o, bool *is_again) {
  sv_err err = {0};
  sv_status s = sv_app_run(&run.app, &err);
  sv_linux_console_finish(&run.console);
  *is_again = run.app.preview.is_new_requested;
  run.is_calibrating = run.app.preview.is_calibration_requested;
  if (*is_again) return 0;
  if (s == SV_E_INTERRUPTED && run.app.state == SV_APP_DONE) { // what was trained is saved
    say(2, "subview: %s\n", err.text);
    s = SV_OK;
  }
  if (s >= 0 && o->is_mesh) s = save_mesh(o, &err);
  const sv_pictures pictures = sv_app_pictures(&run.app);
  if (s >= 0 && o->orbit && sv_pictures_orbit(&pictures, (int)o->orbit) < 0)
    s = sv_fail(&err, SV_E_RANGE, "the model could not be rendered for --orbit");
  int code = s < 0 ? fail_with(&err) : report(o, &err);
  if (!code && sv_app_has_quality_fallen(&run.app.moving)) {
    sv_fail(
        &err, SV_E_RANGE,
        "the model is saved, but quality has fallen to %.1f dB, from %.1f dB earlier in this run: look at "
        "it before you use it",
        run.app.moving.psnr_late, run.app.moving.psnr_usual);
    code = fail_with(&err);
  }
  if (!code && run.out.picture_err.status < 0) code = fail_with(&run.out.picture_err);
  if (!code && (run.app.files.rescued || run.out.is_preview_rescued)) code = tell_rescue(o);
  *is_again = sv_preview_stay(&run.app.preview) == SV_AGAIN;
  run.is_calibrating = run.app.preview.is_calibration_requested;
  return code;
}

// After a failure: the page tells it. A service that waits there is ready, and can be asked.
static preview_answer wait_on_page(const run_options *o, const preview_failure *why) {
  sv_console console = sv_linux_console_port(&run.console);
  if (o->is_session) sv_linux_watch_ready(&run.watch);
  return preview_failed(o, why, &console, &run.watch.beats);
}

// One run from its source on. *is_again: New was asked for on the page.
static int run_once(const run_options *o, bool *is_again) {
  sv_err err = {0};
  const char *what;
  sv_arena arena = {0};
  int code = 0;
  *is_again = run.is_calibrating = false;
  outputs_init(&run.out);
  if (board_arena(&arena, &err) < 0) return fail_with(&err);
  if (set_up(o, &arena, &what, &err) < 0) {
    if (err.text[0]) {                                          // the others have spoken
      const bool is_new = strcmp(err.text, run.told.text) != 0; // told once
      if (o->is_check) check_list_fails(what, err.text);
      else if (is_new) fail_with(&err);
      run.told = err;
    }
    code = err.text[0] ? 1 : EXIT_USAGE;
    const preview_failure why = {.cause = what[0] == 'c'   ? SV_CAUSE_CAMERA
                                          : what[0] == 'r' ? SV_CAUSE_RIG
                                                           : SV_CAUSE_OTHER,
                                 .sentence = err.text};
    preview_answer answer = wait_on_page(o, &why);
    *is_again = answer != PREVIEW_STOP;
    run.is_retry = answer == PREVIEW_RETRY;
    run.is_calibrating = answer == PREVIEW_CALIBRATE;
  } else {
    if (o->is_check || (run.console.is_terminal && !o->is_quiet && is_first_run(o)))
      check_list(o, &run.src, &arena, &run.k);
    run.told = (sv_err){0};
    sv_linux_watch_ready(&run.watch);
    if (!o->is_check) code = do_run(o, is_again);
  }
  outputs_close(&run.out);
  source_close(&run.src);
  return code;
}

// With --keep: the folder of the next scan, in which an interrupted one goes on. False: there is
// none, and *is_again tells whether to ask again.
static bool next_scan(run_options *o, const char *folder, bool is_new, bool *is_again) {
  static char path[SV_LINUX_CAP_PATH];
  sv_err err = {0};
  o->out = path;
  run.is_retry = false;
  scans_run next = {.path = path, .cap = sizeof path};
  const sv_status s = scans_next(folder, (int)o->keep, is_new, &next, &err);
  o->is_interrupted = next.is_interrupted;
  if (s >= 0) {
    const bool is_resumable = !o->is_refining && o->i_prior == 0 && !(o->is_dynamic && o->is_continuous);
    o->is_resume = o->is_interrupted && is_resumable;
    if (!run.told.text[0]) // else it was told
      say(2, "subview: %s %s\n",
          o->is_interrupted ? "going on with the interrupted scan" : "the next scan is", path);
    return true;
  }
  fail_with(&err);
  const preview_failure why = {.cause = SV_CAUSE_OTHER, .sentence = err.text};
  *is_again = wait_on_page(o, &why) != PREVIEW_STOP;
  return false;
}

// New on the page: the first of DIR-2, DIR-3, ... without a model, so that no scan is lost.
static void next_folder(run_options *o, const char *folder) {
  static char path[SV_LINUX_CAP_PATH];
  for (int i = 2; outputs_has_model(o->out); i++) {
    sv_fmt(path, sizeof path, "%s-%d", folder, i);
    o->out = path;
  }
  if (o->out == path) say(2, "subview: the next scan is %s\n", path);
}

// The page asked for a calibration: no run has the cameras now. The next run begins in the folder
// of this one, unless that has a model.
static void calibrate(run_options *o, const char *folder) {
  sv_err err = {0};
  const calibrate_cfg cfg = {folder, sv_linux_console_port(&run.console), &run.watch.beats};
  run.is_retry = o->out && !outputs_has_model(o->out);
  if (calibrate_rig(o, &cfg, &err) < 0) fail_with(&err);
}

int cmd_run(int argc, char **argv) {
  static run_options o;
  sv_err err = {0};
  int r = run_options_parse(argc, argv, &o);
  if (r) return r < 0 ? 0 : r;
  uint32_t mask;
  if (!board_kernels(&run.k, &mask)) return EXIT_USAGE;
  sv_linux_console_init(&run.console, 2, o.is_quiet);
  if (sv_linux_catch_signals(&err) < 0) return fail_with(&err);
  sv_linux_outlive_readers();
  if (o.i_capture_cpu >= 0 && sv_linux_leave_cpu(o.i_capture_cpu, &err) < 0) return fail_with(&err);
  if (sv_linux_pool_start(&run.pool, (int)o.threads, SPIN_US, &err) < 0) return fail_with(&err);
  sv_linux_watch_open(&run.watch, "/sys");
  int code = preview_open(&o, &err) < 0;
  sv_linux_watch_share(&run.watch, preview_beats());
  if (code && err.text[0]) fail_with(&err); // the server has spoken otherwise
  const char *folder = o.out, *source = o.source;
  calibrate_use_rig(&o, folder);
  for (bool is_again = !code, is_new = false; is_again; is_new = !run.is_retry) {
    if (is_new && o.keep == 0 && !o.is_overwriting) next_folder(&o, folder);
    if (o.keep > 0 && !next_scan(&o, folder, is_new, &is_again)) continue;
    o.source = preview_source(source);
    code = run_once(&o, &is_again);
    // Before Start the cameras were opened again for another mode: the same scan
    if (preview_source(source) != source && o.out && !outputs_has_model(o.out)) run.is_retry = true;
    if (run.is_calibrating) calibrate(&o, folder);
  }
  sv_linux_watch_close(&run.watch);
  sv_linux_watch_share(&run.watch, NULL);
  preview_close();
  sv_linux_pool_stop(&run.pool);
  return code;
}
