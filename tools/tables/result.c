// SPDX-License-Identifier: Apache-2.0
// What the commands of a run printed.
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "src/base/str.h"
#include "src/format/json.h"
#include "tools/tables/real.h"

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
  double steps = 0, gaussians = 0, threads = 0, load_s = 0;
  sv_status s = need_number(j, i, "steps", &steps, err);
  if (s == SV_OK) s = need_number(j, i, "gaussians", &gaussians, err);
  if (s == SV_OK) s = need_number(j, i, "seconds", &r->seconds, err);
  if (s == SV_OK) s = need_number(j, i, "load_seconds", &load_s, err);
  if (s == SV_OK) s = need_number(j, i, "threads", &threads, err);
  if (s == SV_OK) s = need_number(j, i, "arena_bytes", &r->arena_bytes, err);
  if (s == SV_OK) s = need_number(j, i, "peak_rss_bytes", &r->peak_rss_bytes, err);
  if (s == SV_OK) s = need_text(j, i, "isa", r->isa, sizeof r->isa, err);
  if (s == SV_OK) s = need_text(j, i, "digest", r->digest, sizeof r->digest, err);
  r->steps = (long)steps;
  r->gaussians = (long)gaussians;
  r->threads = (int)threads;
  r->wall_s = r->seconds + load_s;
  return s;
}

sv_status tables_result_masked(tables_masked m[TABLES_N_MASKS], const char *text, sv_err *err) {
  static const char *const masked[TABLES_N_MASKS][4] = {
      {"mask_coverage", "mpsnr", "mssim", "mlpips"},
      {"shared_coverage", "shared_psnr", "shared_ssim", "shared_lpips"}};
  document d;
  sv_status s = parse(&d, "what eval printed", text, strlen(text), err);
  for (int i = 0; i < TABLES_N_MASKS && s == SV_OK; i++) {
    s = need_number(&d.j, 0, masked[i][0], &m[i].coverage, err);
    for (int k = 0; k < 3 && s >= 0; k++) { // absent where no pixel was seen
      m[i].of[k] = NAN;
      s = sv_json_get_double(&d.j, 0, masked[i][1 + k], &m[i].of[k], err);
    }
    if (s == SV_END) s = SV_OK;
  }
  free(d.tok);
  return s;
}

sv_status tables_result_measured(double *psnr, const char *text, sv_err *err) {
  document d;
  sv_status s = parse(&d, "what train printed", text, strlen(text), err);
  if (s == SV_OK) s = need_number(&d.j, 0, "measurement_psnr", psnr, err);
  free(d.tok);
  return s;
}

sv_status tables_result_train(tables_result *r, const char *text, sv_err *err) {
  document d;
  sv_status s = parse(&d, "what train printed", text, strlen(text), err);
  if (s == SV_OK) s = get_training(&d.j, 0, r, err);
  free(d.tok);
  return s;
}

sv_status tables_result_eval(tables_figures *f, double *wall_s, const char *text, sv_err *err) {
  document d;
  double seconds = 0;
  sv_status s = parse(&d, "what eval printed", text, strlen(text), err);
  if (s == SV_OK) s = get_figures(&d.j, 0, f, err);
  if (s == SV_OK) s = need_number(&d.j, 0, "seconds", &seconds, err);
  *wall_s += seconds;
  free(d.tok);
  return s;
}

tables_result tables_no_result(void) {
  tables_result r = {.steps = 0};
  for (int k = 0; k < TABLES_N_SPLITS; k++)
    for (int f = 0; f < TABLES_N_FIGURES; f++) r.score[k].of[f] = NAN;
  return r;
}
