// SPDX-License-Identifier: Apache-2.0
#include "platform/preview/scan_routes.h"

#if defined(__has_include) && __has_include(<microhttpd.h>)
#include <errno.h>
#include <math.h>
#include <microhttpd.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "platform/linux/preview.h"
#include "platform/preview/compact.h"
#include "platform/preview/range.h"
#include "src/format/axes.h"
#include "src/format/gaussian.h"
#include "src/format/ply.h"

#define PLAIN     "text/plain; charset=utf-8"
#define CAP_JSON  (128u << 10)
#define CAP_MODEL (64u << 20) // of a model that is made into another format
#define PIECE     (32u << 10)

static pv_answer answer_of(unsigned code, const char *text) {
  return (pv_answer){
      MHD_create_response_from_buffer(strlen(text), (void *)(uintptr_t)text, MHD_RESPMEM_MUST_COPY), code,
      PLAIN};
}

static pv_answer failed(int error) {
  switch (error) {
  case ENOENT:
  case ENOTDIR: return answer_of(MHD_HTTP_NOT_FOUND, "this scan is not there\n");
  case EEXIST: return answer_of(MHD_HTTP_CONFLICT, "a scan with this name is there already\n");
  case ENOTEMPTY: return answer_of(MHD_HTTP_CONFLICT, "the folder holds other folders: remove it by hand\n");
  default: return answer_of(MHD_HTTP_SERVICE_UNAVAILABLE, "the folder of the scans refuses this\n");
  }
}

// "/scan/12/model.ply" -> 12, "model.ply". False: another address.
static bool read_url(const char *url, uint32_t *number, const char **rest) {
  if (strncmp(url, "/scan/", 6) != 0) return false;
  const char *digits = url + 6, *slash = strchr(digits, '/');
  long long n;
  if (!slash || slash == digits || digits[0] == '0' || slash - digits > 8) return false;
  if (strspn(digits, "0123456789") != (size_t)(slash - digits)) return false;
  if (!sv_parse_int(digits, (size_t)(slash - digits), &n) || n < 1) return false;
  *number = (uint32_t)n;
  *rest = slash + 1;
  return true;
}

// --- files ---------------------------------------------------------------------------------------

static ssize_t read_file(void *cls, uint64_t at, char *buf, size_t max) {
  const int *fd = cls;
  (void)at; // it is read in order
  const ssize_t n = read(*fd, buf, max);
  return n > 0 ? n : MHD_CONTENT_READER_END_WITH_ERROR;
}

static void close_file(void *cls) {
  int *fd = cls;
  close(*fd);
  free(fd);
}

static const char *type_of(const char *name) {
  const char *dot = strrchr(name, '.');
  if (dot && !strcmp(dot, ".jpg")) return "image/jpeg";
  return dot && !strcmp(dot, ".json") ? "application/json" : "application/octet-stream";
}

static void add_name(const pv_source *s, struct MHD_Response *r, uint32_t number, const char *name) {
  char folder[128], text[300];
  if (!r || !strchr(name, '.') || !strcmp(name, "preview.jpg")) return;
  if (!pv_scan_folder_name(&s->scans.place, number, folder, sizeof folder)) return;
  for (char *p = folder; *p; p++)
    if (*p == '"' || *p == '\\' || (unsigned char)*p < 32 || (unsigned char)*p > 126) *p = '_';
  sv_fmt(text, sizeof text, "attachment; filename=\"%s-%s\"", folder, name);
  MHD_add_response_header(r, "Content-Disposition", text);
}

// fd stands at the first byte.
static pv_answer send_file(int fd, uint64_t file_bytes, const pv_range *range, const char *name) {
  const uint64_t at = pv_range_begin(range, file_bytes);
  if (at >= file_bytes && range->is_part) {
    close(fd);
    return answer_of(MHD_HTTP_RANGE_NOT_SATISFIABLE, "the file ends before this\n");
  }
  const uint64_t bytes = pv_range_bytes(range, file_bytes);
  int *own = malloc(sizeof *own);
  pv_answer a = {NULL, range->is_part ? MHD_HTTP_PARTIAL_CONTENT : MHD_HTTP_OK, type_of(name)};
  if (own) {
    *own = fd;
    a.response = MHD_create_response_from_callback(bytes, PIECE, read_file, own, close_file);
  }
  if (!a.response) {
    free(own);
    close(fd);
    return a;
  }
  pv_range_headers(range, file_bytes, a.response);
  return a;
}

// --- models in other formats ---------------------------------------------------------------------

static int by_value(const void *a, const void *b) {
  const float x = *(const float *)a, y = *(const float *)b;
  return (x > y) - (x < y);
}

// Where the page's view begins: the middle and the extent of nine tenths of the Gaussians.
static bool fill_viewpoint(sv_feed_model *m, const char *up_name) {
  float *v = malloc((size_t)m->n * sizeof *v), *row = (float *)(m + 1);
  double up[3] = {0, -1, 0};
  if (!v) return false;
  for (int k = 0; k < 4; k++) {
    for (uint32_t i = 0; i < m->n; i++) {
      const float *x = row + (size_t)i * m->n_floats;
      const float d[3] = {x[0] - m->centre[0], x[1] - m->centre[1], x[2] - m->centre[2]};
      v[i] = k < 3 ? x[k] : sqrtf(d[0] * d[0] + d[1] * d[1] + d[2] * d[2]);
      if (!isfinite(v[i])) v[i] = 0;
    }
    qsort(v, m->n, sizeof *v, by_value);
    if (k < 3) m->centre[k] = v[m->n / 2];
    else m->radius = v[(size_t)m->n * 9 / 10];
  }
  free(v);
  (void)sv_up_axis(*up_name ? up_name : SV_UP_DEFAULT, up);
  const int across = up[0] == 0 ? 0 : 1; // an axis that is level
  m->fov_y = 0.8f;
  for (int k = 0; k < 3; k++) {
    m->up[k] = (float)up[k];
    m->eye[k] = m->centre[k] + 3 * m->radius * ((k == across ? 0.92f : 0) + 0.39f * m->up[k]);
  }
  return true;
}

// A snapshot as a run publishes it. NULL: the file is no model, or there is no memory.
static sv_feed_model *snapshot_of(const void *file, size_t bytes) {
  static sv_ply ply;
  sv_err err;
  if (sv_ply_open(&ply, "model.ply", file, bytes, &err) < 0 || ply.kind != SV_PLY_GAUSSIANS || ply.n == 0)
    return NULL;
  const size_t n_floats = SV_GAUSSIAN_N_FLOATS((size_t)ply.sh_degree);
  if (ply.n > CAP_MODEL / sizeof(float) / n_floats) return NULL;
  sv_feed_model *m = calloc(1, sizeof *m + ply.n * n_floats * sizeof(float));
  if (!m) return NULL;
  m->n = ply.n;
  m->sh_degree = (uint32_t)ply.sh_degree;
  m->n_floats = (uint32_t)n_floats;
  m->is_mip = ply.is_mip;
  m->is_metric = ply.unit.is_metric;
  m->scale_sigma = ply.unit.scale_sigma;
  m->dilation_px2 = ply.dilation_px2;
  m->background = ply.background;
  sv_status r = SV_OK;
  for (uint32_t i = 0; i < m->n && r >= 0; i++) {
    sv_gaussian g;
    r = sv_ply_read_gaussian(&ply, i, &g, &err);
    if (r >= 0) memcpy((float *)(m + 1) + (size_t)i * n_floats, &g, n_floats * sizeof(float));
  }
  if (r >= 0 && fill_viewpoint(m, ply.up)) return m;
  free(m);
  return NULL;
}

static pv_blob *make_format(const sv_feed_model *m, const char *name) {
  if (!strcmp(name, "model.splat")) return pv_model_make(m, PV_SPLAT);
  if (!strcmp(name, "model.spz")) return pv_model_make(m, PV_SPZ);
  pv_blob *b = pv_blob_make(pv_compact_bytes(m), 1);
  if (b) pv_compact_put(m, 1, b->data);
  return b;
}

static void drop_blob(void *b) { pv_blob_drop(b); }
static ssize_t read_blob(void *cls, uint64_t at, char *buf, size_t max) {
  const pv_blob *b = cls;
  const size_t n = b->bytes - (size_t)at < max ? b->bytes - (size_t)at : max;
  memcpy(buf, b->data + at, n);
  return (ssize_t)n;
}

static pv_answer convert(int fd, uint64_t bytes, const char *name) {
  uint8_t *file = bytes <= CAP_MODEL ? malloc((size_t)bytes + 1) : NULL;
  size_t n = 0;
  for (ssize_t got = 1; file && n < bytes && got > 0; n += got > 0 ? (size_t)got : 0)
    got = read(fd, file + n, (size_t)bytes - n);
  close(fd);
  sv_feed_model *m = file && n == bytes ? snapshot_of(file, n) : NULL;
  free(file);
  pv_blob *b = m ? make_format(m, name) : NULL;
  free(m);
  if (!b)
    return answer_of(MHD_HTTP_SERVICE_UNAVAILABLE, "this model cannot be converted here; take the .ply\n");
  pv_answer a = {MHD_create_response_from_callback(b->bytes, PIECE, read_blob, b, drop_blob), MHD_HTTP_OK,
                 "application/octet-stream"};
  if (!a.response) pv_blob_drop(b);
  return a;
}

// --- routes --------------------------------------------------------------------------------------

static pv_answer get_list(pv_source *s) {
  char *text = malloc(CAP_JSON);
  if (!text) return (pv_answer){0};
  sv_str o = sv_str_make(text, CAP_JSON);
  pv_scans_json(&s->scans, &o);
  pv_answer a = {MHD_create_response_from_buffer(o.len, text, MHD_RESPMEM_MUST_FREE), MHD_HTTP_OK,
                 "application/json"};
  if (!a.response) free(text);
  return a;
}

pv_answer pv_scan_get(pv_source *s, const char *url, const char *range) {
  static const char *const made[] = {"model.splat", "model.spz", "model"};
  pv_scans_ask ask = {.op = PV_SCANS_OPEN};
  const char *name, *file;
  int fd;
  if (!strcmp(url, "/scans")) return get_list(s);
  if (!read_url(url, &ask.number, &name)) return answer_of(MHD_HTTP_NOT_FOUND, "no such page\n");
  bool is_made = false;
  for (int i = 0; i < 3; i++) is_made = is_made || !strcmp(name, made[i]);
  while (!is_made && (file = pv_scan_file_name((int)ask.file)) && strcmp(name, file) != 0) ask.file++;
  if (ask.file >= PV_N_SCAN_FILE) return answer_of(MHD_HTTP_NOT_FOUND, "no such page\n");
  const pv_range part = pv_range_of(is_made ? NULL : range);
  ask.from = part.from;
  if (pv_scans_request(&s->scans, ask, &fd) != SV_OK) return failed(EIO);
  if (fd < 0) return failed(s->scans.answer.error);
  const uint64_t bytes = s->scans.answer.file_bytes;
  pv_answer a = is_made ? convert(fd, bytes, name) : send_file(fd, bytes, &part, name);
  if (a.code == MHD_HTTP_OK) add_name(s, a.response, ask.number, name);
  return a;
}

static bool may_be_written(pv_source *s, uint32_t number) {
  const int status = s->state.status;
  if (status == SV_FEED_STATUS_WAITING || status == SV_FEED_STATUS_DONE || status == SV_FEED_STATUS_FAILED)
    return false;
  if (pv_scans_request(&s->scans, (pv_scans_ask){.op = PV_SCANS_LIST}, NULL) != SV_OK) return true;
  for (uint32_t i = 0; i < s->scans.answer.n; i++)
    if (s->scans.answer.scan[i].number > number) return false;
  return true;
}

// The runtime makes the file, in a process of its own; asking again while it does is no harm.
static pv_answer ask_export(pv_source *s, uint32_t number, int format) {
  const uint8_t bytes[6] = {SV_PREVIEW_EXPORT,       (uint8_t)format,        (uint8_t)(number >> 24),
                            (uint8_t)(number >> 16), (uint8_t)(number >> 8), (uint8_t)number};
  if (!s->scans.has_exports)
    return answer_of(MHD_HTTP_SERVICE_UNAVAILABLE,
                     "this device cannot make that format: install the package subview-lab on it\n");
  if (write(s->command_fd, bytes, sizeof bytes) != (ssize_t)sizeof bytes)
    return answer_of(MHD_HTTP_SERVICE_UNAVAILABLE, "the run accepts no commands at the moment\n");
  return answer_of(MHD_HTTP_OK, "asked\n");
}

pv_answer pv_scan_post(pv_source *s, const char *url) {
  static const char *const names[] = {"delete", "restore", "purge"};
  pv_scans_ask ask = {0};
  const char *name;
  if (!read_url(url, &ask.number, &name)) return answer_of(MHD_HTTP_NOT_FOUND, "no such page\n");
  for (int k = 0; sv_linux_export_format(k); k++)
    if (!strcmp(name, sv_linux_export_format(k))) return ask_export(s, ask.number, k);
  uint32_t i = 0;
  while (i < 3 && strcmp(name, names[i]) != 0) i++;
  if (i == 3) return answer_of(MHD_HTTP_NOT_FOUND, "no such page\n");
  ask.op = PV_SCANS_DELETE + i;
  (void)pv_state_read(s);
  if (ask.op == PV_SCANS_DELETE && may_be_written(s, ask.number))
    return answer_of(MHD_HTTP_CONFLICT, "this scan is running: it can be deleted when it is done\n");
  if (pv_scans_request(&s->scans, ask, NULL) != SV_OK) return failed(EIO);
  return s->scans.answer.error ? failed(s->scans.answer.error) : answer_of(MHD_HTTP_OK, "done\n");
}
#endif
