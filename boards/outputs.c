// SPDX-License-Identifier: Apache-2.0
#include "boards/outputs.h"

#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#define N_TRIES       6 // of a picture at the end
#define FIRST_WAIT_NS (250 * SV_NS_PER_MS)
#define CAP_DOUBLINGS 6

void outputs_init(outputs *o) {
  *o = (outputs){0};
  sv_linux_store_init(&o->store);
  sv_linux_store_init(&o->rescue);
}

sv_status outputs_carve(outputs *o, sv_arena *a, int width_px, int height_px, sv_err *err) {
  sv_codec_cfg cc = {.max_width_px = width_px, .max_height_px = height_px};
  sv_status s = sv_codec_init(&o->codec, &cc, a);
  if (s < 0) return sv_fail(err, s, "no room for a preview of %dx%d pixels", width_px, height_px);
  o->cap_jpeg = (size_t)width_px * (size_t)height_px * 3 + 4096;
  o->jpeg = SV_TAKE(a, uint8_t, o->cap_jpeg);
  return a->status < 0 ? sv_fail(err, a->status, "no room for the preview") : SV_OK;
}

bool outputs_has_model(const char *dir) {
  static const sv_app_file files[] = {SV_APP_FILE_MODEL, SV_APP_FILE_CHECKPOINT};
  char path[SV_LINUX_CAP_PATH + 32];
  for (int i = 0; i < 2; i++) {
    struct stat st;
    sv_fmt(path, sizeof path, "%s/%s", dir, sv_app_file_name(files[i]));
    if (stat(path, &st) == 0 && S_ISREG(st.st_mode)) return true;
  }
  return false;
}

sv_status outputs_open(outputs *o, const run_options *opt, const sv_app *app, sv_console console,
                       sv_err *err) {
  o->rescue_option = opt->rescue;
  o->app = app;
  o->console = console;
  sv_status s = sv_linux_store_open(&o->store, opt->out, err);
  if (s >= 0) s = sv_linux_store_lock(&o->store, err);
  if (s < 0 || opt->is_resume || opt->is_overwriting || opt->is_interrupted || opt->is_check) return s;
  if (outputs_has_model(opt->out))
    return sv_fail(err, SV_E_ARG,
                   "%s: holds the model of an earlier run; give another --out, --resume to go on with it, or "
                   "--overwrite",
                   opt->out);
  return SV_OK;
}

// --- the second place ----------------------------------------------------------------------------

static sv_status open_rescue(outputs *o, sv_err *err) {
  char path[SV_LINUX_CAP_PATH];
  if (o->rescue.dir_fd >= 0) return SV_OK;
  if (o->rescue_option) return sv_linux_store_open(&o->rescue, o->rescue_option, err);
  sv_status s = sv_linux_rescue_dir(path, sizeof path, err);
  return s < 0 ? s : sv_linux_store_open(&o->rescue, path, err);
}

static sv_status rescue_begin(void *self, const char *name, sv_err *err) {
  outputs *o = self;
  sv_status s = open_rescue(o, err);
  sv_store st = sv_linux_store_port(&o->rescue);
  return s < 0 ? s : st.begin(st.self, name, err);
}
static sv_status rescue_write(void *self, const void *data, size_t bytes, sv_err *err) {
  sv_store st = sv_linux_store_port(&((outputs *)self)->rescue);
  return st.write(st.self, data, bytes, err);
}
static sv_status rescue_commit(void *self, sv_err *err) {
  sv_store st = sv_linux_store_port(&((outputs *)self)->rescue);
  return st.commit(st.self, err);
}
static void rescue_abandon(void *self) {
  sv_store st = sv_linux_store_port(&((outputs *)self)->rescue);
  st.abandon(st.self);
}

static sv_store rescue_port(outputs *o) {
  return (sv_store){.self = o,
                    .begin = rescue_begin,
                    .write = rescue_write,
                    .commit = rescue_commit,
                    .abandon = rescue_abandon};
}

// --- pictures ------------------------------------------------------------------------------------

static sv_status put_picture(const sv_store *st, const char *file, const outputs *o, size_t bytes,
                             sv_err *err) {
  sv_status s = st->begin(st->self, file, err);
  if (s < 0) return s;
  s = st->write(st->self, o->jpeg, bytes, err);
  if (s >= 0) return st->commit(st->self, err);
  st->abandon(st->self);
  return s;
}

static void tell_failure(outputs *o, sv_ns now_ns) {
  char line[400];
  const int wait_s = 1 << (o->n_failed < CAP_DOUBLINGS ? o->n_failed : CAP_DOUBLINGS);
  o->n_failed++;
  o->retry_ns = now_ns + wait_s * SV_NS_PER_S;
  sv_fmt(line, sizeof line, "%s; next try in %d s", o->picture_err.text, wait_s);
  o->console.log(o->console.self, SV_LOG_WARN, line);
}

// While training once, with pauses after a failure; at the end for some seconds, then in the second
// place.
static sv_status save_picture(outputs *o, const char *file, size_t bytes, bool *is_rescued) {
  sv_clock m = sv_linux_clock();
  const sv_store st = sv_linux_store_port(&o->store), rescue = rescue_port(o);
  const bool is_end = o->app->state >= SV_APP_SAVING;
  *is_rescued = false;
  sv_status s = put_picture(&st, file, o, bytes, &o->picture_err);
  for (int i = 1; s < 0 && is_end && i < N_TRIES && !o->app->files.is_store_lost; i++) {
    m.sleep_until_ns(m.self, m.now_ns(m.self) + (FIRST_WAIT_NS << (i - 1)));
    s = put_picture(&st, file, o, bytes, &o->picture_err);
  }
  if (s >= 0 || !is_end) return s;
  sv_err second;
  *is_rescued = put_picture(&rescue, file, o, bytes, &second) >= 0;
  return *is_rescued ? SV_OK : s;
}

void outputs_publish(outputs *o, const char *name, int w, int h, const uint8_t *rgb) {
  sv_clock m = sv_linux_clock();
  const sv_ns now_ns = m.now_ns(m.self);
  if (o->n_failed && o->app->state < SV_APP_SAVING && now_ns < o->retry_ns) return;
  sv_picture pic = {.width_px = w,
                    .height_px = h,
                    .stride_bytes = (size_t)w * 3,
                    .format = SV_PIX_RGB8,
                    .data = (uint8_t *)(uintptr_t)rgb};
  char file[64];
  size_t bytes;
  bool is_rescued = false;
  sv_status s = sv_codec_encode_jpeg(&o->codec, &pic, (sv_jpeg_options){92, true},
                                     (sv_codec_buffer){o->jpeg, o->cap_jpeg}, &bytes, &o->picture_err);
  sv_fmt(file, sizeof file, "%s.jpg", name);
  if (s >= 0) s = save_picture(o, file, bytes, &is_rescued);
  if (s < 0) tell_failure(o, now_ns);
  else {
    o->n_failed = 0;
    o->picture_err = (sv_err){0};
  }
  if (strcmp(name, "preview") != 0) return;
  o->has_preview = s >= 0;
  o->is_preview_rescued = is_rescued;
}

void outputs_port(outputs *o, sv_port *port) {
  port->store = sv_linux_store_port(&o->store);
  port->rescue = rescue_port(o);
  port->rescue_dir = o->rescue.dir;
}

// --- at the end ----------------------------------------------------------------------------------

void outputs_say(const outputs *o) {
  static const sv_app_file files[] = {SV_APP_FILE_MODEL, SV_APP_FILE_REPORT, SV_APP_FILE_CHECKPOINT};
  say(1, "saved:");
  for (int i = 0; i < 3; i++)
    say(1, " %s/%s", o->app->files.rescued >> files[i] & 1 ? o->rescue.dir : o->store.dir,
        sv_app_file_name(files[i]));
  if (o->has_preview) say(1, " %s/preview.jpg", o->is_preview_rescued ? o->rescue.dir : o->store.dir);
  say(1, "\n");
}

void outputs_close(outputs *o) {
  sv_linux_store_close(&o->store);
  sv_linux_store_close(&o->rescue);
  if (o->rescue.dir[0] && !o->rescue_option) (void)rmdir(o->rescue.dir); // goes when it is empty
  sv_codec_close(&o->codec);
}
