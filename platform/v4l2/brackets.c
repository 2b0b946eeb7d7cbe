// SPDX-License-Identifier: Apache-2.0
// Brackets: exposure times that all cameras get in turn. A new one takes some frames until it is in
// effect, and frames of V4L2 do not tell theirs. So each is held for longer than that, and frames
// are told apart by their stamps: before the change, after it, and between, of which the time is
// not known.
#include <math.h>

#include "platform/v4l2/camera.h"

#define USUAL_FRAME_NS (50 * SV_NS_PER_MS) // where no rate is told
#define N_HELD_FRAMES  2                   // one at least of which all cameras have a partner
#define N_MORE_FRAMES  2                   // where stamps are of another clock than ours
#define MOST_OFF       0.05                // of the exposure time wanted, before it is reported

static sv_ns frame_ns(const sv_v4l2_camera *c) {
  const sv_trigger *line = c->cfg->trigger.line;
  sv_ns ns = c->caps.fps > 0 ? (sv_ns)(1e9 / c->caps.fps + 0.5) : USUAL_FRAME_NS;
  if (*c->is_triggered && line && line->period_ns > ns) ns = line->period_ns;
  if (c->exposure_ns > ns) ns = c->exposure_ns;
  return c->before_ns > ns ? c->before_ns : ns;
}

static void set_one(sv_v4l2 *v, sv_v4l2_camera *c) {
  const double want_ns = (double)c->base_ns * v->cfg.bracket[v->i_bracket];
  const sv_ns was_ns = c->exposure_ns, asked_ns = v->clock.now_ns(v->clock.self);
  int64_t actual_ns = 0;
  const sv_status s = sv_v4l2_set_exposure(c, sv_v4l2_possible_exposure(c, (sv_ns)want_ns), &actual_ns);
  const bool is_off = s < 0 || fabs((double)actual_ns - want_ns) > MOST_OFF * want_ns;
  if (is_off && !c->is_bracket_told) {
    c->is_bracket_told = true; // once: it comes again with each turn
    sv_camera_events_add(c->events, SV_CAMERA_CONTROL, c->i_camera, asked_ns, sv_v4l2_exposure_id());
  }
  if (s >= 0 && actual_ns == was_ns) return;
  c->before_ns = was_ns;
  c->before_settled_ns = c->settled_ns;
  c->asked_ns = asked_ns;
  c->settled_ns = v->clock.now_ns(v->clock.self) + v->cfg.n_bracket_delay * frame_ns(c);
}

static bool is_our_clock(const sv_v4l2_camera *c) { return c->caps.clock == SV_CLOCK_MONOTONIC; }

static void set_all(sv_v4l2 *v) {
  sv_ns most_ns = 0;
  for (int i = 0; i < v->n_cameras; i++) {
    sv_v4l2_camera *c = &v->cameras[i];
    if (c->fd >= 0 && c->base_ns > 0) set_one(v, c);
    const int n = v->cfg.n_bracket_delay + N_HELD_FRAMES + (is_our_clock(c) ? 0 : N_MORE_FRAMES);
    if (n * frame_ns(c) > most_ns) most_ns = n * frame_ns(c);
  }
  v->turn_ns = v->clock.now_ns(v->clock.self) + most_ns;
}

void sv_v4l2_begin_brackets(sv_v4l2 *v) {
  if (!v->cfg.n_brackets) return;
  for (int i = 0; i < v->n_cameras; i++)
    if (!v->cameras[i].base_ns) v->cameras[i].base_ns = v->cameras[i].exposure_ns;
  v->i_bracket = 0;
  set_all(v);
}

void sv_v4l2_turn_brackets(sv_v4l2 *v, sv_ns now_ns) {
  if (!v->cfg.n_brackets || now_ns < v->turn_ns) return;
  v->i_bracket = (v->i_bracket + 1) % v->cfg.n_brackets;
  set_all(v);
}

// From the begin of a frame's exposure to the end of its readout. Where stamps are of another
// clock, frames count by their arrival, which may be late.
static void span_of(const sv_v4l2_camera *c, const sv_frame *f, sv_ns *begin_ns, sv_ns *end_ns) {
  const sv_ns ns = frame_ns(c);
  const bool is_ours = is_our_clock(c);
  const sv_ns stamp_ns = is_ours ? f->camera_ns : f->arrival_ns;
  const sv_stamp_source stamp = is_ours ? c->caps.stamp : SV_STAMP_END;
  *end_ns = stamp_ns + (stamp == SV_STAMP_START ? ns : stamp == SV_STAMP_MIDDLE ? ns / 2 : 0);
  *begin_ns = *end_ns - (is_ours ? ns : 2 * ns);
}

void sv_v4l2_tell_exposure(const sv_v4l2_camera *c, sv_frame *f) {
  sv_ns begin_ns, end_ns;
  f->exposure_ns = c->exposure_ns;
  if (!c->asked_ns) return;
  span_of(c, f, &begin_ns, &end_ns);
  const bool is_before = end_ns <= c->asked_ns;
  if (is_before) f->exposure_ns = c->before_ns;
  f->is_unsettled = begin_ns < (is_before ? c->before_settled_ns : c->settled_ns);
}
