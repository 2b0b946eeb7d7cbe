// SPDX-License-Identifier: Apache-2.0
// A recording of ROS 2 (.mcap, .db3) -> a capture folder: a camera for each topic of pictures,
// exposures by the times in the messages' headers. It is read twice: for the times, and for the
// pictures that make exposures.
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "src/base/str.h"
#include "tools/import/clips.h"
#include "tools/import/import.h"
#include "tools/import/mcap.h"

#define CAP        SV_IMPORT_CAP_CAMERAS
#define CAP_TOPICS 64

// Raw pixels of 8 bits that are read: channels, and where red, green and blue are.
static const struct {
  const char *name;
  int n_channels, at[3];
} encodings[] = {{"rgb8", 3, {0, 1, 2}},  {"bgr8", 3, {2, 1, 0}},  {"8UC3", 3, {2, 1, 0}},
                 {"rgba8", 4, {0, 1, 2}}, {"bgra8", 4, {2, 1, 0}}, {"mono8", 1, {0, 0, 0}},
                 {"8UC1", 1, {0, 0, 0}}};

typedef struct {
  char name[LAB_MCAP_CAP_TOPIC];
  bool is_skipped;
  sv_ns last_ns;       // of the last picture that was taken
  int n, cap;          // pictures
  double *times_s;     // [n] from the recording's first picture on
  int camera;          // its number, -1: none
  int n_seen, n_saved; // at the second reading: pictures, exposures
} topic;

typedef struct {
  const lab_options *o;
  lab_session *se;
  sv_import_job job;
  topic topics[CAP_TOPICS];
  int n_topics;
  sv_ns first_ns;
  lab_clips all;
  lab_clip clips[CAP];
  sv_import_camera cams[CAP];
} job;

// --- pictures ------------------------------------------------------------------------------------

static bool is_jpeg(const lab_mcap_picture *p) {
  return p->bytes > 3 && p->px[0] == 0xff && p->px[1] == 0xd8;
}
static bool is_png(const lab_mcap_picture *p) {
  return p->bytes > 8 && memcmp(p->px, "\x89PNG\r\n\x1a\n", 8) == 0;
}

static int encoding_of(const lab_mcap_picture *p) {
  for (size_t i = 0; i < sizeof encodings / sizeof *encodings; i++)
    if (sv_str_eq(p->encoding, encodings[i].name)) return (int)i;
  return -1;
}

static bool is_readable(const lab_mcap_message *m, const lab_mcap_picture *p) {
  return m->is_compressed ? is_jpeg(p) || is_png(p) : encoding_of(p) >= 0;
}

static sv_status save_raw(const lab_mcap_picture *p, const char *path, sv_err *err) {
  const int e = encoding_of(p), n_in = encodings[e].n_channels, n_out = n_in == 1 ? 1 : 3;
  const size_t w = (size_t)p->width_px, h = (size_t)p->height_px;
  if (n_in * p->width_px > p->stride_bytes)
    return sv_fail(err, SV_E_FORMAT, "%.150s: its rows of %d bytes are too short for %d pixels", path,
                   p->stride_bytes, p->width_px);
  uint8_t *px = malloc(w * h * (size_t)n_out);
  if (!px) return sv_fail(err, SV_E_NOMEM, "%.150s: no memory for a picture", path);
  for (size_t y = 0; y < h; y++)
    for (size_t x = 0; x < w; x++)
      for (int k = 0; k < n_out; k++)
        px[(y * w + x) * (size_t)n_out + (size_t)k] =
            p->px[y * (size_t)p->stride_bytes + x * (size_t)n_in + (size_t)encodings[e].at[k]];
  const sv_bitmap b = {p->width_px, p->height_px, n_out, 8, px, NULL};
  sv_status s = sv_bitmap_write_png(path, &b, err);
  free(px);
  return s;
}

// Compressed pictures stay as they are.
static sv_status save(const job *j, const lab_mcap_message *m, const lab_mcap_picture *p, int camera, int i,
                      sv_err *err) {
  char path[SV_CAP_PATH], name[80];
  snprintf(name, sizeof name, "%.48s/%06d%s", j->cams[camera].name, i,
           m->is_compressed && is_jpeg(p) ? ".jpg" : ".png");
  sv_status s = sv_path_join(path, sizeof path, j->o->out, name, err);
  if (s != SV_OK) return s;
  return m->is_compressed ? sv_file_write(path, p->px, p->bytes, err) : save_raw(p, path, err);
}

// --- topics --------------------------------------------------------------------------------------

static topic *topic_of(job *j, const char *name) {
  for (int i = 0; i < j->n_topics; i++)
    if (sv_str_eq(j->topics[i].name, name)) return &j->topics[i];
  return NULL;
}

static sv_status add_time(topic *t, double time_s, sv_err *err) {
  if (t->n == t->cap) {
    const int cap = t->cap ? 2 * t->cap : 256;
    double *more = realloc(t->times_s, (size_t)cap * sizeof *more);
    if (!more) return sv_fail(err, SV_E_NOMEM, "%.100s: no memory for its times", t->name);
    t->times_s = more;
    t->cap = cap;
  }
  t->times_s[t->n++] = time_s;
  return SV_OK;
}

// The picture of a message that counts; false: it is skipped, as is what is not later than the one
// before.
static bool is_next(topic *t, const lab_mcap_message *m, const lab_mcap_picture *p, sv_ns *time_ns) {
  *time_ns = p->stamp_ns > 0 ? p->stamp_ns : (sv_ns)(m->log_ns & INT64_MAX);
  if (t->is_skipped || !is_readable(m, p) || *time_ns <= t->last_ns) return false;
  t->last_ns = *time_ns;
  return true;
}

static sv_status first_reading(void *self, const lab_mcap_message *m, sv_err *err) {
  job *j = self;
  lab_mcap_picture p;
  sv_ns time_ns;
  topic *t = topic_of(j, m->topic);
  sv_status s = lab_mcap_picture_of(m, &p, err);
  if (s == SV_OK && lab_is_stopped(j->se)) s = SV_E_INTERRUPTED;
  if (s != SV_OK) return s;
  if (!t) {
    if (j->n_topics == CAP_TOPICS)
      return sv_fail(err, SV_E_RANGE, "%.150s: more than %d topics of pictures", j->o->input, CAP_TOPICS);
    t = &j->topics[j->n_topics++];
    *t = (topic){.camera = -1, .is_skipped = !is_readable(m, &p)};
    snprintf(t->name, sizeof t->name, "%s", m->topic);
    if (t->is_skipped)
      lab_say(j->se, "%s: left out, as its pictures (%s) are neither JPEG, PNG nor color or gray of 8 bits",
              t->name, p.encoding);
  }
  if (!is_next(t, m, &p, &time_ns)) return SV_OK;
  if (!j->first_ns) j->first_ns = time_ns;
  return add_time(t, 1e-9 * (double)(time_ns - j->first_ns), err);
}

static sv_status second_reading(void *self, const lab_mcap_message *m, sv_err *err) {
  job *j = self;
  lab_mcap_picture p;
  sv_ns time_ns;
  topic *t = topic_of(j, m->topic);
  sv_status s =
      t ? lab_mcap_picture_of(m, &p, err) : sv_fail(err, SV_E_FORMAT, "%.150s: has changed", j->o->input);
  if (s == SV_OK && lab_is_stopped(j->se)) s = SV_E_INTERRUPTED;
  if (s != SV_OK || t->camera < 0 || !is_next(t, m, &p, &time_ns)) return s;
  const int *kept = j->clips[t->camera].kept;
  for (; s == SV_OK && t->n_saved < j->all.n_exposures && kept[t->n_saved] == t->n_seen; t->n_saved++)
    s = save(j, m, &p, t->camera, t->n_saved, err);
  t->n_seen++;
  return s;
}

// --- cameras -------------------------------------------------------------------------------------

static int by_name(const void *a, const void *b) {
  return strcmp(((const topic *)a)->name, ((const topic *)b)->name);
}

static bool ends_in(const char *text, const char *end) {
  const size_t n = strlen(text), m = strlen(end);
  return n > m && sv_str_eq(text + n - m, end);
}

// "/left/image_raw/compressed" is camera left.
static void name_camera(const char *topic_name, char out[48]) {
  static const char *const ends[] = {"/compressed", "/image_raw", "/image_rect_raw", "/image_rect", "/image"};
  char text[LAB_MCAP_CAP_TOPIC];
  snprintf(text, sizeof text, "%s", topic_name + (*topic_name == '/'));
  for (size_t i = 0; i < sizeof ends / sizeof *ends; i++)
    if (ends_in(text, ends[i])) text[strlen(text) - strlen(ends[i])] = 0;
  for (char *p = text; *p; p++)
    if (*p == '/' || *p == '.') *p = '_';
  sv_import_name(out, text);
}

// A topic that another one repeats in compressed form is taken, the other is not.
static bool is_repeated(job *j, const topic *t) {
  char raw[LAB_MCAP_CAP_TOPIC];
  if (!ends_in(t->name, "/compressed")) return false;
  snprintf(raw, sizeof raw, "%.*s", (int)(strlen(t->name) - strlen("/compressed")), t->name);
  const topic *other = topic_of(j, raw);
  return other && other->n > 0;
}

static sv_status choose_cameras(job *j, sv_err *err) {
  qsort(j->topics, (size_t)j->n_topics, sizeof *j->topics, by_name);
  for (int i = 0; i < j->n_topics; i++) {
    topic *t = &j->topics[i];
    const int k = j->all.n;
    t->last_ns = 0;
    if (t->n == 0 || is_repeated(j, t)) continue;
    if (k == CAP)
      return sv_fail(err, SV_E_RANGE, "%.150s: pictures of more than %d cameras", j->o->input, CAP);
    name_camera(t->name, j->cams[k].name);
    for (int c = 0; c < k; c++)
      if (sv_str_eq(j->cams[c].name, j->cams[k].name))
        return sv_fail(err, SV_E_FORMAT, "%.150s: two topics make a camera %s", j->o->input, j->cams[k].name);
    t->camera = k;
    // The times are the clip's from now on.
    j->clips[k].frames = (lab_media_frames){t->n, t->times_s, NULL};
    j->clips[k].stream.path = j->cams[k].name;
    t->times_s = NULL;
    lab_say(j->se, "%s: %d pictures of camera %s", t->name, t->n, j->cams[k].name);
    j->all.n++;
  }
  return j->all.n ? SV_OK
                  : sv_fail(err, SV_E_NOT_FOUND, "%.150s: has no pictures that can be read", j->o->input);
}

static sv_status read_bag(const char *path, const lab_mcap_sink *sink, sv_err *err) {
  return sv_str_eq(sv_path_extension(path), ".db3") ? lab_db3_read(path, sink, err)
                                                    : lab_mcap_read_file(path, sink, err);
}

static sv_status import(job *j, const char *path, sv_err *err) {
  const lab_mcap_sink times = {j, first_reading}, pictures = {j, second_reading};
  sv_status s = read_bag(path, &times, err);
  if (s == SV_OK) s = choose_cameras(j, err);
  if (s == SV_OK) s = lab_clips_pair(&j->all, j->o->every_s, err);
  if (s == SV_OK) s = sv_import_begin(&j->job, err);
  if (s == SV_OK && j->o->rig) s = lab_clips_take_rig(j->o, j->cams, j->all.n, err);
  for (int k = 0; s == SV_OK && k < j->all.n; k++)
    s = lab_clips_set_times(&j->job, &j->all, k, &j->cams[k], err);
  if (s == SV_OK) s = read_bag(path, &pictures, err);
  if (s == SV_OK) s = sv_import_write(&j->job, "rosbag", j->all.fps, j->cams, j->all.n, err);
  else
    for (int k = 0; k < CAP; k++) free(j->cams[k].times_ns);
  if (s == SV_OK)
    lab_say(j->se, "%s: %d exposures of %d cameras; pictures of one exposure are up to %.1f ms apart",
            j->o->out, j->all.n_exposures, j->all.n, 1e3 * j->all.max_skew_s);
  return s;
}

static bool is_bag(const char *name) {
  return sv_str_eq(sv_path_extension(name), ".mcap") || sv_str_eq(sv_path_extension(name), ".db3");
}

// The file itself, or the only one in the folder that rosbag2 makes.
static sv_status find_file(const char *input, char path[SV_CAP_PATH], sv_err *err) {
  sv_names names;
  int n = 0;
  sv_copy(path, SV_CAP_PATH, input);
  if (!sv_path_is_folder(input)) return SV_OK;
  sv_status s = sv_folder_list(input, &names, err);
  if (s != SV_OK) return s;
  for (int i = 0; i < names.n && s == SV_OK; i++)
    if (is_bag(names.names[i]) && n++ == 0) s = sv_path_join(path, SV_CAP_PATH, input, names.names[i], err);
  sv_names_free(&names);
  if (s == SV_OK && n != 1)
    s = sv_fail(err, SV_E_NOT_FOUND, "%.150s: has %d files .mcap or .db3; name one", input, n);
  return s;
}

sv_status lab_import_rosbag(const lab_options *o, lab_session *se, sv_err *err) {
  char path[SV_CAP_PATH];
  sv_status s = find_file(o->input, path, err);
  if (s != SV_OK) return s;
  job *j = calloc(1, sizeof *j);
  if (!j) return sv_fail(err, SV_E_NOMEM, "%.150s: no memory", path);
  *j = (job){.o = o, .se = se, .job = {o->input, o->out, se->console}};
  j->all.clips = j->clips;
  s = import(j, path, err);
  lab_clips_free(&j->all);
  for (int i = 0; i < j->n_topics; i++) free(j->topics[i].times_s);
  free(j);
  return s;
}
