// SPDX-License-Identifier: Apache-2.0
// The part of a sensor that an image shows: what cameras report and rigs were calibrated with.
#ifndef SV_BASE_AREA_H
#define SV_BASE_AREA_H

typedef struct {
  int sensor_width_px, sensor_height_px;    // all of the sensor; 0: not known
  double x0_px, y0_px, width_px, height_px; // the part, in the sensor's pixels
} sv_sensor_area;

#endif
