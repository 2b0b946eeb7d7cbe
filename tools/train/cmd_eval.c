// SPDX-License-Identifier: Apache-2.0
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "src/base/str.h"
#include "tools/train/evaluate.h"
#include "tools/lab/model_formats.h"

typedef struct {
  double psnr, ssim;
} view_scores;

typedef struct {
  const lab_options *o;
  lab_session session;
  lab_model model;
  lab_views views;
  lab_settings settings;
  const char *split;
  lab_scores scores;
  view_scores *of_view; // [views.n]
  double seconds;
} run;

static void keep_view(void *of, const lab_scored_view *v) {
  ((view_scores *)of)[v->i_view] = (view_scores){v->psnr, v->ssim};
}

// FILE[,FILE...]
static sv_status list_others(const char *text, char (*names)[SV_TRANSFORMS_CAP_PATH], int *n, sv_err *err) {
  for (const char *p = text; p; p++) {
    const size_t len = strcspn(p, ",");
    if (!len || len >= sizeof *names || *n == LAB_CAP_SHARED)
      return sv_fail(err, SV_E_ARG, "--mask-with %.80s: expected 1 to %d names, with commas between them",
                     text, LAB_CAP_SHARED);
    memcpy(names[*n], p, len);
    names[(*n)++][len] = 0;
    p += len;
    if (!*p) break;
  }
  return SV_OK;
}

static sv_status evaluate(run *r, sv_err *err) {
  sv_status s = lab_model_read(&r->model, r->o->model, err);
  if (s == SV_OK) s = lab_settings_for(&r->settings, r->o, &r->model, err);
  if (s != SV_OK) return s;
  r->split = r->o->split ? r->o->split : lab_default_split(r->settings.n_exposures);
  double t0 = lab_seconds(&r->session);
  lab_source src = {.folder = r->o->data,
                    .transforms = r->settings.transforms,
                    .told_by = r->settings.told_by,
                    .refined = r->settings.refined,
                    .split = r->split,
                    .camera = r->o->camera,
                    .n_exposures = sv_str_eq(r->split, "test_near") ? r->settings.n_exposures : 0,
                    .masks = r->o->masks,
                    .has_all_masks = true,
                    .scale = r->settings.scale};
  if ((s = lab_views_open(&r->views, &src, &r->session.pool, err)) != SV_OK) return s;
  lab_turn_back(&r->model, &r->session, r->o->model, r->o->up, &r->views);
  if (r->o->has_depth && !r->views.has_depth)
    return sv_fail(err, SV_E_NOT_FOUND, "%s/%s: not every view of the split %s has true depth (depth_path)",
                   r->o->data, r->views.transforms, src.split);
  lab_source train = {.folder = r->o->data,
                      .transforms = r->settings.transforms,
                      .told_by = r->settings.told_by,
                      .refined = r->settings.refined,
                      .n_exposures = r->settings.n_exposures,
                      .scale = r->settings.scale};
  static lab_source others[LAB_CAP_SHARED];
  static char names[LAB_CAP_SHARED][SV_TRANSFORMS_CAP_PATH];
  int n_others = 0;
  s = list_others(r->o->mask_with, names, &n_others, err);
  if (s != SV_OK) return s;
  for (int i = 0; i < n_others; i++) {
    others[i] = train;
    others[i].transforms = names[i];
    others[i].told_by = others[i].refined = NULL;
  }
  r->of_view = calloc((size_t)r->views.n, sizeof *r->of_view);
  if (!r->of_view) return sv_fail(err, SV_E_NOMEM, "no memory for the scores of %d views", r->views.n);
  lab_eval_job job = {.session = &r->session,
                      .on_view = keep_view,
                      .of = r->of_view,
                      .shared_with = others,
                      .n_shared = n_others,
                      .g = &r->model.g,
                      .motion = lab_model_motion(&r->model),
                      .has_lpips = r->o->has_lpips,
                      .lpips_vgg = r->o->lpips_vgg,
                      .is_aligned = r->o->is_refining,
                      .mask_from = r->o->mask ? &train : NULL,
                      .is_by_support = r->o->mask && sv_str_eq(r->o->mask, "supported"),
                      .render = lab_render_options(&r->settings, r->model.g.sh_degree, r->views.has_depth)};
  s = lab_evaluate(&r->views, &job, &r->scores, err);
  r->seconds = lab_seconds(&r->session) - t0;
  if (s == SV_OK && r->o->has_depth && r->scores.n_depth == 0)
    return sv_fail(err, SV_E_NOT_FOUND, "%s/%s: no pixel of its depth images can be compared (all empty?)",
                   r->o->data, r->views.transforms);
  return s;
}

static void print_views(const run *r) {
  char name[SV_CAP_PATH];
  for (int i = 0; i < r->views.n; i++) {
    lab_view_name(&r->views, i, name, sizeof name);
    printf("%-32s  %.2f dB, SSIM %.4f\n", name, r->of_view[i].psnr, r->of_view[i].ssim);
  }
}

static void report_views(lab_report *j, const run *r) {
  char name[SV_CAP_PATH];
  lab_report_array(j, "per_view");
  for (int i = 0; i < r->views.n; i++) {
    lab_view_name(&r->views, i, name, sizeof name);
    lab_report_item_begin(j);
    lab_report_text(j, "view", name);
    lab_report_num(j, "psnr", r->of_view[i].psnr);
    lab_report_num(j, "ssim", r->of_view[i].ssim);
    lab_report_item_end(j);
  }
  lab_report_array_end(j);
}

static sv_status print(const run *r, sv_err *err) {
  const lab_scores *sc = &r->scores;
  if (!r->o->is_json) {
    print_views(r);
    printf("%s views %d: ", r->split, sc->n);
    lab_scores_print(sc);
    printf("  (%.2f s: loading %.2f, rendering %.2f, comparing %.2f)\n", r->seconds, sc->load_s, sc->render_s,
           sc->compare_s);
    return SV_OK;
  }
  lab_report j;
  lab_report_begin(&j);
  lab_report_text(&j, "split", r->split);
  lab_scores_report(&j, sc);
  lab_report_int(&j, "gaussians", r->model.g.n);
  lab_report_num(&j, "seconds", r->seconds);
  lab_report_int(&j, "threads", r->session.n_threads);
  lab_report_text(&j, "isa", sv_isa_name(r->session.k.isa));
  lab_report_int(&j, "peak_rss_bytes", lab_peak_rss_bytes());
  lab_report_hex(&j, "digest", r->model.digest);
  report_views(&j, r);
  lab_report_end(&j);
  return lab_report_print(&j, err);
}

int lab_cmd_eval(const lab_options *o) {
  sv_err err = {0};
  run r = {.o = o};
  int code = LAB_EXIT_OK;
  sv_status s = lab_session_start(&r.session, o->threads, o->is_quiet, &err);
  if (s == SV_OK) s = sv_linux_catch_signals(&err);
  if (s == SV_OK) s = evaluate(&r, &err);
  sv_linux_console_finish(&r.session.lines);
  if (s == SV_OK) s = print(&r, &err);
  if (s != SV_OK) code = lab_failed(&r.session, &err);
  lab_session_stop(&r.session);
  lab_views_free(&r.views);
  lab_model_free(&r.model);
  free(r.of_view);
  return code;
}
