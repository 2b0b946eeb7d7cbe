// SPDX-License-Identifier: Apache-2.0
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "src/base/str.h"
#include "src/format/ply.h"
#include "tools/import/depth_camera.h"
#include "tools/import/recording.h"
#include "tools/import/import.h"
#include "tools/import/network.h"
#include "tools/import/refine.h"

// --- dispatch ------------------------------------------------------------------------------------

// The scale of poses that were given for one camera of the rig, where the user does not tell it.
static sv_status find_scale(lab_import *im, const lab_options *o, const lab_matches *m, lab_session *se,
                            sv_err *err) {
  lab_scale scale;
  int i_stream = -1;
  for (int i = 0; i < im->n; i++)
    if (sv_str_eq(im->views[i].camera, o->stream)) i_stream = im->views[i].sub_view;
  sv_status s = lab_scale_find(&scale, im, m, i_stream, err);
  if (s != SV_OK) return s;
  lab_scale_apply(im, i_stream, scale.unit_m);
  im->unit = (sv_unit){.is_metric = true, .scale_sigma = (float)scale.sigma};
  lab_say(se, "one unit of %s's poses is %.6g m (+- %.2g %%), by %d matches between the rig's cameras",
          o->stream, scale.unit_m, 100 * scale.sigma, scale.n_points);
  return SV_OK;
}

static sv_status refine(lab_import *im, const lab_options *o, const lab_matches *m, lab_session *se,
                        sv_err *err) {
  lab_refined r;
  const lab_refine_options how = {.is_rig = sv_str_eq(o->refine, "rig"),
                                  .is_rig_known = o->rig != NULL || im->is_rig_known,
                                  .free_lenses = o->free_lenses};
  sv_status s = lab_import_refine(im, m, &how, &r, err);
  if (s != SV_OK) return s;
  if (r.is_kept) {
    lab_say(se, "the poses are left as they are: they explain %d observations of %d points to %.2f px",
            r.n_obs, r.n_points, r.rms_before_px);
    return SV_OK;
  }
  lab_say(se,
          "%d of %d views refined: %d points, %d observations, %.2f px before, %.2f px now; moved by %.3f "
          "degrees and %.4g units in the mean",
          r.n_placed, im->n, r.n_points, r.n_obs, r.rms_before_px, r.rms_px, r.moved_deg, r.moved);
  if (r.n_parts > 1)
    lab_say(se, "the views fall into %d parts that share no points; each stays where it was as a whole",
            r.n_parts);
  return SV_OK;
}

// From the poses of one camera to those of its rig, and what the pictures tell about them.
static sv_status improve(lab_import *im, const lab_options *o, lab_session *se, sv_err *err) {
  lab_matches m = {0};
  sv_status s = SV_OK;
  const double unit_m = o->unit_m > 0 ? o->unit_m : 1;
  const bool is_scale_found = o->rig && !(o->unit_m > 0) && lab_has_matcher();
  if (o->rig) s = lab_import_propagate(im, o->rig, o->stream, unit_m, err);
  if (s == SV_OK && o->rig && !is_scale_found)
    lab_say(se, "assuming that one unit of %s's poses is %.6g m (override with --unit)", o->stream, unit_m);
  if (s == SV_OK && (is_scale_found || o->refine)) s = lab_matches_find(&m, im, se, err);
  if (s == SV_OK && is_scale_found) s = find_scale(im, o, &m, se, err);
  if (s == SV_OK && o->refine) s = refine(im, o, &m, se, err);
  lab_matches_free(&m);
  return s;
}

static bool is_network(const lab_options *o) {
  return sv_str_eq(o->from, "vggt") || sv_str_eq(o->from, "megasam") || sv_str_eq(o->from, "dust3r");
}

static sv_status import(const lab_options *o, lab_session *se, sv_err *err) {
  if (sv_str_eq(o->from, "sim")) {
    sv_status s = lab_import_sim(o->input, se, o->out, err);
    if (s == SV_OK)
      lab_say(se, "%s: simulated images of %s, with held-out views and depth", o->out,
              strstr(o->input, ",rig=") ? "one rig" : "several devices");
    return s;
  }
  if (sv_str_eq(o->from, "kalibr")) {
    int n = 0;
    sv_status s = lab_import_kalibr(o->input, o->out, &n, err);
    if (s == SV_OK) lab_say(se, "%s: a rig of %d cameras; 'subview run --rig' reads it", o->out, n);
    return s;
  }
  if (sv_str_eq(o->from, "rosbag")) return lab_import_rosbag(o, se, err);
  if (sv_str_eq(o->from, "spatial")) return lab_import_spatial(o, se, err);
  if (!sv_path_is_folder(o->input) && !is_network(o))
    return sv_fail(err, SV_E_NOT_FOUND, "%s: no such folder", o->input);
  if (sv_str_eq(o->from, "4cam-board") || sv_str_eq(o->from, "qca")) {
    sv_import_job job = {o->input, o->out, se->console};
    sv_status s = sv_str_eq(o->from, "qca") ? sv_import_qca(&job, err) : sv_import_4cam_board(&job, err);
    if (s == SV_OK)
      lab_say(se,
              "%s: a capture folder with its rig; 'subview-lab import --from capture' or a replay reads it",
              o->out);
    return s;
  }
  if (sv_str_eq(o->from, "multicam")) return lab_import_multicam(o, se, err);
  if (sv_str_eq(o->from, "realsense")) return lab_import_realsense(o, se, err);
  if (sv_str_eq(o->from, "oak")) return lab_import_oak(o, se, err);
  if (sv_str_eq(o->from, "lightfield-release")) return lab_import_release(o, se, err);
  lab_import im = {0};
  sv_status s = sv_str_eq(o->from, "vggt")      ? lab_import_vggt(&im, o, err)
                : sv_str_eq(o->from, "megasam") ? lab_import_megasam(&im, o, err)
                : sv_str_eq(o->from, "dust3r")  ? lab_import_dust3r(&im, o, err)
                : sv_str_eq(o->from, "colmap")  ? lab_import_colmap(&im, o->input, err)
                : sv_str_eq(o->from, "lenslet") || sv_str_eq(o->from, "lytro")
                    ? lab_import_lenslet(&im, o, se, err)
                : sv_str_eq(o->from, "capture") ? lab_import_capture(&im, o->input, NULL, se, err)
                                                : lab_import_transforms(&im, o->input, err);
  if (s == SV_OK && im.n == 0) s = sv_fail(err, SV_E_NOT_FOUND, "%s: contains no views", o->input);
  if (s == SV_OK) s = improve(&im, o, se, err);
  if (s == SV_OK) s = lab_import_write(&im, se, o->out, err);
  if (s == SV_OK) lab_say(se, "%s: %d views, %d points", o->out, im.n, im.n_points);
  if (s == SV_OK && im.n_from_rig) lab_say(se, "%d views take their pose from the rig", im.n_from_rig);
  if (s == SV_OK && im.n_lost) lab_say(se, "%d images of the rig were not found", im.n_lost);
  lab_import_free(&im);
  return s;
}

int lab_cmd_import(const lab_options *o) {
  sv_err err = {0};
  lab_session se;
  int code = LAB_EXIT_OK;
  bool has_stream = sv_str_eq(o->from, "colmap") || sv_str_eq(o->from, "nerfstudio") ||
                    sv_str_eq(o->from, "blender") || is_network(o);
  const bool is_multicam = sv_str_eq(o->from, "multicam"), is_bag = sv_str_eq(o->from, "rosbag"),
             is_real = sv_str_eq(o->from, "realsense");
  const bool is_recording =
      is_multicam || is_bag || is_real || sv_str_eq(o->from, "spatial") || sv_str_eq(o->from, "oak");
  if ((o->clock && !is_multicam) || (o->every_s > 0 && !is_recording))
    return lab_usage("import",
                     "--clock needs --from multicam, --every multicam, spatial, realsense, oak or rosbag");
  if (is_multicam || is_bag ? o->stream != NULL : !o->rig != !o->stream)
    return lab_usage("import", "--rig and --stream must be given together");
  if (o->unit_m > 0 && !o->stream && !is_real)
    return lab_usage("import", "--unit needs --rig and --stream, or --from realsense");
  if (o->rig && !has_stream && !is_multicam && !is_bag)
    return lab_usage("import",
                     "--rig and --stream need --from colmap, nerfstudio, blender, vggt, megasam or dust3r");
  if (o->images && !is_network(o))
    return lab_usage("import", "--images needs --from vggt, megasam or dust3r");
  if (o->refine && !has_stream && !sv_str_eq(o->from, "capture"))
    return lab_usage("import",
                     "--refine needs --from colmap, nerfstudio, blender, capture, vggt, megasam or dust3r");
  if (o->free_lenses && !o->refine) return lab_usage("import", "--free-lenses needs --refine");
  sv_status s = lab_session_start(&se, 0, o->is_quiet, &err);
  if (s == SV_OK) s = sv_linux_catch_signals(&err);
  if (s == SV_OK) s = import(o, &se, &err);
  if (s == SV_E_INTERRUPTED)
    s = sv_fail(&err, s, "stopped by request: %s is incomplete; run the same command again", o->out);
  if (s != SV_OK) code = lab_failed(&se, &err);
  lab_session_stop(&se);
  return code;
}
