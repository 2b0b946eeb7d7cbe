// SPDX-License-Identifier: Apache-2.0
// subview-calibrate photometric: what the cameras of a rig make of the same light.
#include <stdlib.h>
#include <string.h>

#include "calib/solve/corners.h"
#include "src/base/str.h"
#include "tools/calibrate/photometry.h"
#include "tools/common/fileio.h"

#define BLOCK_BYTES ((size_t)64 << 20)
#define UNEVEN      0.03
#define UNCERTAIN   0.1 // of the light at the corner

typedef struct {
  sv_arena arena, scratch;
  sv_rig rig;
  sv_coverage_names names;
  cal_boards boards;
  cal_squares squares;
  cal_advice advice;
  cal_photometry found[SV_CAP_SUB_VIEWS];
} job;

static sv_status read_rig(job *j, const cal_options *o, sv_err *err) {
  sv_file_reader files = {(void *)(uintptr_t)o->rig, sv_folder_read};
  if (sv_rig_init(&j->rig, SV_CAP_SUB_VIEWS, &j->arena) < 0)
    return sv_fail(err, SV_E_NOMEM, "%s: no memory for the rig", o->rig);
  sv_status s = sv_rig_read_coverage(&j->rig, &j->names, &files, -1, &j->scratch, err);
  if (s == SV_OK && j->rig.forward == SV_FORWARD_MULTIPLEXED)
    s = sv_fail(err, SV_E_UNSUPPORTED,
                "%s: the sub-views share their pixels; 'subview-calibrate lenslets' measures what each lens "
                "lights",
                o->rig);
  return s;
}

static int n_cameras(const sv_rig *rig) {
  int n = 0;
  for (int i = 0; i < rig->n_sub_views; i++)
    if (rig->sub_views[i].i_camera >= n) n = rig->sub_views[i].i_camera + 1;
  return n;
}

static sv_status from_white(job *j, const cal_options *o, sv_err *err) {
  cal_options with = *o;
  with.images = o->whites;
  if (o->whites.n != n_cameras(&j->rig))
    return sv_fail(err, SV_E_ARG, "%s has %d cameras, --white names %d: expected one per camera", o->rig,
                   n_cameras(&j->rig), o->whites.n);
  sv_status s = cal_boards_list(&j->boards, &with, err);
  return s == SV_OK ? cal_white_solve(&j->rig, &j->boards, j->found, err) : s;
}

static sv_status from_boards(job *j, const cal_options *o, lab_session *se, sv_err *err) {
  if (o->images.n != j->rig.n_sub_views)
    return sv_fail(
        err, SV_E_ARG,
        "%s has %d sub-views, --images names %d cameras: expected one per sub-view, in the rig's order",
        o->rig, j->rig.n_sub_views, o->images.n);
  sv_status s = sv_corners_available(o->n_cols, o->n_rows, err);
  if (s == SV_OK) s = cal_boards_list(&j->boards, o, err);
  if (s == SV_OK) s = cal_boards_find(&j->boards, se, NULL, err);
  for (int i = 0; i < j->boards.n_cameras && s == SV_OK; i++) {
    const sv_camera_model *m = &j->rig.sub_views[i].model;
    if (j->boards.size_px[i][0] != m->width_px || j->boards.size_px[i][1] != m->height_px)
      s = sv_fail(err, SV_E_FORMAT, "%s: images of %dx%d pixels, but the rig's %s is for %dx%d",
                  o->images.of[i], j->boards.size_px[i][0], j->boards.size_px[i][1], j->rig.sub_views[i].name,
                  m->width_px, m->height_px);
  }
  if (s == SV_OK) s = cal_squares_read(&j->squares, &j->rig, &j->boards, err);
  if (s != SV_OK || (s = cal_squares_solve(&j->squares, &j->rig, j->found, err)) != SV_OK) return s;
  if (j->found[0].found.falloff_sigma >= 1)
    cal_advise(
        &j->advice,
        "the boards do not tell the lenses' falloff, which is taken as none: hold them in all corners of "
        "the images, or use --white");
  return s;
}

static sv_status from_run(job *j, const cal_options *o, sv_err *err) {
  sv_status s = cal_scene_read(o->run, &j->rig, j->found, err);
  for (int i = 0; i < j->rig.n_sub_views && s == SV_OK; i++)
    if (j->found[i].found.falloff_sigma > UNCERTAIN)
      cal_advise(&j->advice,
                 "%s: the scene hardly tells the lens's falloff (+- %.0f %% at the corner): let textured "
                 "surfaces fill the images, in more exposures, or use --white",
                 j->rig.sub_views[i].name, 100 * j->found[i].found.falloff_sigma);
  return s;
}

// Cameras of a rig that was calibrated before may have had exposure times by that: the calibration
// is for equal ones.
static void take_exposures_back(job *j, const cal_options *o) {
  for (int i = 1; i < j->rig.n_sub_views; i++) {
    const double share = cal_exposure_share(&j->boards, o->whites.n ? j->rig.sub_views[i].i_camera : i);
    for (int k = 0; k < 9; k++) j->found[i].found.color[k] /= share;
  }
}

static sv_status solve(job *j, const cal_options *o, lab_session *se, sv_err *err) {
  if (o->run) return from_run(j, o, err);
  sv_status s = o->whites.n ? from_white(j, o, err) : from_boards(j, o, se, err);
  if (s == SV_OK) take_exposures_back(j, o);
  return s;
}

// --- what is told --------------------------------------------------------------------------------

// The color's terms off the diagonal, row by row.
static void report_mixing(lab_report *r, const sv_photometry *p) {
  static const char *const names[] = {"mix_rg", "mix_rb", "mix_gr", "mix_gb", "mix_br", "mix_bg"};
  if (!(p->mix_sigma > 0)) return;
  for (int i = 0, k = 0; i < 9; i++)
    if (i % 4) lab_report_num(r, names[k++], p->color[i]);
  lab_report_num(r, "mix_sigma", p->mix_sigma);
}

static void report(lab_report *r, const job *j) {
  lab_report_begin(r);
  lab_report_array(r, "cameras");
  for (int i = 0; i < j->rig.n_sub_views; i++) {
    const sv_photometry *p = &j->found[i].found;
    static const char *const gains[] = {"gain_r", "gain_g", "gain_b"};
    static const char *const sigmas[] = {"sigma_r", "sigma_g", "sigma_b"};
    lab_report_item_begin(r);
    lab_report_text(r, "name", j->rig.sub_views[i].name);
    for (int k = 0; k < 3; k++) lab_report_num(r, gains[k], p->color[4 * k]);
    for (int k = 0; k < 3; k++) lab_report_num(r, sigmas[k], p->color_sigma[k]);
    report_mixing(r, p);
    lab_report_num(r, "corner_light", sv_photometry_falloff(p, 1));
    lab_report_num(r, "corner_sigma", p->falloff_sigma);
    lab_report_int(r, "pictures", j->found[i].n_pictures);
    lab_report_num(r, "rms", j->found[i].rms);
    lab_report_item_end(r);
  }
  lab_report_array_end(r);
  cal_report_warnings(r, &j->advice);
  lab_report_end(r);
}

static void say(lab_session *se, const job *j) {
  for (int i = 0; i < j->rig.n_sub_views; i++) {
    const sv_photometry *p = &j->found[i].found;
    lab_say(
        se,
        "  %s: gains %.4f %.4f %.4f (+- %.2f %%), %.1f %% of the light at the corner (+- %.1f); %d pictures",
        j->rig.sub_views[i].name, p->color[0], p->color[4], p->color[8], 100 * p->color_sigma[1],
        100 * sv_photometry_falloff(p, 1), 100 * p->falloff_sigma, j->found[i].n_pictures);
  }
  for (int i = 0; i < j->advice.n; i++) se->console.log(se->console.self, SV_LOG_WARN, j->advice.text[i]);
}

static void advise(job *j) {
  for (int i = 0; i < j->rig.n_sub_views; i++)
    if (j->found[i].rms > UNEVEN)
      cal_advise(&j->advice,
                 "%s: the light differs by %.1f %% RMS from what a lens and even light give: is the surface "
                 "evenly lit, without shadows or texture?",
                 j->rig.sub_views[i].name, 100 * j->found[i].rms);
}

static sv_status calibrate(job *j, const cal_options *o, lab_session *se, sv_err *err) {
  sv_status s = read_rig(j, o, err);
  if (s == SV_OK) s = solve(j, o, se, err);
  if (s == SV_OK) s = cal_stopped(se, NULL, err);
  if (s != SV_OK) return s;
  for (int i = 0; i < j->rig.n_sub_views; i++) j->rig.sub_views[i].photometric = j->found[i].found;
  advise(j);
  say(se, j);
  if ((s = cal_rig_update(o->rig, &j->rig, &j->names, err)) != SV_OK) return s;
  lab_say(se, "written: %s/rig.json", o->rig);
  if (!o->is_json) return SV_OK;
  lab_report r = {0};
  report(&r, j);
  return lab_report_print(&r, err);
}

static sv_status run(void *memory, const cal_frame *frame, sv_err *err) {
  job *j = memory;
  j->arena = frame->arena;
  j->scratch = frame->scratch;
  sv_status s = calibrate(j, frame->options, frame->session, err);
  cal_boards_free(&j->boards);
  cal_squares_free(&j->squares);
  return s;
}

int cal_cmd_photometric(const cal_options *o) {
  if ((o->whites.n > 0) + (o->images.n > 0) + (o->run != NULL) != 1)
    return cal_usage("photometric", "one of --white, --images and --run is needed");
  if ((o->images.n > 0) != (o->board != NULL))
    return cal_usage("photometric", "--images and --board must be given together");
  return cal_frame_run(o, sizeof(job), BLOCK_BYTES, run);
}
