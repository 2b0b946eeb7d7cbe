// SPDX-License-Identifier: Apache-2.0
// SOG, PlayCanvas's compressed Gaussians (developer.playcanvas.com, "The SOG format", version 2):
// meta.json and lossless WebP images, in one .sog (a ZIP without compression) or beside meta.json.
//
// Quantization, and with it the largest error:
//   position   sign(x) ln(1 + |x|) in 16 bits of its range, by axis; steps of up to 0.35 of the
//              Gaussian's smallest standard deviation, by powers of two
//   log-scale  1/16
//   color      1/32 of the DC coefficient, -8 to 7.9
//   rotation   x, y, z in 6 bits each: 0.02 rad
//   opacity    sigmoid in 8 bits
//   SH         a palette of up to 8192 sets of coefficients, by k-means, in even steps: the finest
//              with which the palette's image has 4.5 bytes a Gaussian
#ifndef SV_TOOLS_LAB_EXPORT_SOG_H
#define SV_TOOLS_LAB_EXPORT_SOG_H

#include "tools/lab/lab.h"

// path: NAME.sog, or DIR/meta.json (images beside it). The model's up must be SV_UP_DEFAULT, which
// readers expect. E_UNSUPPORTED in a build without libwebp.
sv_status lab_write_sog(const sv_gaussians *g, const sv_model_notes *notes, const sv_pool *pool,
                        const char *path, sv_err *err) SV_MUST_USE;

#endif
