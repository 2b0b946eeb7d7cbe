// SPDX-License-Identifier: Apache-2.0
// How well a model predicts the measurements that it was trained on. It renders regions of sensors
// with the trainer's own buffers, between steps; it changes no Gaussian.
#ifndef SV_TOOLS_TRAIN_MEASURED_H
#define SV_TOOLS_TRAIN_MEASURED_H

#include "src/train/train.h"

// PSNR in dB of display values of [0, 1] over all pixels of all measurements. NAN without any, or
// when the model cannot be rendered.
double lab_measured_psnr(sv_trainer *t, const sv_render_options *o);

#endif
