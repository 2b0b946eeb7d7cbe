// SPDX-License-Identifier: Apache-2.0
// Sub-views of a sensor behind a microlens array (the paper, section 3.1, model iii): every lenslet
// images the main lens's aperture onto the pixels under it. Pixel offset (u, v) from a lenslet's
// centre is a position in the aperture, the lenslet is a position in the image: one pixel of each
// lenslet at the same (u, v) makes one sub-view.
//
// Lenslet centres come from a white image (an even field) in three steps: the lattice's shortest
// periods from the autocorrelation of the middle of the image; their phase from two Fourier
// coefficients; then a robust affine fit to measured centres over a region that grows to the whole
// sensor. Pixel centres are at (i+0.5, j+0.5). No heap: scratch and results are the caller's.
#ifndef SV_RIG_LENSLET_H
#define SV_RIG_LENSLET_H

#include "src/rig/raw.h"
#include "src/rig/rig.h"

#ifdef __cplusplus
extern "C" {
#endif

#define SV_LENSLET_MIN_PITCH_PX 5.0
#define SV_LENSLET_MAX_PITCH_PX 48.0
#define SV_LENSLET_MAX_TURN_RAD 0.1745329252 // 10 degrees: rotate the image first if it is more

// Lenslet (i, j) has its centre at offset + (i + h) col + j row, h = 1/2 in odd rows of a hexagonal
// array.
typedef struct {
  double pitch_px, rotation_rad; // nearest similarity; rotation from the +x to the +y axis
  double offset_px[2];           // centre of lenslet (0, 0): the one nearest to the image's centre
  double col_px[2], row_px[2];   // steps to the next lenslet in a row, and to the next row
  bool is_hexagonal;             // rows 0.866 pitches apart, every other one shifted by half a
                                 // pitch
  int n_seen, n_used;            // lenslets examined, and those found at their lattice position; 0:
                                 // not measured
  double rms_px;                 // distance of the used ones from the lattice, root mean square
} sv_lenslet_grid;

// An exact lattice.
sv_lenslet_grid sv_lenslet_grid_make(double pitch_px, double rotation_rad, const double offset_px[2],
                                     bool is_hexagonal);
void sv_lenslet_centre(const sv_lenslet_grid *g, int i, int j, double xy_px[2]);

// Sets pitch_px and rotation_rad from the steps, and moves lenslet (0, 0) nearest to (x, y).
void sv_lenslet_grid_settle(sv_lenslet_grid *g, double x_px, double y_px);

// Finds the lattice in a white image (one channel). Layout, pitch (5 to 48 px) and rotation (10
// degrees) need not be known; dead lenslets and vignetting are tolerated. E_FORMAT with one
// sentence (`name` is the image's) when there is no such lattice: it is not a white image. Takes
// sv_lenslet_find_bytes() of scratch.
size_t sv_lenslet_find_bytes(void);
sv_status sv_lenslet_find(sv_lenslet_grid *g, const char *name, const sv_raw *white, sv_arena *scratch,
                          sv_err *err) SV_MUST_USE;

// --- decoding ------------------------------------------------------------------------------------

typedef struct {
  int keep;       // K: K x K sub-views, around the lenslets' centres; 1..16
  double step_px; // between samples inside a lenslet; 0: one pixel
  double floor;   // pixels whose white is below this share of the bright level are unlit; 0: 0.1
  double black;   // black level, subtracted from raw and white, 0..1
} sv_lenslet_cfg;

// Where the samples lie. Pixel (s, t) of every sub-view is at lattice column q0 + s dq (in steps of
// col, odd rows of a hexagonal array not counted shifted) of row j0 + t. dq is 1, or row / col for
// a hexagonal array, which makes its pixels square.
typedef struct {
  sv_lenslet_grid grid;
  sv_lenslet_cfg cfg; // zeros replaced by the defaults
  int sensor_width_px, sensor_height_px;
  int width_px, height_px; // of a sub-view
  double q0, dq;
  int j0;
  int i0, n_columns;           // lenslets of a row that are read, first and number
  double axis_u[2], axis_v[2]; // sensor px per step of u and v
  double cx_px, cy_px;         // the sensor's centre in a sub-view
} sv_lenslet_plan;

// The largest upright rectangle of the lattice with all samples on the sensor.
// E_RANGE with a sentence when nothing is left or when samples reach into neighbouring lenslets.
sv_status sv_lenslet_plan_make(sv_lenslet_plan *p, const sv_lenslet_grid *g, const sv_lenslet_cfg *cfg,
                               int sensor_width_px, int sensor_height_px, sv_err *err) SV_MUST_USE;

// gain[sensor height][sensor width]: factor of a raw pixel that undoes the vignetting:
// bright level of the white image (its 99th percentile) over the pixel's white, at most 1/floor.
// Right for linear values and for values that are a power of them. E_FORMAT when the white image is
// black.
sv_status sv_lenslet_gain(const sv_lenslet_plan *p, const char *name, const sv_raw *white, float *gain,
                          sv_err *err) SV_MUST_USE;

// One channel of an image of the sensor's size, and the gains of its pixels.
typedef struct {
  const sv_raw *raw;
  const float *gain;
  int channel;
} sv_lenslet_image;
// Sub-view in column c, row r of the K x K grid (c to the right in the aperture, r down): out
// [height_px] [width_px], not clamped above. row: scratch of [n_columns] floats.
void sv_lenslet_decode(const sv_lenslet_plan *p, const sv_lenslet_image *image, int c, int r, float *row,
                       float *out);

// Parameters that the white image cannot tell. The sub-views are parallel cameras on a plane with
// shifted frusta: a point at focus_m has the same position in all of them.
typedef struct {
  double focal_px;   // in pixel widths of a sub-view
  double baseline_m; // between neighbouring sub-views
  double focus_m;    // distance of the plane in focus; 0: infinity
} sv_lenslet_optics;

// K*K pinhole sub-views "rRcC", row by row, forward light_field, each an image of its own (camera r
// K + c, no footprint). The rig's frame is the central view's. The image must be upright, as
// cameras deliver it. E_FULL when the rig is too small.
sv_status sv_lenslet_rig(sv_rig *rig, const sv_lenslet_plan *p, const sv_lenslet_optics *o) SV_MUST_USE;

#ifdef __cplusplus
}
#endif
#endif
