// SPDX-License-Identifier: Apache-2.0
// The governor: shares the time between exposures, training and previews when there is not enough
// of it. Owns the accounts of the time spent; the caller does the work and brings the clock. Never
// blocks. Exposures come first, but training keeps a minimum share; previews are skipped first:
// while training gets less than its share, they come ever more rarely (up to a sixteenth). When
// even so exposures need more than is left beside training's floor, they pile up, and the capture
// queue drops whole ones (src/sync/capture_queue.h). So: previews slow down, then training, then
// whole exposures are dropped. When the processor gets hot, training rests for a part of its time,
// before the processor slows down by itself and frames are lost.
#ifndef SV_CAPTURE_GOVERNOR_H
#define SV_CAPTURE_GOVERNOR_H

#include <stdbool.h>
#include <stdint.h>

#include "src/port/port.h"

#ifdef __cplusplus
extern "C" {
#endif

#define SV_GOVERNOR_SLOWEST 16 // times the preview's period

typedef enum { SV_WORK_EXPOSURE, SV_WORK_TRAIN, SV_WORK_PREVIEW, SV_WORK_REST, SV_N_WORKS } sv_work;
typedef enum {
  SV_LOAD_FREE,    // everything at its own pace
  SV_LOAD_PREVIEW, // previews come more rarely
  SV_LOAD_TRAINING // and training gets less than its share
} sv_load;

typedef struct {
  sv_ns preview_every_ns; // 0: no previews
  double train_share;     // of the time: less makes previews rarer
  double train_floor;     // of the time, even when exposures wait
  double hot_c, cool_c;   // degrees Celsius: training rests more from hot_c on, less below cool_c
  double min_duty;        // of its time that training keeps when it is hot
} sv_governor_cfg;

typedef struct {
  sv_governor_cfg cfg;
  sv_ns window_ns;            // start of the window that is being measured
  sv_ns spent_ns[SV_N_WORKS]; // in it
  int slowdown;               // of previews, 1..SV_GOVERNOR_SLOWEST
  sv_ns preview_ns;           // of the last preview
  sv_ns credit_ns;            // training time that the floor still owes
  double duty;                // share of its time that training may use, cfg.min_duty to 1
  double least_duty;          // so far
  sv_ns heat_ns;              // of the last look at the temperature
  sv_ns rest_ns;              // that training still owes
  sv_ns now_ns;
  sv_load load;
  uint64_t n[SV_N_WORKS];
} sv_governor;

sv_governor_cfg sv_governor_defaults(sv_ns preview_every_ns);
void sv_governor_init(sv_governor *g, const sv_governor_cfg *cfg, sv_ns now_ns);
// The temperature now; looks once a second at it. True: training begins to rest, or works at full
// rate again.
bool sv_governor_heat(sv_governor *g, const sv_heat *heat, sv_ns now_ns);
// What to do now: an exposure (only when one is ready), a preview, a training step, or rest.
sv_work sv_governor_next(sv_governor *g, sv_ns now_ns, bool is_exposure_ready);
// It is done, and took from then till now.
void sv_governor_done(sv_governor *g, sv_work work, sv_ns from_ns, sv_ns now_ns);

#ifdef __cplusplus
}
#endif
#endif
