// SPDX-License-Identifier: Apache-2.0
#include "tests/common/world.h"

#include <math.h>
#include <stdio.h>
#include <string.h>

#include "src/format/rig_file.h"
#include "src/metric/metric.h"
#include "tests/common/test.h"

#define BLOCK_BYTES ((size_t)96 << 20)

static _Alignas(SV_ARENA_ALIGN) uint8_t block[BLOCK_BYTES];
// the last one: the file being written
static uint8_t file_block[WORLD_CAP_FILES + 1][WORLD_CAP_FILE];
static uint8_t second_block[WORLD_CAP_FILES + 1][WORLD_CAP_FILE];
static uint8_t truth[640 * 480 * 3];

static const char *const CALL_NAMES[WORLD_N_CALLS] = {"start", "dequeue",     "requeue", "stop",   "rig_pose",
                                                      "event", "set_control", "trigger", "worker", "begin",
                                                      "write", "commit",      "read",    "decode"};
const char *world_call_name(world_call c) { return CALL_NAMES[c]; }

// True when this call is to fail.
static bool fails(world *w, world_call c) {
  long n = ++w->fault.n[c];
  if (c != w->fault.call || !w->fault.at) return false;
  if (n != w->fault.at && !(w->fault.is_lasting && n > w->fault.at)) return false;
  w->fault.was_hit = true;
  return true;
}

// --- source --------------------------------------------------------------------------------------

static sv_status src_caps(void *self, int i_camera, sv_camera_caps *out) {
  world *w = self;
  return w->inner.source.caps(w->inner.source.self, i_camera, out);
}
static sv_status src_start(void *self) {
  world *w = self;
  return fails(w, WORLD_START) ? SV_E_DEVICE : w->inner.source.start(w->inner.source.self);
}
static sv_status src_dequeue(void *self, sv_frame *f, sv_ns until_ns) {
  world *w = self;
  if (!fails(w, WORLD_DEQUEUE)) {
    sv_status s = w->inner.source.dequeue(w->inner.source.self, f, until_ns);
    w->n_out += s == SV_OK;
    return s;
  }
  memset(f, 0, sizeof *f);
  return SV_E_DEVICE;
}
static sv_status src_requeue(void *self, const sv_frame *f) {
  world *w = self;
  w->n_back++;
  return fails(w, WORLD_REQUEUE) ? SV_E_DEVICE : w->inner.source.requeue(w->inner.source.self, f);
}
// a failing stop still ends the stream, as a device that went away
static sv_status src_stop(void *self) {
  world *w = self;
  sv_status s = w->inner.source.stop(w->inner.source.self);
  return fails(w, WORLD_STOP) ? SV_E_DEVICE : s;
}
static sv_status src_rig_pose(void *self, sv_ns host_ns, sv_pose *rig_from_world) {
  world *w = self;
  if (fails(w, WORLD_RIG_POSE)) return SV_E_IO;
  return w->inner.source.rig_pose(w->inner.source.self, host_ns, rig_from_world);
}
static sv_status src_event(void *self, sv_camera_event *e) {
  world *w = self;
  if (fails(w, WORLD_EVENT)) return SV_E_DEVICE;
  return w->inner.source.event ? w->inner.source.event(w->inner.source.self, e) : SV_AGAIN;
}
static sv_status src_set_control(void *self, int i_camera, sv_control c, int64_t value, int64_t *actual) {
  world *w = self;
  if (fails(w, WORLD_SET_CONTROL)) return SV_E_DEVICE;
  return w->inner.source.set_control(w->inner.source.self, i_camera, c, value, actual);
}
static sv_status src_trigger(void *self, bool is_external) {
  world *w = self;
  return fails(w, WORLD_TRIGGER) ? SV_E_DEVICE : w->inner.source.trigger(w->inner.source.self, is_external);
}

static sv_status decode(void *self, const uint8_t *data, size_t bytes, const sv_decoded *out, sv_err *err) {
  world *w = self;
  if (fails(w, WORLD_DECODE)) return sv_fail(err, SV_E_CORRUPT, "a picture cannot be decoded: made to fail");
  return w->inner.decoder.decode(w->inner.decoder.self, data, bytes, out, err);
}
sv_decoder world_decoder(world *w, const sv_decoder *inner) {
  w->inner.decoder = *inner;
  return (sv_decoder){w, decode};
}

// --- the cameras' thread -------------------------------------------------------------------------

static sv_status worker_start(void *self, void (*fn)(void *arg), void *arg) {
  world *w = self;
  return fails(w, WORLD_WORKER) ? SV_E_IO : w->inner.worker.start(w->inner.worker.self, fn, arg);
}
static void worker_join(void *self) {
  world *w = self;
  w->inner.worker.join(w->inner.worker.self);
}
sv_worker world_worker(world *w) {
  w->inner.worker = sv_linux_worker_port(&w->background);
  return (sv_worker){w, worker_start, worker_join};
}

// --- store ---------------------------------------------------------------------------------------

static sv_status put_begin(world_store *s, uint8_t *data, const char *name, sv_err *err) {
  if (s->is_open) return sv_fail(err, SV_E_ARG, "%s: begin while %s is open", name, s->open_name);
  s->is_open = true;
  s->open_bytes = 0;
  s->open_data = data;
  sv_copy(s->open_name, sizeof s->open_name, name);
  return SV_OK;
}

static sv_status put_write(world_store *s, const void *data, size_t bytes, sv_err *err) {
  if (!s->is_open) return sv_fail(err, SV_E_ARG, "write without begin");
  if (bytes > WORLD_CAP_FILE - s->open_bytes) return sv_fail(err, SV_E_IO, "%s: too large", s->open_name);
  memcpy(s->open_data + s->open_bytes, data, bytes);
  s->open_bytes += bytes;
  return SV_OK;
}

// The file of that name, a new one if need be; NULL: there is no room.
static world_file *file_of(world_store *s, uint8_t (*blocks)[WORLD_CAP_FILE], const char *name) {
  int i = 0;
  while (i < s->n_files && strcmp(s->file[i].name, name) != 0) i++;
  for (int k = 0; i == s->n_files && k < s->n_files; k++)
    if (!s->file[k].name[0]) i = k; // of a file that was removed
  if (i == WORLD_CAP_FILES) return NULL;
  if (i == s->n_files) s->file[s->n_files++] = (world_file){.data = blocks[i]};
  sv_copy(s->file[i].name, sizeof s->file[i].name, name);
  return &s->file[i];
}

static sv_status put_commit(world_store *s, uint8_t (*blocks)[WORLD_CAP_FILE], sv_err *err) {
  if (!s->is_open) return sv_fail(err, SV_E_ARG, "commit without begin");
  s->is_open = false;
  world_file *f = file_of(s, blocks, s->open_name);
  if (!f) return sv_fail(err, SV_E_IO, "%s: too many files", s->open_name);
  memcpy(f->data, s->open_data, f->bytes = s->open_bytes);
  return SV_OK;
}

static sv_status st_begin(void *self, const char *name, sv_err *err) {
  world *w = self;
  if (!w->store.is_open && fails(w, WORLD_BEGIN))
    return sv_fail(err, SV_E_IO, "%s: cannot be written: made to fail", name);
  return put_begin(&w->store, file_block[WORLD_CAP_FILES], name, err);
}

static sv_status st_write(void *self, const void *data, size_t bytes, sv_err *err) {
  world *w = self;
  if (w->store.is_open && fails(w, WORLD_WRITE))
    return sv_fail(err, SV_E_IO, "%s: write failed: made to fail", w->store.open_name);
  return put_write(&w->store, data, bytes, err);
}

static sv_status st_commit(void *self, sv_err *err) {
  world *w = self;
  if (!w->store.is_open || !fails(w, WORLD_COMMIT)) return put_commit(&w->store, file_block, err);
  w->store.is_open = false;
  return sv_fail(err, SV_E_IO, "%s: not saved: made to fail", w->store.open_name);
}

static sv_status st_commit_over(void *self, const char *older, bool is_kept, sv_err *err) {
  world *w = self;
  static uint8_t was[WORLD_CAP_FILE];
  const world_file *f = world_find(w, w->store.open_name);
  const size_t bytes = is_kept && f ? f->bytes : 0;
  if (bytes) memcpy(was, f->data, bytes);
  sv_status s = st_commit(self, err);
  for (int i = 0; s >= 0 && !is_kept && i < w->store.n_files; i++)
    if (!strcmp(w->store.file[i].name, older)) w->store.file[i].name[0] = 0;
  if (s < 0 || !bytes) return s;
  world_file *o = file_of(&w->store, file_block, older);
  if (!o) return sv_fail(err, SV_E_IO, "%s: too many files", older);
  memcpy(o->data, was, o->bytes = bytes);
  return SV_OK;
}

static void st_abandon(void *self) { ((world *)self)->store.is_open = false; }

// The second place never fails.
static sv_status second_begin(void *self, const char *name, sv_err *err) {
  return put_begin(&((world *)self)->second, second_block[WORLD_CAP_FILES], name, err);
}
static sv_status second_write(void *self, const void *data, size_t bytes, sv_err *err) {
  return put_write(&((world *)self)->second, data, bytes, err);
}
static sv_status second_commit(void *self, sv_err *err) {
  return put_commit(&((world *)self)->second, second_block, err);
}
static void second_abandon(void *self) { ((world *)self)->second.is_open = false; }

sv_store world_rescue(world *w) {
  w->port.rescue_dir = "the second place";
  return (sv_store){.self = w,
                    .begin = second_begin,
                    .write = second_write,
                    .commit = second_commit,
                    .abandon = second_abandon};
}

static sv_status st_read(void *self, const char *name, void *buf, size_t cap, size_t *bytes, sv_err *err) {
  world *w = self;
  const world_file *f = world_find(w, name);
  *bytes = 0;
  if (fails(w, WORLD_READ)) return sv_fail(err, SV_E_IO, "%s: cannot be read: made to fail", name);
  if (!f) return sv_fail(err, SV_E_NOT_FOUND, "%s: there is no such file", name);
  *bytes = f->bytes;
  if (f->bytes > cap) return sv_fail(err, SV_E_NOMEM, "%s: does not fit", name);
  memcpy(buf, f->data, f->bytes);
  return SV_OK;
}

const world_file *world_find(const world *w, const char *name) {
  for (int i = 0; i < w->store.n_files; i++)
    if (!strcmp(w->store.file[i].name, name)) return &w->store.file[i];
  return NULL;
}

void world_forget_files(world *w) {
  memset(&w->store, 0, sizeof w->store);
  memset(&w->second, 0, sizeof w->second);
}

// --- clock, console, publisher -------------------------------------------------------------------

static sv_ns machine_now(void *self) {
  world *w = self;
  return w->machine_ns += w->machine_tick_ns;
}
static void machine_sleep(void *self, sv_ns until_ns) {
  world *w = self;
  if (until_ns > w->machine_ns) w->machine_ns = until_ns;
}

static void log_line(void *self, sv_log_level level, const char *line) {
  world *w = self;
  int i = w->n_lines < WORLD_CAP_LINES ? w->n_lines++ : WORLD_CAP_LINES - 1;
  sv_copy(w->line[i], sizeof w->line[i], line);
  w->level[i] = level;
}

static bool is_stop_requested(void *self) {
  const world *w = self;
  return w->is_stop_at_once || (w->stop_at_step && w->app.trainer.step >= w->stop_at_step);
}

static void publish(void *self, const char *name, int width_px, int height_px, const uint8_t *rgb) {
  world *w = self;
  (void)name;
  (void)rgb;
  w->n_images++;
  w->image_width_px = width_px;
  w->image_height_px = height_px;
}

bool world_has_line(const world *w, const char *text) {
  for (int i = 0; i < w->n_lines; i++)
    if (strstr(w->line[i], text)) return true;
  return false;
}

// --- the world -----------------------------------------------------------------------------------

static bool start_over(world *w, uint32_t isa_mask, int n_threads) {
  world_store kept = w->store;
  world_close(w); // a failed test may have left its threads
  memset(w, 0, sizeof *w);
  w->store = kept;
  w->store.is_open = false;
  w->arena = sv_arena_make(block, sizeof block);
  w->machine_tick_ns = SV_NS_PER_MS;
  sv_kernels_init(&w->k, isa_mask);
  return sv_linux_pool_start(&w->pool, n_threads, -1, &w->err) >= 0;
}

// Wraps a source and its clock, and fills in the cfg but for rig and bounds.
static bool finish_open(world *w, sv_source source, sv_clock clock, const char *name, int n_exposures) {
  int n = source.n_cameras;
  if (n > (int)(sizeof w->caps / sizeof *w->caps)) return false;
  w->inner = (sv_port){.clock = clock, .pool = sv_linux_pool_port(&w->pool), .source = source};
  w->port = w->inner;
  w->port.machine = (sv_clock){w, machine_now, machine_sleep};
  w->port.source = (sv_source){.self = w,
                               .n_cameras = n,
                               .caps = src_caps,
                               .start = src_start,
                               .dequeue = src_dequeue,
                               .requeue = src_requeue,
                               .stop = src_stop,
                               .rig_pose = src_rig_pose,
                               .event = src_event,
                               .set_control = source.set_control ? src_set_control : NULL,
                               .trigger = source.trigger ? src_trigger : NULL};
  w->port.store = (sv_store){.self = w,
                             .begin = st_begin,
                             .write = st_write,
                             .commit = st_commit,
                             .commit_over = st_commit_over,
                             .abandon = st_abandon,
                             .read = st_read};
  w->port.console = (sv_console){w, log_line, is_stop_requested};
  w->port.publish = (sv_publish){.self = w, .image = publish};
  for (int i = 0; i < n; i++)
    if (src_caps(w, i, &w->caps[i]) < 0) return false;
  w->cfg = (sv_app_cfg){.n_cameras = n,
                        .caps = w->caps,
                        .source_name = name,
                        .n_exposures = n_exposures,
                        .skew_limit_ns = 20 * SV_NS_PER_MS,
                        .capture_timeout_ns = 10 * SV_NS_PER_S,
                        .train = sv_train_defaults(),
                        .dynamic = sv_dynamic_defaults(),
                        .has_bounds = true};
  return true;
}

bool world_open(world *w, const char *spec, int n_exposures, uint32_t isa_mask, int n_threads) {
  sv_sim_config sc;
  double c[3], radius;
  if (!start_over(w, isa_mask, n_threads)) return false;
  if (sv_sim_parse(&sc, spec, &w->err) < 0) return false;
  sc.n_exposures = n_exposures;
  if (sv_sim_init(&w->sim, &sc, &w->arena, &w->err) < 0) return false;
  if (!finish_open(w, sv_sim_source(&w->sim), sv_sim_clock(&w->sim), spec, n_exposures)) return false;
  sv_sim_scene_bounds(&w->sim, c, &radius);
  w->cfg.bounds = (sv_bounds){{(float)c[0], (float)c[1], (float)c[2]}, (float)radius};
  w->cfg.rig = sv_sim_rig(&w->sim);
  return true;
}

static sv_status read_rig_file(void *self, const char *name, void *buf, size_t cap, size_t *bytes,
                               sv_err *err) {
  char path[2 * SV_CAPTURE_CAP_PATH];
  sv_fmt(path, sizeof path, "%s/%s", (const char *)self, name);
  FILE *f = fopen(path, "rb");
  if (!f) return sv_fail(err, SV_E_NOT_FOUND, "%s: cannot be read", path);
  *bytes = fread(buf, 1, cap, f);
  fclose(f);
  return *bytes < cap ? SV_OK : sv_fail(err, SV_E_NOMEM, "%s: too large", path);
}

bool world_open_replay(world *w, const char *dir, int n_exposures, uint32_t isa_mask, int n_threads) {
  sv_replay_cfg rc = {.speed = 0};
  char rig_dir[SV_CAPTURE_CAP_PATH];
  if (!start_over(w, isa_mask, n_threads)) return false;
  w->is_replay = true;
  sv_copy(rc.dir, sizeof rc.dir, dir);
  if (sv_replay_init(&w->replay, &rc, &w->arena, &w->err) < 0) return false;
  const sv_capture *c = &w->replay.capture;
  if (!finish_open(w, sv_replay_source(&w->replay), sv_replay_clock(&w->replay), dir, n_exposures))
    return false;
  double d2 = 0;
  for (int i = 0; i < 3; i++) {
    double half = 0.5 * (c->scene_max_m[i] - c->scene_min_m[i]);
    w->cfg.bounds.centre[i] = (float)(c->scene_min_m[i] + half);
    d2 += half * half;
  }
  w->cfg.bounds.radius = (float)sqrt(d2);
  w->cfg.has_bounds = c->has_scene;
  if (sv_rig_init(&w->rig, 16, &w->arena) < 0) return false;
  sv_arena scratch = sv_arena_sub(&w->arena, 1 << 20);
  sv_fmt(rig_dir, sizeof rig_dir, "%s/%s", dir, c->rig);
  sv_file_reader files = {rig_dir, read_rig_file};
  w->cfg.rig = &w->rig;
  return sv_rig_read(&w->rig, &files, w->cfg.n_cameras, &scratch, &w->err) >= 0;
}

sv_status world_init(world *w) { return sv_app_init(&w->app, &w->cfg, &w->k, &w->port, &w->arena, &w->err); }

sv_status world_init_in(world *w, size_t bytes) {
  // At the end of the block, so that a sanitizer sees what goes beyond it.
  w->arena = sv_arena_make(block + ((BLOCK_BYTES - bytes) & ~(size_t)(SV_ARENA_ALIGN - 1)), bytes);
  return world_init(w);
}

sv_status world_run(world *w) {
  sv_status s = world_init(w);
  return s < 0 ? s : sv_app_run(&w->app, &w->err);
}

void world_close(world *w) {
  if (w->pool.n_threads) sv_linux_pool_stop(&w->pool);
  if (w->is_replay) sv_replay_close(&w->replay);
  w->pool.n_threads = 0;
  w->is_replay = false;
}

size_t world_app_bytes(world *w) {
  static sv_app planned;
  sv_arena dry = sv_arena_dry();
  return sv_app_plan(&planned, &w->cfg, w->pool.n_threads, &dry, &w->err) < 0 ? 0 : dry.used_bytes;
}

double world_heldout_psnr(world *w, int n) {
  double psnr = 0;
  for (int i = 0; i < n; i++) {
    sv_view v;
    double t, mse;
    sv_sim_heldout_view(&w->sim, i, n, &v, &t);
    sv_sim_render(&w->sim, &v, t, truth, NULL);
    if (sv_driver_lit_mse(&w->app.trainer, &v, w->app.exposures.white / sv_sim_light(&w->sim), truth, &mse) <
        0)
      return -1;
    psnr += sv_psnr_of_mse(mse) / n;
  }
  return psnr;
}

void world_open_well(world *w, const char *spec, int n_exposures, uint32_t isa_mask, int n_threads) {
  if (!world_open(w, spec, n_exposures, isa_mask, n_threads)) fail_msg("%s: %s", spec, w->err.text);
}

void world_run_well(world *w) {
  if (world_run(w) < 0) fail_msg("%s: %s", w->cfg.source_name, w->err.text);
  assert_int_equal(w->app.state, SV_APP_DONE);
}

sv_train_stats world_stats(const world *w) {
  sv_train_stats s;
  sv_train_get_stats(&w->app.trainer, &s);
  return s;
}

uint64_t world_digest(const world *w) { return sv_train_digest(&w->app.trainer); }

double world_training_psnr(world *w) {
  double psnr;
  assert_int_equal(sv_driver_training_psnr(&w->app.trainer, &psnr), SV_OK);
  return psnr;
}
