// SPDX-License-Identifier: Apache-2.0
// C only: the port is.
// Images of a run for people: a captured image beside its rendering, and renderings from around the
// scene. Owns nothing; the buffer is the caller's, and the port's publisher encodes what it is
// handed. Never changes the model.
#ifndef SV_PREVIEW_PICTURES_H
#define SV_PREVIEW_PICTURES_H

#include "src/port/port.h"
#include "src/train/train.h"

#define SV_PICTURES_CAP_PX 8192 // width of the three panels of a multiplexed rig

// What images are made of, and where they go.
typedef struct {
  sv_trainer *t;
  const sv_publish *publish;
  uint8_t *rgb; // scratch, of sv_pictures_size
  int i_shown;  // of the captured images (multiplexed: measurements) the one that is shown
} sv_pictures;

// Size of the preview image of such a rig.
void sv_pictures_size(const sv_rig *rig, const sv_camera_caps *caps, int n_cameras, int *width_px,
                      int *height_px);
// Hands an image to the port's publisher as "preview": captured image i_shown beside its
// rendering. Of a multiplexed rig: that measurement of a sensor, the same from the model, and the
// view of its middle lens alone, enlarged; reduced by whole steps until the three fit into
// SV_PICTURES_CAP_PX.
sv_status sv_pictures_publish(const sv_pictures *p) SV_MUST_USE;

// A captured image beside its rendering, reduced by whole steps to fit cap_width_px x
// cap_height_px.
typedef struct {
  uint8_t *rgb; // [height_px][width_px][3] of [cap_height_px][cap_width_px][3]
  int cap_width_px, cap_height_px;
  int width_px, height_px; // filled in, as the PSNR in dB
  double psnr;
} sv_picture_pair;

// Captured image i (modulo their number). Of a multiplexed rig: the measurement of a sensor.
// E_NOT_FOUND: there is none.
sv_status sv_pictures_pair(sv_trainer *t, uint32_t i, sv_picture_pair *pair) SV_MUST_USE;
// N renderings around the scene's center at the height of the first view, published as "orbit_000",
// ...
sv_status sv_pictures_orbit(const sv_pictures *p, int n) SV_MUST_USE;
// The first view, turned around the scene's center and the world's up. The view itself where there
// is no way round.
sv_view sv_pictures_turned(const sv_trainer *t, double turn_rad);
// Display values of a rendering's pixel.
void sv_pictures_pixel(uint8_t out[3], const sv_planes *p, int x, int y);
// Up in the world, as model.ply names it: the axis nearest to the mean of the images' up (-y when
// there are none). Odometry turns its worlds so that this is the main plane's or the IMU's up.
void sv_pictures_up(const sv_trainer *t, float up[3]);

#endif
