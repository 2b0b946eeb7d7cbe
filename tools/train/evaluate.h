// SPDX-License-Identifier: Apache-2.0
// Rendering a model for looking and for scoring: a renderer without gradients in a block of its
// own.
#ifndef SV_TOOLS_TRAIN_EVALUATE_H
#define SV_TOOLS_TRAIN_EVALUATE_H

#include "tools/lab/lab.h"
#include "tools/common/report.h"

typedef struct {
  sv_renderer r;
  void *block;
} lab_viewer;

sv_status lab_viewer_start(lab_viewer *v, const lab_session *s, sv_renderer_cfg cfg, sv_err *err) SV_MUST_USE;
void lab_viewer_stop(lab_viewer *v);

// A view that was scored. Images are [3][height][width], 0 to 1, over the background.
typedef struct {
  int i_view; // in lab_views.frames
  double psnr, ssim;
  const float *truth, *image;
} lab_scored_view;

typedef struct {
  lab_session *session;
  sv_gaussians *g;
  lab_motion motion;        // takes g to each view's time
  sv_render_options render; // has_depth: compare depth, too
  // NULL, or where n_panels images "truth | render" (with masks: "| seen") go
  const char *panel_folder;
  int n_panels;
  // NULL, or called with each view, one after another, in the order of lab_views.by_lens. `of` is
  // its first argument.
  void (*on_view)(void *of, const lab_scored_view *v);
  void *of;
  bool has_lpips;
  const char *lpips_vgg; // file of weights: LPIPS with VGG16 instead of SqueezeNet; NULL: none
  // Each view's pose is refined against the model before it is scored, for models whose training
  // moved the poses: their world is not quite that of the held-out ones (as Lin et al. 2021, BARF).
  bool is_aligned;
  const lab_source *mask_from; // NULL, or the training views: also scores what these have seen
  bool is_by_support;          // with mask_from: what they pin down instead (support_mask.h)
  // [n_shared] with mask_from: training views of other devices. Also scores what those of every
  // device have seen, which are the same pixels for each of the devices.
  const lab_source *shared_with;
  int n_shared;
} lab_eval_job;

#define LAB_CAP_SHARED 16

// Over the co-visible pixels: the authors' form, in which the support is a device's own training
// views, and one mask for all devices of a comparison.
enum { LAB_MASK_OWN, LAB_MASK_SHARED, LAB_N_MASKS };
typedef struct {
  double psnr, ssim, lpips; // means over the n views in which a pixel was seen
  double coverage;          // mean share of the pixels that were seen, over all views
  int n;
} lab_masked_scores;

typedef struct {
  double psnr, ssim;    // means over the views
  double abs_rel, rmse; // means over the n_depth views that have a pixel to compare
  int n, n_depth;
  double lpips; // mean over the views; with has_lpips
  lab_masked_scores masked[LAB_N_MASKS];
  int n_masks; // of those that were wanted
  // views with a mask of their own; scores are over the pixels that count
  int n_with_mask;
  double counted;             // mean share of those
  bool is_aligned;            // poses were refined before the views were scored
  double turned_deg, shifted; // means by which they moved; units of the scene
  bool has_lpips, is_vgg;     // is_vgg: LPIPS is that of VGG16
  const char *covisible_by;   // "depth", "flow", or "support"; NULL without masks
  bool is_by_support;
  double load_s, render_s, compare_s;
} lab_scores;

// Scores all views of v, a few at a time, on all threads; the result does not depend on their
// number. Truth is laid over the same background. Depth: expected depth against the file's, on
// pixels whose alpha and its 3x3 neighbors' is at least 250/255, true depth above 0.01 and rendered
// alpha above 1e-4. Stops with E_INTERRUPTED when a stop is requested.
sv_status lab_evaluate(const lab_views *v, const lab_eval_job *job, lab_scores *out, sv_err *err) SV_MUST_USE;

// n_wanted views spread evenly over n_views: which of them view i is, -1 for none.
int lab_panel_of(int i, int n_views, int n_wanted);

// The scores as keys of the report, and as a part of a printed line.
void lab_scores_report(lab_report *j, const lab_scores *s);
void lab_scores_print(const lab_scores *s);
// Those of held-out times: keys with "time_" before them.
void lab_time_scores_report(lab_report *j, const lab_scores *s);

// Planes of an image -> interleaved RGB bytes, clamped and rounded.
uint8_t lab_to_byte(float x);
void lab_to_bytes(const sv_planes *p, uint8_t *rgb);

#endif
