// SPDX-License-Identifier: Apache-2.0
// C only: sv_app is.
// Moving scenes in a run: the model's time, and turns of equal length for the exposures of a run
// that goes on capturing. Owns the times of the exposures that the model's time runs between, the
// scores of past exposures and the model's history. Never moves a Gaussian: that is src/dynamic.
#ifndef SV_RUN_MOVING_H
#define SV_RUN_MOVING_H

#include "src/format/history.h"
#include "src/run/config.h"

typedef struct sv_app sv_app;

#define SV_APP_RECENT 25 // exposures

typedef struct {
  sv_ns first_ns, last_ns; // host times of the exposures that the model's time runs between
  sv_ns exposure_ns;       // machine time at which the newest exposure came in
  uint64_t n_entered;      // exposures that came in while training
  uint64_t n_scored;       // of these: scored at the end of their turn
  double psnr_sum;         // dB, over the scored ones
  double psnr_late;        // dB, running mean of about the last 50
  // dB of the last ones: number i of all at i % SV_APP_RECENT
  double psnr_recent[SV_APP_RECENT];
  // dB, the highest psnr_late, which falls to what it is now within about 5,000 exposures
  double psnr_usual;
  bool has_fallen;    // the user was told that quality has fallen
  uint32_t turn_step; // of the trainer, when the newest exposure came in
  float steps_mean;   // steps of an exposure, running mean; 0: none has had its turn
  uint64_t n_reduced; // exposures that were trained on at reduced size
  sv_history history;
} sv_app_moving;

// The trainer's settings of a moving scene, and those of its motion (none when the scene is still).
void sv_app_plan_moving(const sv_app_cfg *cfg, sv_train_cfg *t);
sv_dynamic_cfg sv_app_dynamic_cfg(const sv_app_cfg *cfg);
// Whether the run saves a sequence (model.svseq), and how many frames it has.
bool sv_app_has_sequence(const sv_app_cfg *cfg);
int sv_app_n_frames(const sv_app_cfg *cfg);
// The model's time of a moment of the cameras' host time.
float sv_app_time_of(const sv_app *app, sv_ns time_ns);
void sv_app_begin_moving(sv_app *app); // all exposures are there, training begins
// The newest exposure has had its turn; always true where nothing moves.
bool sv_app_is_exposure_due(const sv_app *app);
sv_status sv_app_leave_exposure(sv_app *app) SV_MUST_USE;
sv_status sv_app_enter_exposure(sv_app *app, int slot) SV_MUST_USE;
// Progress for the schedules of a run in which every exposure is like the last; 0: that of the run.
float sv_app_steady_progress(const sv_app_cfg *cfg);
// --- history.c ---
bool sv_app_has_history(const sv_app_cfg *cfg);
sv_history_cfg sv_app_history_cfg(const sv_app_cfg *cfg); // n = 0: none
// The model as it is at the newest exposure becomes a frame; once for each exposure.
void sv_app_note_history(sv_app *app);
sv_ns sv_app_newest_ns(const sv_app *app); // host time of the newest exposure
bool sv_app_has_past(const sv_app *app);   // the history has frames enough for a sequence
sv_status sv_app_write_history(sv_app *app, sv_sink sink, sv_err *err) SV_MUST_USE;

// Mean PSNR in dB of the last SV_APP_RECENT exposures, or of all; 0: none was scored.
double sv_app_recent_psnr(const sv_app_moving *m);
// The pictures of the last exposures are far worse than usual: something has gone wrong.
bool sv_app_has_quality_fallen(const sv_app_moving *m);

#endif
