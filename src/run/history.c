// SPDX-License-Identifier: Apache-2.0
// The history of a run that goes on capturing a moving scene: a frame for each exposure, as the
// model was at the end of its turn.
#include <string.h>

#include "src/base/str.h"
#include "src/deform/deform.h"
#include "src/format/axes.h"
#include "src/run/app.h"

#define N_SPARE_GROUPS 2 // the oldest group goes as a whole, the newest one grows

bool sv_app_has_history(const sv_app_cfg *c) { return c->is_dynamic && c->is_continuous && c->history_s > 0; }

sv_history_cfg sv_app_history_cfg(const sv_app_cfg *c) {
  if (!sv_app_has_history(c)) return (sv_history_cfg){0};
  const double n_frames = c->history_s / (c->exposure_s > 0 ? c->exposure_s : c->history_s);
  return (sv_history_cfg){.n = c->train.n_gaussians,
                          .cap_frames = (int)n_frames + N_SPARE_GROUPS * SV_SEQUENCE_GROUP,
                          .span_ns = (sv_ns)(c->history_s * 1e9)};
}

static float value_of(const void *self, uint32_t i, int row) {
  const sv_gaussians *g = self;
  const float *p = sv_gaussians_at(g, (int)i, row);
  return (int)i < g->n_moved ? g->moved[p - g->param] : *p;
}

sv_ns sv_app_newest_ns(const sv_app *app) {
  const sv_exposures *e = &app->exposures;
  return e->exposure[(e->i_next + app->cfg.n_exposures - 1) % app->cfg.n_exposures].time_ns;
}

// Exposures that were left out have the frame before once more: the frames of a sequence stand
// evenly in time.
static sv_status fill_gap(sv_history *h, sv_ns until_ns, sv_ns period_ns) {
  const sv_ns from_ns = sv_history_time_ns(h, h->n_frames - 1);
  const int64_t n = (until_ns - from_ns + period_ns / 2) / period_ns - 1;
  sv_status s = SV_OK;
  for (int64_t k = n > h->cfg.cap_frames ? n - h->cfg.cap_frames : 0; k < n && s >= 0; k++)
    s = sv_history_repeat(h, from_ns + (k + 1) * period_ns);
  return s;
}

void sv_app_note_history(sv_app *app) {
  sv_history *h = &app->moving.history;
  const sv_ns newest_ns = sv_app_newest_ns(app), period_ns = (sv_ns)(app->cfg.exposure_s * 1e9);
  if (h->cfg.n < 1 || app->trainer.step == 0) return;
  if (h->n_frames == 0) h->cfg.radius = app->trainer.radius;
  else if (newest_ns <= sv_history_time_ns(h, h->n_frames - 1)) return;
  sv_status s = h->n_frames > 0 ? fill_gap(h, newest_ns, period_ns) : SV_OK;
  sv_train_set_time(&app->trainer, sv_app_time_of(app, newest_ns));
  if (s >= 0) s = sv_history_add(h, newest_ns, value_of, &app->trainer.g);
  if (s < 0 && h->n_lost == 1)
    sv_app_log(app, SV_LOG_WARN, "the model changes too much for its history; take a longer --history");
}

bool sv_app_has_past(const sv_app *app) { return app->moving.history.n_frames > 1; }

sv_status sv_app_write_history(sv_app *app, sv_sink sink, sv_err *err) {
  const sv_trainer *t = &app->trainer;
  float up[3];
  sv_arena scratch = app->scratch;
  sv_sequence_head head = {
      .is_mip = t->cfg.is_antialiased, .unit = sv_app_unit(app), .dilation_px2 = t->cfg.dilation_px2};
  void *state = SV_TAKE(&scratch, uint8_t, sv_history_state_bytes(&app->moving.history.cfg));
  if (!state) return sv_fail(err, SV_E_NOMEM, "model.svseq: no memory for its index");
  memcpy(head.centre, t->centre, sizeof head.centre);
  sv_pictures_up(t, up);
  sv_copy(head.up, sizeof head.up, sv_up_name(up));
  return sv_history_write(&app->moving.history, &head, state, sink, err);
}
