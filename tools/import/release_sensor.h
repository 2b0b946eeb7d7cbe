// SPDX-License-Identifier: Apache-2.0
// Datasets whose lens images overlap on one sensor: the measurement of each exposure, and the
// transforms file of its lenses. It owns the measurement while it grows; it never trains.
#ifndef SV_TOOLS_IMPORT_RELEASE_SENSOR_H
#define SV_TOOLS_IMPORT_RELEASE_SENSOR_H

#include "tools/import/import.h"

// A lens of an exposure: view.crop is its place on the sensor, view.exposure its exposure.
typedef struct {
  lab_import_view view;
  char coverage[64]; // of the picture of its coverage beside the file; empty: all of each pixel
} lab_sensor_lens;

typedef struct {
  const lab_sensor_lens *lenses;
  int n;
  double max_overlap;      // M_max
  const char *measurement; // exposure e is in NAME_eEE.png
  int n_exposures;
  const char *points; // the first points, beside the file; NULL: none
} lab_sensor_file;

// FOLDER/transforms: the lenses with their places, and the measurement of each exposure, whose
// values are sRGB-encoded sums of linear light.
sv_status lab_sensor_write(const lab_sensor_file *f, const char *folder, const char *transforms,
                           sv_err *err) SV_MUST_USE;

// Display value of [0, 1] <-> linear light (IEC 61966-2-1).
double lab_srgb_decode(double x);
double lab_srgb_encode(double x);

#endif
