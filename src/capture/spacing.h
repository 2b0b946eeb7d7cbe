// SPDX-License-Identifier: Apache-2.0
// Which exposures are kept when cameras deliver more than are wanted: one in so much time, or one
// when the picture has moved. Uses thumbnails in the caller's memory. Never judges
// what a picture shows.
#ifndef SV_CAPTURE_SPACING_H
#define SV_CAPTURE_SPACING_H

#include "src/base/time.h"
#include "src/image/planes.h"

#ifdef __cplusplus
extern "C" {
#endif

#define SV_SPACING_COLS     32 // of a thumbnail: its cells, each a mean of luma
#define SV_SPACING_ROWS     24
#define SV_SPACING_MOVED    2             // cells: 6 % of the image's width is motion
#define SV_SPACING_STILL_NS (SV_NS_PER_S) // without motion the next exposure is kept after that

typedef struct {
  sv_ns every_ns;    // between two exposures; 0: all are kept
  sv_ns early_ns;    // an exposure may come so much too early: half a frame period
  bool is_by_motion; // when the picture has moved, at the latest after SV_SPACING_STILL_NS
  int n_brackets;    // shutter times that exposures have in turn: all of a turn are kept; 0: one
} sv_spacing_cfg;

typedef float sv_spacing_cells[SV_SPACING_ROWS * SV_SPACING_COLS];

typedef struct {
  sv_spacing_cfg cfg;
  bool has_kept;
  sv_ns kept_ns, due_ns;  // of the one kept last that was due, of the next one
  sv_ns shutter_ns;       // of the one kept last
  int n_left;             // of its turn
  sv_spacing_cells *cell; // [2] of that one, of the one to be judged; NULL without is_by_motion
} sv_spacing;

// cells: [2] that outlive s; NULL without is_by_motion.
void sv_spacing_init(sv_spacing *s, const sv_spacing_cfg *cfg, sv_spacing_cells *cells);
// An exposure by its time and by the shutter time of its first camera, 0 when it is unknown.
typedef struct {
  sv_ns time_ns, shutter_ns;
} sv_spacing_exposure;

// By time alone, before the picture is looked at.
bool sv_spacing_is_due(const sv_spacing *s, const sv_spacing_exposure *e);
// By motion: image is the first sub-view's, 3 channels. True without is_by_motion, and for what
// completes a turn of shutter times.
bool sv_spacing_has_moved(sv_spacing *s, const sv_image_u8 *image, const sv_spacing_exposure *e);
// The exposure that was judged last is kept.
void sv_spacing_keep(sv_spacing *s, const sv_spacing_exposure *e);

#ifdef __cplusplus
}
#endif
#endif
