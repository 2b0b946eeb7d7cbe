// SPDX-License-Identifier: Apache-2.0
// What the makers of the release's folder share (release_folder.c and release_multiplexed.c). It
// owns a scene of the simulator; only those two include it.
#ifndef SV_TESTS_COMMON_RELEASE_MAKER_H
#define SV_TESTS_COMMON_RELEASE_MAKER_H

#include "platform/sim/sim.h"
#include "src/base/vec.h"
#include "tools/common/fileio.h"

#ifdef __cplusplus
extern "C" {
#endif

// A scene of the simulator, and where its pictures go.
typedef struct {
  const char *root;
  sv_sim sim;
  void *block;
} maker;

typedef struct {
  sv_pose pose; // cam_from_world
  double f, time_s;
  int w, h;
} camera;

// The path of ROOT/data/NAME, whose folder is made.
void release_path(const maker *m, const char *name, char path[SV_CAP_PATH]);
// A camera on the sphere around the scene that looks at its center.
camera release_around(double azimuth_deg, double elevation_deg, double f, int w, int h);
// The same camera moved along its own axes (meters), without a turn.
camera release_moved(camera c, double right, double down);

// multiplexed/{measurement.png, calibration.npz}.
void release_put_multiplexed(maker *m);

#ifdef __cplusplus
}
#endif
#endif
