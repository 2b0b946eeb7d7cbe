// SPDX-License-Identifier: Apache-2.0
// A run's result.json: settings and figures, and as its last key a hash of all bytes before that
// key, so that a file that was cut or changed is told from one that this program wrote.
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "src/base/str.h"
#include "src/format/json.h"
#include "tools/common/report.h"
#include "tools/tables/tables.h"

#define CHECK_KEY "\"check\": \""

static const char *const keys[TABLES_N_FIGURES] = {"psnr", "ssim", "lpips_squeeze", "abs_rel", "rmse"};

// --- reading -------------------------------------------------------------------------------------

typedef struct {
  sv_json j;
  jsmntok_t *tok;
} document;

static sv_status parse(document *d, const char *name, const char *text, size_t bytes, sv_err *err) {
  int n_tok;
  d->tok = NULL;
  sv_status s = sv_json_count(name, text, bytes, &n_tok, err);
  if (s != SV_OK) return s;
  d->tok = malloc(((size_t)n_tok + 1) * sizeof *d->tok);
  if (!d->tok) return sv_fail(err, SV_E_NOMEM, "%s: no memory for its JSON tokens", name);
  return sv_json_parse(&d->j, &(sv_file_data){name, text, bytes}, d->tok, n_tok, err);
}

static sv_status need_number(const sv_json *j, int i, const char *key, double *out, sv_err *err) {
  sv_status s = sv_json_get_double(j, i, key, out, err);
  return s == SV_END ? sv_json_missing(j, i, key, err) : s;
}

static sv_status need_text(const sv_json *j, int i, const char *key, char *out, size_t cap, sv_err *err) {
  sv_status s = sv_json_get_string(j, i, key, out, cap, err);
  return s == SV_END ? sv_json_missing(j, i, key, err) : s;
}

static sv_status get_figures(const sv_json *j, int i, tables_figures *f, sv_err *err) {
  for (int k = 0; k < TABLES_N_FIGURES; k++) {
    f->of[k] = NAN;
    sv_status s = sv_json_get_double(j, i, keys[k], &f->of[k], err);
    if (s == SV_END && k <= TABLES_SSIM) s = sv_json_missing(j, i, keys[k], err);
    if (s < 0) return s;
  }
  return SV_OK;
}

static sv_status get_training(const sv_json *j, int i, tables_result *r, sv_err *err) {
  double steps = 0, gaussians = 0, threads = 0;
  sv_status s = need_number(j, i, "steps", &steps, err);
  if (s == SV_OK) s = need_number(j, i, "gaussians", &gaussians, err);
  if (s == SV_OK) s = need_number(j, i, "seconds", &r->seconds, err);
  if (s == SV_OK) s = need_number(j, i, "threads", &threads, err);
  if (s == SV_OK) s = need_number(j, i, "arena_bytes", &r->arena_bytes, err);
  if (s == SV_OK) s = need_number(j, i, "peak_rss_bytes", &r->peak_rss_bytes, err);
  if (s == SV_OK) s = need_text(j, i, "isa", r->isa, sizeof r->isa, err);
  if (s == SV_OK) s = need_text(j, i, "digest", r->digest, sizeof r->digest, err);
  r->steps = (long)steps;
  r->gaussians = (long)gaussians;
  r->threads = (int)threads;
  return s;
}

sv_status tables_result_train(tables_result *r, const char *text, sv_err *err) {
  document d;
  sv_status s = parse(&d, "what train printed", text, strlen(text), err);
  if (s == SV_OK) s = get_training(&d.j, 0, r, err);
  free(d.tok);
  return s;
}

sv_status tables_result_eval(tables_figures *f, const char *text, sv_err *err) {
  document d;
  sv_status s = parse(&d, "what eval printed", text, strlen(text), err);
  if (s == SV_OK) s = get_figures(&d.j, 0, f, err);
  free(d.tok);
  return s;
}

static sv_status get_scores(const sv_json *j, tables_run *r, sv_err *err) {
  bool has[TABLES_N_SPLITS] = {false};
  int list = sv_json_get(j, 0, "scores");
  for (int i = sv_json_first(j, list); i >= 0; i = sv_json_next(j, i)) {
    char split[32];
    sv_status s = need_text(j, i, "split", split, sizeof split, err);
    for (int k = 0; k < TABLES_N_SPLITS && s == SV_OK; k++)
      if (sv_str_eq(split, tables_split_names[k])) {
        s = get_figures(j, i, &r->result.score[k], err);
        has[k] = true;
      }
    if (s != SV_OK) return s;
  }
  for (int k = 0; k < TABLES_N_SPLITS; k++)
    if (r->needs[k] && !has[k])
      return sv_fail(err, SV_E_FORMAT, "%s: has no scores for the split %s", j->name, tables_split_names[k]);
  return SV_OK;
}

static sv_status get_result(const sv_json *j, tables_run *r, sv_err *err) {
  char settings[TABLES_CAP_SETTINGS];
  sv_status s = need_text(j, 0, "settings", settings, sizeof settings, err);
  if (s == SV_OK && !sv_str_eq(settings, r->settings))
    return sv_fail(err, SV_E_FORMAT, "%s: is the result of another run", j->name);
  if (s == SV_OK) s = need_text(j, 0, "build", r->result.build, sizeof r->result.build, err);
  if (s == SV_OK) s = need_number(j, 0, "wall_seconds", &r->result.wall_s, err);
  if (s == SV_OK) s = get_training(j, 0, &r->result, err);
  return s == SV_OK ? get_scores(j, r, err) : s;
}

// The hash at the end against the bytes before it.
static bool is_whole(const char *text, size_t bytes) {
  static const char key[] = CHECK_KEY;
  size_t n = sizeof key - 1;
  for (size_t at = bytes; at-- > 0;) {
    if (bytes - at < n + 16 || memcmp(text + at, key, n) != 0) continue;
    char said[17];
    memcpy(said, text + at + n, 16);
    said[16] = 0;
    return strtoull(said, NULL, 16) == tables_hash(TABLES_HASH, text, at);
  }
  return false;
}

sv_status tables_result_read(tables_run *r, const char *path, sv_err *err) {
  void *text;
  size_t bytes;
  document d = {.tok = NULL};
  if (!sv_path_exists(path)) return sv_fail(err, SV_E_NOT_FOUND, "%s: no such result", path);
  sv_status s = sv_file_read(path, &text, &bytes, err);
  if (s != SV_OK) return s;
  if (!is_whole(text, bytes)) s = sv_fail(err, SV_E_FORMAT, "%s: is damaged", path);
  if (s == SV_OK) s = parse(&d, path, text, bytes, err);
  if (s == SV_OK) s = get_result(&d.j, r, err);
  free(d.tok);
  free(text);
  return s;
}

// --- writing -------------------------------------------------------------------------------------

static void put_scores(lab_report *j, const tables_run *r) {
  lab_report_array(j, "scores");
  for (int k = 0; k < TABLES_N_SPLITS; k++) {
    if (!r->needs[k]) continue;
    lab_report_item_begin(j);
    lab_report_text(j, "split", tables_split_names[k]);
    for (int f = 0; f < TABLES_N_FIGURES; f++) lab_report_num(j, keys[f], r->result.score[k].of[f]);
    lab_report_item_end(j);
  }
  lab_report_array_end(j);
}

sv_status tables_result_write(const tables_run *r, const char *path, sv_err *err) {
  const tables_result *v = &r->result;
  lab_report j;
  lab_report_begin(&j);
  lab_report_text(&j, "settings", r->settings);
  lab_report_text(&j, "build", v->build);
  put_scores(&j, r);
  lab_report_int(&j, "steps", v->steps);
  lab_report_int(&j, "gaussians", v->gaussians);
  lab_report_num(&j, "seconds", v->seconds);
  lab_report_num(&j, "wall_seconds", v->wall_s);
  lab_report_int(&j, "threads", v->threads);
  lab_report_text(&j, "isa", v->isa);
  lab_report_int(&j, "arena_bytes", (long long)v->arena_bytes);
  lab_report_int(&j, "peak_rss_bytes", (long long)v->peak_rss_bytes);
  lab_report_text(&j, "digest", v->digest);
  if (!j.is_failed) // what stands before the key, with the comma that comes with it
    lab_report_hex(&j, "check", tables_hash(tables_hash(TABLES_HASH, j.text, j.bytes), ", ", 2));
  lab_report_end(&j);
  return lab_report_save(&j, path, err);
}
