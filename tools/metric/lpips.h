// SPDX-License-Identifier: Apache-2.0
// LPIPS (Zhang et al., CVPR 2018, "The Unreasonable Effectiveness of Deep Features as a Perceptual
// Metric"), version 0.1: lower is more alike, 0 for equal pictures. The weights of SqueezeNet 1.1
// are part of the program (tools/weights); those of VGG16 come from a file of the user's. The bits
// of a result depend on nothing but the images, not on the number of threads.
#ifndef SV_TOOLS_METRIC_LPIPS_H
#define SV_TOOLS_METRIC_LPIPS_H

#include "src/metric/metric.h"
#include "src/port/port.h"

#ifdef __cplusplus
extern "C" {
#endif

#define SV_LPIPS_MIN_SIDE_PX 17 // the last pooling has nothing to look at in smaller images

typedef struct sv_lpips sv_lpips;

// Unpacks the weights: those of the program, or of VGG16 from the file `vgg` when it is not NULL,
// as tools/weights/convert_lpips.py writes it. Close also takes NULL. Buffers grow with the largest
// image: about 500 bytes a pixel, with VGG16 1,000.
sv_status sv_lpips_open(sv_lpips **out, const char *vgg, sv_err *err) SV_MUST_USE;
void sv_lpips_close(sv_lpips *l);

// im: three channels, values in [0,1] (mapped to [-1,1] as the network was trained). *out: mean
// over the positions of each layer, summed over the layers. E_RANGE for images that are too small,
// E_NOMEM.
sv_status sv_lpips_compare(sv_lpips *l, const sv_image_pair *im, const sv_pool *pool, double *out,
                           sv_err *err) SV_MUST_USE;

// The distance at each pixel ("spatial" LPIPS): the layers' maps brought to the image's size
// (bilinear, pixel areas aligned), then summed. map [height][width].
sv_status sv_lpips_map(sv_lpips *l, const sv_image_pair *im, const sv_pool *pool, float *map,
                       sv_err *err) SV_MUST_USE;

// DyCheck's masked LPIPS (Gao et al., 2022): both images are black where mask [height][width] is 0;
// the mean of the map over the other pixels. 0 for an empty mask.
sv_status sv_lpips_masked(sv_lpips *l, const sv_image_pair *im, const uint8_t *mask, const sv_pool *pool,
                          double *out, sv_err *err) SV_MUST_USE;

#ifdef __cplusplus
}
#endif
#endif
