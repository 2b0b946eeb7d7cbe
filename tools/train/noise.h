// SPDX-License-Identifier: Apache-2.0
// Measurement noise on training images (src/image/noise.h), as --noise asks for it.
#ifndef SV_TOOLS_TRAIN_NOISE_H
#define SV_TOOLS_TRAIN_NOISE_H

#include "src/image/noise.h"
#include "tools/train/plan.h"

// Every image and measurement of the plan becomes what a sensor would have read: at the size that
// is trained on, images with alpha over black and opaque afterwards (E_ARG when the background is
// another). Noise differs by seed, exposure, sub-view and file name and by nothing else; images
// keep their 8 bits a channel.
sv_status lab_noise_add(const lab_views *v, const lab_plan *p, const sv_noise_model *m,
                        const sv_train_cfg *cfg, const sv_pool *pool, sv_err *err) SV_MUST_USE;

#endif
