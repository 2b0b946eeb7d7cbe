// SPDX-License-Identifier: Apache-2.0
#include "src/sync/clock_model.h"

#include <math.h>

void sv_clock_model_init(sv_clock_model *m, bool is_common, sv_ns step_limit_ns, double max_drift,
                         sv_ns transport_ns) {
  *m = (sv_clock_model){.is_common = is_common,
                        .step_limit_ns = step_limit_ns,
                        .max_drift = max_drift,
                        .transport_ns = transport_ns};
}

static double line_at(const sv_clock_model *m, double x_s) { return m->offset_ns + m->drift * x_s * 1e9; }

#define PRIOR_BLOCKS  12  // before that the slope from before a step is the better one
#define RAISED_FACTOR 4   // times the usual distance
#define SMALL_STEP    200 // of the limit: what a jump must have to be called a step
#define FASTER_NS     5e5 // below the line by more: a jump, not just the fastest delivery so far

// is_set: the clock was seen to be set, so stamps far from host time are another clock's. Without
// that only stamps from the future are: those from the past may have waited in a host that was held
// up.
static void start(sv_clock_model *m, sv_ns camera_ns, sv_ns offset_ns, bool is_set) {
  if (m->is_started && m->n_blocks >= PRIOR_BLOCKS) {
    m->prior_drift = m->drift;
    m->has_prior = true;
  }
  m->is_started = true;
  m->ref_camera_ns = camera_ns;
  m->ref_offset_ns = offset_ns;
  m->last_offset_ns = offset_ns;
  m->n_pairs = 1;
  m->n_blocks = 1;
  m->n_in_block = 1;
  m->blocks[0] = (sv_clock_point){0, 0};
  m->n_raised = 0;
  m->last_x_s = 0;
  m->mean_residual_ns = 0;
  m->offset_ns = 0;
  m->drift = m->has_prior ? m->prior_drift : 0;
  m->is_estimating = !m->is_common || offset_ns - m->transport_ns < -m->step_limit_ns ||
                     (is_set && offset_ns - m->transport_ns > m->step_limit_ns);
}

// The lower hull's edge over the mean time; a slope beyond what a crystal does is noise of a short
// record, and the steepest admitted line below all points is taken instead.
static void fit(sv_clock_model *m) {
  sv_clock_point hull[SV_CLOCK_CAP_BLOCKS];
  int n = 0;
  double mean = 0;
  for (int i = 0; i < m->n_blocks; i++) {
    sv_clock_point p = m->blocks[i];
    mean += p.x_s;
    while (n >= 2 && (hull[n - 1].d_ns - hull[n - 2].d_ns) * (p.x_s - hull[n - 2].x_s) >=
                         (p.d_ns - hull[n - 2].d_ns) * (hull[n - 1].x_s - hull[n - 2].x_s))
      n--;
    hull[n++] = p;
  }
  mean /= m->n_blocks;
  int e = 0;
  while (e + 2 < n && hull[e + 1].x_s < mean) e++;
  double drift = 0;
  // One block says nothing about a slope.
  if (m->has_prior && m->n_blocks < PRIOR_BLOCKS) drift = m->prior_drift;
  else if (n >= 2 && m->n_blocks >= 3)
    drift = (hull[e + 1].d_ns - hull[e].d_ns) / ((hull[e + 1].x_s - hull[e].x_s) * 1e9);
  if (drift > m->max_drift) drift = m->max_drift;
  if (drift < -m->max_drift) drift = -m->max_drift;
  double offset = m->blocks[0].d_ns - drift * m->blocks[0].x_s * 1e9;
  for (int i = 1; i < m->n_blocks; i++) {
    double o = m->blocks[i].d_ns - drift * m->blocks[i].x_s * 1e9;
    if (o < offset) offset = o;
  }
  m->offset_ns = offset;
  m->drift = drift;
}

// Deliveries in a row that all lie far above the line: the clock went back by a little, or the path
// became slower for good. Either way the old line is of no use.
static bool is_raised(sv_clock_model *m, double residual_ns, bool is_catching_up) {
  double least = (double)(m->step_limit_ns / SMALL_STEP), usual = RAISED_FACTOR * m->mean_residual_ns;
  if (m->n_pairs <= SV_CLOCK_BLOCK_FRAMES || residual_ns < (least > usual ? least : usual)) {
    m->n_raised = 0;
    m->mean_residual_ns += (residual_ns - m->mean_residual_ns) / SV_CLOCK_BLOCK_FRAMES;
    return false;
  }
  if (is_catching_up) { // what a host that was held up gets all at once
    m->n_raised = 0;
    return false;
  }
  if (!m->n_raised++ || residual_ns < m->raised_ns) m->raised_ns = residual_ns;
  return m->n_raised >= SV_CLOCK_RAISED_PAIRS;
}

static void add_point(sv_clock_model *m, double x_s, double d_ns) {
  if (m->n_in_block == SV_CLOCK_BLOCK_FRAMES) {
    if (m->n_blocks == SV_CLOCK_CAP_BLOCKS) {
      for (int i = 1; i < SV_CLOCK_CAP_BLOCKS; i++) m->blocks[i - 1] = m->blocks[i];
      m->n_blocks--;
    }
    m->blocks[m->n_blocks++] = (sv_clock_point){x_s, d_ns};
    m->n_in_block = 1;
    return;
  }
  sv_clock_point *b = &m->blocks[m->n_blocks - 1];
  // Measured against the line, so that drift within the block does not choose its first or last
  // frame.
  if (d_ns - m->drift * x_s * 1e9 < b->d_ns - m->drift * b->x_s * 1e9) *b = (sv_clock_point){x_s, d_ns};
  m->n_in_block++;
}

bool sv_clock_model_add(sv_clock_model *m, sv_ns camera_ns, sv_ns arrival_ns, sv_ns most_set_ns,
                        sv_ns *step_ns) {
  sv_ns offset_ns = arrival_ns - camera_ns;
  *step_ns = 0;
  if (!m->is_started) {
    start(m, camera_ns, offset_ns, false);
    return false;
  }
  double x_s = (double)(camera_ns - m->ref_camera_ns) * 1e-9;
  double d_ns = (double)(offset_ns - m->ref_offset_ns);
  double expected = m->is_estimating ? line_at(m, x_s) : (double)(m->transport_ns - m->ref_offset_ns);
  double residual = d_ns - expected, limit = (double)m->step_limit_ns;
  // Much faster than all before, and the stamps do not say why: those before were held up, and tell
  // nothing.
  if (m->is_estimating && residual < -limit / SMALL_STEP && (double)most_set_ns < -0.5 * residual) {
    start(m, camera_ns, offset_ns, false);
    return false;
  }
  // The first frames may have waited for the stream's start, so faster ones after them are no step.
  double low = m->is_estimating && m->n_pairs < SV_CLOCK_BLOCK_FRAMES ? -4 * limit : -limit;
  // Later nothing is faster than the fastest by much, unless the clock has jumped ahead.
  if (m->is_estimating && m->n_pairs > SV_CLOCK_BLOCK_FRAMES) low = -limit / SMALL_STEP;
  bool is_step = residual > limit || residual < low;
  sv_ns change_ns = offset_ns - m->last_offset_ns;
  double last_x_s = m->last_x_s;
  m->n_pairs++;
  m->last_x_s = x_s;
  m->last_offset_ns = offset_ns;
  if (!is_step && m->is_estimating) {
    is_step = is_raised(m, residual, (double)change_ns < -0.5e9 * (x_s - last_x_s));
    if (is_step) change_ns = (sv_ns)floor(m->raised_ns + 0.5);
    else {
      double faster = m->mean_residual_ns > FASTER_NS ? m->mean_residual_ns : FASTER_NS;
      // Too small to name: the line goes along
      if (m->n_pairs > SV_CLOCK_BLOCK_FRAMES && residual < -faster)
        for (int i = 0; i < m->n_blocks; i++) m->blocks[i].d_ns += residual;
      add_point(m, x_s, d_ns);
      fit(m);
    }
  }
  if (is_step) {
    *step_ns = -change_ns; // arrival - camera grows when the camera's clock goes back
    start(m, camera_ns, offset_ns, true);
  }
  return is_step;
}

void sv_clock_model_restart(sv_clock_model *m, sv_ns camera_ns, sv_ns arrival_ns) {
  start(m, camera_ns, arrival_ns - camera_ns, true);
}

sv_ns sv_clock_model_host_ns(const sv_clock_model *m, sv_ns camera_ns) {
  if (!m->is_estimating) return camera_ns;
  double x_s = (double)(camera_ns - m->ref_camera_ns) * 1e-9;
  return camera_ns + m->ref_offset_ns - m->transport_ns + (sv_ns)floor(line_at(m, x_s) + 0.5);
}
