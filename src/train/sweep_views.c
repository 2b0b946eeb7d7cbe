// SPDX-License-Identifier: Apache-2.0
#include "src/train/sweep_views.h"

#include "src/base/mathx.h"

#define GROUP 4 // neighbours that are taken together when there are too many views
// between two views: less tells depth badly, more and surfaces look different
#define BEST_DEG 8.0
#define MIN_DEG  0.2
#define MAX_DEG  35.0

// Squared distance of two views: of place, in distances to the scene, and of direction.
static double apart(const sv_view *a, const sv_view *b, double distance) {
  float ca[3], cb[3];
  double d2 = 0;
  sv_view_centre(ca, a);
  sv_view_centre(cb, b);
  for (int i = 0; i < 3; i++) {
    double c = ((double)ca[i] - cb[i]) / distance, f = (double)a->r[6 + i] - b->r[6 + i];
    d2 += c * c + f * f;
  }
  return d2;
}

static double distance_to(const sv_view *v, const sv_bounds *b) {
  float c[3];
  sv_view_centre(c, v);
  double d[3] = {(double)b->centre[0] - c[0], (double)b->centre[1] - c[1], (double)b->centre[2] - c[2]};
  return sv_maxf((float)sv_norm3(d), b->radius);
}

typedef struct {
  const sv_trainer *t;
  sv_sweep *s;
  double distance;
} choice;

static bool is_chosen(const choice *c, int i) {
  for (int k = 0; k < c->s->n; k++)
    if (c->s->map[k].i_view == i) return true;
  return false;
}

static bool is_eligible(const choice *c, int i) {
  return !c->t->cfg.has_motion || c->t->views[i].view.time == c->t->reference_time;
}

// The view farthest from all that are chosen, or (is_near) nearest to the one chosen as number
// `to`; -1: none left.
static int next_view(const choice *c, bool is_near, int to) {
  int best = -1;
  double best_d = 0;
  for (int i = 0; i < c->t->n_views; i++) {
    if (!is_eligible(c, i) || is_chosen(c, i)) continue;
    double d = 1e30;
    for (int k = is_near ? to : 0; k < (is_near ? to + 1 : c->s->n); k++) {
      double here = apart(&c->t->views[i].view, &c->t->views[c->s->map[k].i_view].view, c->distance);
      if (here < d) d = here;
    }
    if (best < 0 || (is_near ? d < best_d : d > best_d)) {
      best = i;
      best_d = d;
    }
  }
  return best;
}

void sv_sweep_choose_views(sv_sweep *s, const sv_trainer *t, const sv_bounds *bounds) {
  choice c = {.t = t, .s = s};
  for (int i = 0; i < t->n_views; i++) c.distance += distance_to(&t->views[i].view, bounds) / t->n_views;
  int n_eligible = 0;
  for (int i = 0; i < t->n_views; i++) n_eligible += is_eligible(&c, i);
  bool is_all = n_eligible <= SV_SWEEP_CAP_VIEWS;
  while (s->n < sv_mini(n_eligible, SV_SWEEP_CAP_VIEWS)) {
    int in_group = s->n % GROUP;
    int i = next_view(&c, !is_all && in_group > 0, s->n - in_group);
    s->map[s->n++] = (sv_depth_map){.i_view = i};
  }
}

// How well b tells depth in a: 0 not at all.
static double worth(const sv_view *a, const sv_view *b, double z) {
  float ca[3], cb[3];
  double p[3], q[3];
  sv_view_centre(ca, a);
  sv_view_centre(cb, b);
  for (int i = 0; i < 3; i++) {
    p[i] = z * (double)a->r[6 + i];
    q[i] = p[i] + (double)ca[i] - cb[i];
  }
  double deg = sv_angle_between(p, q) * (180 / SV_PI);
  double ahead = (double)b->r[6] * q[0] + (double)b->r[7] * q[1] + (double)b->r[8] * q[2];
  if (deg < MIN_DEG || deg > MAX_DEG || ahead < 0.7 * sv_norm3(q)) return 0;
  return deg < BEST_DEG ? deg / BEST_DEG : BEST_DEG / deg;
}

void sv_sweep_choose_sources(sv_sweep *s, int i, double z) {
  sv_depth_map *m = &s->map[i];
  double w[SV_SWEEP_CAP_SOURCES];
  for (int k = 0; k < s->n; k++) {
    double here = k == i ? 0 : worth(&m->view, &s->map[k].view, z);
    if (!(here > 0)) continue;
    int at = m->n_sources < SV_SWEEP_CAP_SOURCES ? m->n_sources++ : SV_SWEEP_CAP_SOURCES;
    for (; at > 0 && w[at - 1] < here; at--)
      if (at < SV_SWEEP_CAP_SOURCES) {
        w[at] = w[at - 1];
        m->source[at] = m->source[at - 1];
      }
    if (at < SV_SWEEP_CAP_SOURCES) {
      w[at] = here;
      m->source[at] = k;
    }
  }
}
