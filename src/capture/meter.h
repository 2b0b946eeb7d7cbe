// SPDX-License-Identifier: Apache-2.0
// Meters of a camera: light and sharpness of a frame of any format, from samples all over it.
// Owns nothing. Never judges: thresholds are those of guidance.h and sharpness.h.
#ifndef SV_CAPTURE_METER_H
#define SV_CAPTURE_METER_H

#include "src/capture/guidance.h"
#include "src/capture/sharpness.h"
#include "src/image/planes.h"
#include "src/port/port.h"

#ifdef __cplusplus
extern "C" {
#endif

#define SV_METER_BINS 32 // of the histogram

typedef struct {
  double luma;           // mean, 0 to 1
  double clipped, black; // shares of samples in the top and the bottom 1 % of the range
  // Slopes of means over 2x2 pixels, to be judged as in sharpness.h.
  sv_sharpness_sums sums;
  // Root of the mean squared slope over the mean luma; 0: too dark to tell.
  double sharpness;
  uint32_t histogram[SV_METER_BINS]; // of luma
} sv_meter;

// Of all cameras of an exposure.
typedef struct {
  sv_sharpness_sums sums;
  double clipped; // of the camera with most
} sv_meter_sum;

// False for compressed frames, and for those that are shorter than they say.
bool sv_meter_frame(const sv_frame *f, sv_meter *out);
bool sv_meter_image(const sv_image_u8 *image, sv_meter *out); // 3 channels
void sv_meter_sum_add(sv_meter_sum *all, const sv_meter *m);
// What guidance asks for. recent: the exposures before, among which this one then counts; of it the
// judgment alone is used, and it needs no memory. Nothing was metered: light and sharpness unknown.
sv_guidance_shot sv_meter_shot(const sv_meter_sum *all, sv_sharpness *recent, const sv_pose *rig_from_world);

#ifdef __cplusplus
}
#endif
#endif
