// SPDX-License-Identifier: Apache-2.0
// What lenses, sensors and shutters do to light, camera by camera: vignetting, exposure, white
// balance, color matrix, response, black level, hot pixels, rolling shutter, motion blur, defocus.
// Owns the settings and a table. Never draws random numbers: all is a function of the
// configuration, the camera and the slot. Camera 0 is the reference: gains, white balance, color
// matrix and response leave its light as it is.
#ifndef SV_SIM_OPTICS_H
#define SV_SIM_OPTICS_H

#include <stdbool.h>
#include <stdint.h>

#include "src/base/arena.h"
#include "src/rig/rig.h"

#ifdef __cplusplus
extern "C" {
#endif

// Exposure time: as given, or as measured at the start, by each camera or by the first for all.
typedef enum { SV_SIM_LOCK_GIVEN, SV_SIM_LOCK_ON, SV_SIM_LOCK_SHARED } sv_sim_lock;

typedef struct {
  // Relative illumination at distance r from the principal point: 1 + k1 r^2 + k2 r^4 + k3 r^6, r =
  // 1 at the farthest corner. Default 0.
  double vignetting[3];
  bool is_cos4; // and the natural falloff cos^4 of the ray's angle
  double gain;  // camera 1 gets 1 + gain of the light, camera 2 1 - gain. Default 0
  // color temperature in K to which camera 1 is balanced, camera 2 half-way (in 1/K); camera 0 to
  // 6500. Default 6500
  double white_k;
  double crosstalk;     // share of each channel's light that the two others get, cameras 1 and 2.
                        // Default 0
  double response;      // exponent on display values, cameras 1 and 2. Default 1
  double black;         // light that all pixels have without any. Default 0
  double auto_exposure; // factor of light from the first slot of a round to the last (log-linear).
                        // Default 1
  double light;         // of the scene: factor on the light of all cameras. Default 1
  // Light of an evenly lit field in the scene's place; 0: the scene. Default 0
  double flat;
  double bracket;    // factor of every second slot's shutter time. Default 1
  sv_sim_lock lock;  // Default: as given
  double readout_ms; // from the first line of a frame to the last; 0: all at once
  sv_shutter_direction shutter;
  bool is_blurred;    // moves during shutter_us
  double aperture_mm; // diameter of the lens; 0: a pinhole
  double focus_m;     // distance that is sharp. Default 4
  // times and places on the lens that a frame is the mean of, for both. Default 16
  int n_samples;
  int n_hot; // pixels of a camera that are always bright. Default 0
} sv_sim_optics_cfg;

typedef struct {
  bool is_on; // anything but ideal
  // display value of 65535 per 14-bit code, cameras 1 and 2; NULL when the response is linear's
  // sRGB
  uint16_t *response;
} sv_sim_optics;

sv_sim_optics_cfg sv_sim_optics_defaults(void);
sv_status sv_sim_optics_init(sv_sim_optics *o, const sv_sim_optics_cfg *cfg, const uint16_t *srgb16,
                             sv_arena *arena) SV_MUST_USE;

// Whether all cameras give the same values for the same light, auto-exposure apart.
bool sv_sim_optics_is_color_known(const sv_sim_optics_cfg *cfg);
// Linear color transform of a camera in a slot, row-major; progress: the slot's place in the round,
// 0 to 1. Without the black level.
void sv_sim_optics_matrix(const sv_sim_optics_cfg *cfg, int i_camera, double progress, float m[9]);
// Shutter time of a slot over that of the first, by the bracket.
double sv_sim_optics_exposure(const sv_sim_optics_cfg *cfg, int64_t slot);
// Share of the light at pixel (x, y) of a view.
float sv_sim_optics_falloff(const sv_sim_optics_cfg *cfg, const sv_view *v, float x, float y);
int sv_sim_optics_n_samples(const sv_sim_optics_cfg *cfg);
// Sample i of a frame: by how much of the shutter time it is late, -0.5 to 0.5, and its place on
// the lens in m.
void sv_sim_optics_sample(const sv_sim_optics_cfg *cfg, int i, double *late, double lens_m[2]);
// The view through that place of the lens: points at focus_m (depth; of a fisheye distance, with
// sv_sim_shot.lean) stay where they are.
sv_view sv_sim_optics_through(const sv_sim_optics_cfg *cfg, const sv_view *v, const double lens_m[2]);

#ifdef __cplusplus
}
#endif
#endif
