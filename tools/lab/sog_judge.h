// SPDX-License-Identifier: Apache-2.0
// What quantization costs in rendered images: PSNR of a quantized model against the model itself.
// Owns a renderer and the images of the model. Reads no files.
#ifndef SV_TOOLS_LAB_SOG_JUDGE_H
#define SV_TOOLS_LAB_SOG_JUDGE_H

#include "tools/train/evaluate.h"

#define SOG_CAP_VIEWS 8

typedef struct {
  lab_session *session;
  sv_view view[SOG_CAP_VIEWS]; // all of one size
  int n_views;
  sv_render_options render;
  double target_db; // PSNR against the model from which on the loss is not visible
  lab_viewer viewer;
  float *image; // [n_views][3][height][width] of the model, 0 to 1
} sog_judge;

// Renders g in the views. Everything before `viewer` is filled in by the caller, who stops it, also
// after a failure.
sv_status sog_judge_start(sog_judge *j, const sv_gaussians *g, sv_err *err) SV_MUST_USE;
void sog_judge_stop(sog_judge *j);
// *psnr over all pixels of all views, dB.
sv_status sog_judge_ask(sog_judge *j, const sv_gaussians *quantized, double *psnr, sv_err *err) SV_MUST_USE;

#endif
