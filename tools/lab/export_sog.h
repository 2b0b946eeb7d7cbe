// SPDX-License-Identifier: Apache-2.0
// SOG, PlayCanvas's compressed Gaussians (developer.playcanvas.com, "The SOG format", version 2):
// meta.json and lossless WebP images, in one .sog (a ZIP without compression) or beside meta.json.
//
// Steps are 2^k times the finest, with the largest k whose loss in rendered images is not visible;
// with views, those of a Gaussian are 1, 2, 4 or 8 times these, by how much it colors. The finest:
//   position   sign(x) ln(1 + |x|) in 16 bits of its range, by axis; steps of up to 0.125 of the
//              Gaussian's smallest standard deviation, by powers of two
//   log-scale  1/32, of a range of 8; else 1/16
//   color      1/64 of the DC coefficient, where all are below 2
//   rotation   x, y, z in steps of 1 of 255
//   opacity    sigmoid in 8 bits
//   SH         a palette: up to 8192 sets of coefficients by k-means, and sets of single Gaussians
//              where these save more than finer steps would
#ifndef SV_TOOLS_LAB_EXPORT_SOG_H
#define SV_TOOLS_LAB_EXPORT_SOG_H

#include "tools/lab/sog_judge.h"

// What training views see of a model: how much of their pixels each Gaussian colors.
typedef struct {
  int n_views;
  const float *weight; // [n_views][n] sum of alpha times transmittance over the pixels of a view
  double (*eye)[3];    // [n_views] places of the cameras, in the model's axes
} lab_seen;

// path: NAME.sog, or DIR/meta.json (images beside it). The model's up must be SV_UP_DEFAULT, which
// readers expect. seen: NULL, or the views that colors are kept best for. judge: not started; has
// views in the model's axes. E_UNSUPPORTED in a build without libwebp.
sv_status lab_write_sog(const sv_gaussians *g, const sv_model_notes *notes, const lab_seen *seen,
                        sog_judge *judge, const char *path, sv_err *err) SV_MUST_USE;

#endif
