// SPDX-License-Identifier: Apache-2.0
// The pool of exposures: each sub-view's image, cut out of its sensor's frame, undistorted once and
// corrected where the rig is photometrically calibrated (fisheyes stay as they are, with a mask
// where the lens is dark), kept for training; of multiplexed rigs, each sensor's measurement
// (measurements.h). Owns images, times and poses of the exposures in a fixed number of slots; a
// full pool replaces the oldest.
// Never keeps a camera's frame: it is free as soon as sv_exposures_add returns.
#ifndef SV_CAPTURE_EXPOSURES_H
#define SV_CAPTURE_EXPOSURES_H

#include "calib/lens_view.h"
#include "calib/remap.h"
#include "kernels/kernels.h"
#include "src/capture/correction.h"
#include "src/capture/measurements.h"
#include "src/capture/sharpness.h"
#include "src/capture/spacing.h"
#include "src/image/convert.h"
#include "src/image/planes.h"
#include "src/port/port.h"
#include "src/rig/rig.h"
#include "src/sync/sync.h"

#ifdef __cplusplus
extern "C" {
#endif

#define SV_HELD_PX 16

typedef struct {
  const sv_rig *rig;          // must outlive the pool
  int cap_exposures;          // a full pool replaces the oldest
  const sv_camera_caps *caps; // [n_cameras] sizes and formats; must outlive the pool
  int n_cameras, n_threads;
  const sv_decoder *decoder; // of compressed frames, or NULL; must outlive the pool
  // Exposures that are blurred are not kept (sharpness.h). Not for multiplexed rigs, nor for pools
  // that are full before the capture ends. Default false.
  bool is_blur_dropped;
  // Which exposures are kept. By motion: neither for multiplexed rigs nor for pools that are full
  // before the capture ends. Default: all.
  sv_spacing_cfg spacing;
  // Share of the pixels that no view is trained on, in blocks of SV_HELD_PX (sub[i].held), to score
  // the model by them, see sv_exposures_hold. Not for multiplexed rigs. Default 0.
  float hold_out;
  // Pictures are kept in 16 bits of linear light, too, for training (sv_exposures_deep). Not for
  // multiplexed rigs. Default false.
  bool is_deep;
} sv_exposures_cfg;

typedef struct {
  sv_lens_view lens;
  sv_remap map;             // from the lens; entries NULL unless lens.is_remapped
  size_t at, bytes;         // of its picture inside one exposure's block
  size_t deep_at;           // of its deep picture, likewise
  uint8_t *mask;            // [height][width] of the view, NULL without one
  sv_correction correction; // not of deep pictures
  uint8_t *held;            // [height][width] 1: kept from training; NULL without hold_out
  sv_row_time row_time;     // of a rolling shutter
} sv_sub_view_store;

typedef struct {
  sv_exposures_cfg cfg;
  sv_measurements measurements; // of a multiplexed rig, without sensors for others
  sv_sub_view_store *sub;       // [n_sub_views], NULL for a multiplexed rig
  sv_convert convert;           // frames of other formats than RGB8
  sv_sharpness sharpness;       // with is_blur_dropped
  sv_spacing spacing;
  sv_drop_reason reason; // of the exposure that was dropped last
  uint8_t *reduced;      // a frame made smaller, before it is undistorted; or NULL
  float *area_scratch;   // [n_threads][n_area_floats], NULL where no frame is made smaller
  size_t n_area_floats;
  uint16_t *deep_reduced; // with is_deep: the same of deep pictures, [3][height][width]
  uint32_t *deep_sums;    // [n_threads][n_deep_sums]
  size_t n_deep_sums;
  size_t exposure_bytes;
  uint8_t *px;           // [cap_exposures][exposure_bytes]
  sv_exposure *exposure; // [cap_exposures]
  int n;                 // exposures held
  int i_next;            // slot that the next one goes to
  int *place;            // [cap_exposures + 1] block in px of each slot; the last is spare
  float white;           // with is_deep: what is white in the first frame (deep.h); else 1
  // [n_cameras] shutter time of the first frame, that of the first camera for all that differ from
  // it in nothing else; with is_deep, else NULL
  sv_ns *first_ns;
  double *light;  // [1 + n_cameras] see sv_exposures_note_light; with is_deep, else NULL
  float *shutter; // [cap_exposures + 1][n_cameras] shutter time over that, of each block
  uint64_t n_replaced;
} sv_exposures;

// E_RANGE with a sentence when a lens has no usable pinhole view; for multiplexed rigs as
// sv_measurements_init. The remap tables are built here.
sv_status sv_exposures_init(sv_exposures *e, const sv_exposures_cfg *cfg, sv_arena *arena,
                            sv_err *err) SV_MUST_USE;

// Copies one synchronized set of frames (frame[i_camera]; of multiplexed rigs RGB16 or RGB8) into
// the pool, converted to RGB8. The frames are free afterwards. E_UNSUPPORTED for other pixel
// formats, E_RANGE when a frame's size is not the rig's, E_FORMAT or E_CORRUPT for a compressed
// picture that is damaged: nothing is kept then. DROPPED: not kept either, and reason tells why:
// blurred, or not due.
sv_status sv_exposures_add(sv_exposures *e, const sv_exposure *exposure, const sv_frame *frame,
                           const sv_kernels *k, const sv_pool *pool, sv_err *err) SV_MUST_USE;

// With is_deep: the deep picture of sub-view i_sub of exposure i.
void sv_exposures_deep(const sv_exposures *e, int i, int i_sub, sv_image_deep *out);

// With is_deep: what values are counted from, white and each camera's first shutter time in s, to
// light; and from it, where a run that is resumed has put that of the run before it.
void sv_exposures_note_light(sv_exposures *e);
void sv_exposures_take_light(sv_exposures *e);

// When a sub-view of a rolling shutter reads the places of a view of it. E_RANGE: the lens sees too
// little of it.
sv_status sv_exposures_row_time(const sv_sub_view *v, const sv_camera_caps *caps, const sv_lens_view *view,
                                sv_row_time *out) SV_MUST_USE;
// Picture and view of sub-view i_sub of exposure i (0: slot order). Not for multiplexed rigs.
void sv_exposures_get(const sv_exposures *e, int i, int i_sub, sv_image_u8 *image, sv_view *view);

// Whether the pixels that hold_out chose are kept from training; they are at first.
void sv_exposures_hold(sv_exposures *e, bool is_kept);

#ifdef __cplusplus
}
#endif
#endif
