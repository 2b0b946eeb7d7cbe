// SPDX-License-Identifier: Apache-2.0
// Accelerations that an inertial sensor measured while exposures were taken: at rest they point up
// by 9.8 m/s^2, so their mean tells which way is up. Owns nothing. Never reads a file.
#ifndef SV_CAPTURE_IMU_H
#define SV_CAPTURE_IMU_H

#include <stdbool.h>
#include <stddef.h>

#include "src/base/status.h"
#include "src/base/time.h"

#ifdef __cplusplus
extern "C" {
#endif

#define SV_IMU_REACH_S 0.1 // samples up to so far from a time tell of it

typedef struct {
  double time_s; // of the clock of the frames
  double a[3];   // m/s^2 in the rig's frame: x right, y down, z forward
} sv_imu_sample;

typedef struct {
  const sv_imu_sample *sample; // [n] in the order of their times
  int n;
} sv_imu;

// One line of a text: time and the three accelerations, with commas, semicolons or blanks between;
// what follows is left out. AGAIN: no sample (empty, a comment, or the names of the columns);
// E_FORMAT: neither.
sv_status sv_imu_parse(sv_imu_sample *out, const char *line, size_t bytes) SV_MUST_USE;

// Mean acceleration about a time; false when no sample is near.
bool sv_imu_at(const sv_imu *imu, sv_ns time_ns, double a[3]);

#ifdef __cplusplus
}
#endif
#endif
