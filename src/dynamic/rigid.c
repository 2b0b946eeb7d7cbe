// SPDX-License-Identifier: Apache-2.0
#include "src/dynamic/rigid.h"

#include <math.h>
#include <string.h>

#include "src/base/mathx.h"
#include "src/base/rng.h"

#define N_STEPS 12 // of Gauss-Newton, at most
// of these with a tolerance wider by 16, 8, 4, 2 when the start is not known
#define N_WIDE       4
#define DAMPING      1e-4  // of the mean diagonal: what the pictures leave open does not change
#define LIKELY_TURN  0.15  // rad, standard deviation of a turn from the one expected,
#define LIKELY_SHIFT 0.5   // and of a shift, in radii of the body
#define CONVERGED    1e-10 // squared step, rad^2 and in radii of the body
#define N_TRIALS     256   // triples a body
#define N_DRAWS      64    // for one that moves
#define N_REFINED    24    // of these, at most, are refined
#define SIDE         32    // neighbours before and after a seed that a triple must explain
#define MIN_NEAR     0.4f  // share of them that must agree
#define MAX_TURN     0.6f  // |vector part| of q: more between two times is no motion, 74 degrees
// times the usual distance to the next of a body: what is farther is another
#define GAP       3.0f
#define N_FAILED  4    // winners that are no body, until the search ends
#define VOTERS    8    // nearest that say which body a stray belongs to
#define NEAR      0.7f // of a body's size: who votes for it is no farther
#define MAJORITY  5    // of them
#define UNANIMITY 7    // of them, where a stray goes by itself
#define MAX_STRAY 4.0f // tolerances: off by more is to go by itself

typedef struct {
  const sv_displaced *of;
  const uint32_t *index;
  int n;
  const float *c;
  const sv_rigid *start; // what is expected, within LIKELY_TURN and LIKELY_SHIFT; NULL: anything
} cloud;

typedef struct {
  double h[6][6], g[6]; // normal equations, upper triangle; dofs: d, then the turn
} normal;

// --- one motion ----------------------------------------------------------------------------------

static float square(const float a[6], const float e[3]) {
  return a[0] * e[0] * e[0] + a[3] * e[1] * e[1] + a[5] * e[2] * e[2] +
         2 * (a[1] * e[0] * e[1] + a[2] * e[0] * e[2] + a[4] * e[1] * e[2]);
}

// Squared pixels by which m is off for o; e: in space.
static float off2(const sv_displaced *o, const sv_rigid *m, const float c[3], float e[3]) {
  sv_rigid_apply(m, c, o->x, e);
  for (int k = 0; k < 3; k++) e[k] -= o->x[k] + o->u[k];
  return square(o->a, e);
}

// --- fit -----------------------------------------------------------------------------------------

static void add_normal(normal *s, const sv_displaced *o, const float arm[3], const float e[3], double w) {
  // dy/d(d, turn) = [I, -[arm]x]
  const double j[3][6] = {{1, 0, 0, 0, (double)arm[2], -(double)arm[1]},
                          {0, 1, 0, -(double)arm[2], 0, (double)arm[0]},
                          {0, 0, 1, (double)arm[1], -(double)arm[0], 0}};
  const float *a = o->a;
  const double f[3][3] = {{(double)a[0], (double)a[1], (double)a[2]},
                          {(double)a[1], (double)a[3], (double)a[4]},
                          {(double)a[2], (double)a[4], (double)a[5]}};
  double aj[3][6];
  for (int r = 0; r < 3; r++)
    for (int p = 0; p < 6; p++) aj[r][p] = w * (f[r][0] * j[0][p] + f[r][1] * j[1][p] + f[r][2] * j[2][p]);
  for (int p = 0; p < 6; p++) {
    for (int q = p; q < 6; q++) s->h[p][q] += j[0][p] * aj[0][q] + j[1][p] * aj[1][q] + j[2][p] * aj[2][q];
    s->g[p] += aj[0][p] * (double)e[0] + aj[1][p] * (double)e[1] + aj[2][p] * (double)e[2];
  }
}

// h x = g in place by Cholesky, x in g. False where h is not positive definite.
static bool solve6(double h[6][6], double g[6]) {
  for (int p = 0; p < 6; p++) {
    for (int r = 0; r < p; r++) h[p][p] -= h[r][p] * h[r][p];
    if (!(h[p][p] > 0)) return false;
    h[p][p] = sqrt(h[p][p]);
    for (int q = p + 1; q < 6; q++) {
      for (int r = 0; r < p; r++) h[p][q] -= h[r][p] * h[r][q];
      h[p][q] /= h[p][p];
    }
    for (int r = 0; r < p; r++) g[p] -= h[r][p] * g[r];
    g[p] /= h[p][p];
  }
  for (int p = 5; p >= 0; p--) {
    for (int q = p + 1; q < 6; q++) g[p] -= h[p][q] * g[q];
    g[p] /= h[p][p];
  }
  return true;
}

// about small vectors: half the vector, normalised
static void turn_by(float q[4], const double w[3]) {
  double s[4] = {1, 0.5 * w[0], 0.5 * w[1], 0.5 * w[2]},
         b[4] = {(double)q[0], (double)q[1], (double)q[2], (double)q[3]};
  double r[4] = {s[0] * b[0] - s[1] * b[1] - s[2] * b[2] - s[3] * b[3],
                 s[0] * b[1] + s[1] * b[0] + s[2] * b[3] - s[3] * b[2],
                 s[0] * b[2] - s[1] * b[3] + s[2] * b[0] + s[3] * b[1],
                 s[0] * b[3] + s[1] * b[2] - s[2] * b[1] + s[3] * b[0]};
  double norm = sqrt(r[0] * r[0] + r[1] * r[1] + r[2] * r[2] + r[3] * r[3]);
  for (int k = 0; k < 4; k++) q[k] = (float)(r[k] / norm);
}

// What is expected counts as one measurement off by the tolerance at the standard deviations. It
// matters where pictures hardly tell: how near a small thing is that one camera sees.
static void expect(normal *s, const sv_rigid *m, const sv_rigid *start, double tolerance, double radius2) {
  const float back[4] = {start->q[0], -start->q[1], -start->q[2], -start->q[3]};
  float by[4];
  sv_quat_mul(m->q, back, by);
  const double turn = tolerance * tolerance / (LIKELY_TURN * LIKELY_TURN), to = by[0] < 0 ? -2 : 2;
  const double shift = tolerance * tolerance / (LIKELY_SHIFT * LIKELY_SHIFT * radius2 + 1e-30);
  for (int k = 0; k < 3; k++) {
    s->h[k][k] += shift;
    s->h[3 + k][3 + k] += turn;
    s->g[k] += shift * (double)(m->d[k] - start->d[k]);
    s->g[3 + k] += turn * to * (double)by[1 + k];
  }
}

// One step of m with weights for tolerance; moved2: its squared size, a turn and in radii. False:
// singular.
static bool step(const cloud *p, float tolerance, sv_rigid *m, double *moved2) {
  normal s = {{{0}}, {0}};
  double arm2 = 0, sum = 0, tr = 0, rot = 0;
  for (int i = 0; i < p->n; i++) {
    const sv_displaced *o = &p->of[p->index[i]];
    float e[3], arm[3];
    if (!o->is_known) continue;
    float agrees = tolerance * tolerance, r2 = off2(o, m, p->c, e);
    agrees /= agrees + r2;
    for (int k = 0; k < 3; k++) arm[k] = e[k] + o->u[k] + o->x[k] - p->c[k] - m->d[k];
    double w = (double)(agrees * agrees);
    add_normal(&s, o, arm, e, w);
    arm2 += w * (double)(arm[0] * arm[0] + arm[1] * arm[1] + arm[2] * arm[2]);
    sum += w;
  }
  for (int k = 0; k < 3; k++) {
    tr += s.h[k][k] / 3;
    rot += s.h[3 + k][3 + k] / 3;
  }
  for (int k = 0; k < 3; k++) {
    s.h[k][k] += DAMPING * tr + 1e-30;
    s.h[3 + k][3 + k] += DAMPING * rot + 1e-30;
  }
  if (p->start) expect(&s, m, p->start, (double)tolerance, arm2 / sum);
  if (!(sum > 0) || !solve6(s.h, s.g)) return false;
  double w[3], size2 = 0;
  for (int k = 0; k < 3; k++) {
    m->d[k] -= (float)s.g[k];
    w[k] = -s.g[3 + k];
    size2 += s.g[k] * s.g[k];
  }
  *moved2 = size2 / (arm2 / sum + 1e-30) + w[0] * w[0] + w[1] * w[1] + w[2] * w[2];
  turn_by(m->q, w);
  return true;
}

// From m, with tolerances that end as given and start wider by 2^n_wide.
static bool iterate(const cloud *p, float tolerance, int n_wide, int n_steps, sv_rigid *m) {
  for (int i = 0; i < n_steps; i++) {
    double moved2 = 0;
    float wider = i < n_wide ? (float)(1 << (n_wide - i)) : 1.0f;
    if (!step(p, tolerance * wider, m, &moved2)) return false;
    if (!(moved2 < 1e6)) return false;
    if (i >= n_wide && moved2 < CONVERGED) break;
  }
  return true;
}

static int count_inliers(const cloud *p, const sv_rigid *m, float tolerance) {
  int n = 0;
  for (int i = 0; i < p->n; i++) {
    const sv_displaced *o = &p->of[p->index[i]];
    float e[3];
    n += o->is_known && off2(o, m, p->c, e) < tolerance * tolerance;
  }
  return n;
}

static int shift_by_mean(const cloud *p, sv_rigid *m) {
  int n = 0;
  *m = SV_RIGID_IDENTITY;
  for (int i = 0; i < p->n; i++) {
    const sv_displaced *o = &p->of[p->index[i]];
    if (!o->is_known) continue;
    for (int k = 0; k < 3; k++) m->d[k] += o->u[k];
    n++;
  }
  for (int k = 0; k < 3 && n; k++) m->d[k] /= (float)n;
  return n;
}

bool sv_rigid_fit(const sv_rigid_points *points, float tolerance_px, const sv_rigid *start, sv_rigid *out,
                  int *n_inliers) {
  const cloud p = {points->of, points->index, points->n, points->c, start};
  sv_rigid m;
  if (n_inliers) *n_inliers = 0;
  if (shift_by_mean(&p, &m) < 3) return false;
  if (start) m = *start;
  if (!iterate(&p, tolerance_px, start ? 1 : N_WIDE, N_STEPS, &m)) return false;
  int inliers = count_inliers(&p, &m, tolerance_px);
  if (inliers < 3) return false;
  *out = m;
  if (n_inliers) *n_inliers = inliers;
  return true;
}

// --- search --------------------------------------------------------------------------------------

typedef struct {
  const sv_rigid_search *s;
  sv_rng rng;
  int n;           // known Gaussians without a body, as in order: s->list [0, n)
  uint32_t *found; // [s->n] Gaussians of a motion
} search;

static float length2(const float v[3]) { return v[0] * v[0] + v[1] * v[1] + v[2] * v[2]; }

static float distance2(const sv_displaced *a, const sv_displaced *b) {
  float y[3] = {a->x[0] - b->x[0], a->x[1] - b->x[1], a->x[2] - b->x[2]};
  return length2(y);
}

static void list_free(search *q) {
  const sv_rigid_search *s = q->s;
  q->n = 0;
  for (int i = 0; i < s->n; i++) {
    uint32_t index = s->order[i];
    if (!s->label[index] && s->of[index].is_known) s->list[q->n++] = index;
  }
}

static bool moves(const sv_rigid_search *s, uint32_t index) {
  return square(s->of[index].a, s->of[index].u) > s->min_px * s->min_px;
}

static bool is_moved(const sv_rigid_search *s, uint32_t index, const sv_rigid *m, const float c[3]) {
  const sv_displaced *o = &s->of[index];
  float y[3];
  sv_rigid_apply(m, c, o->x, y);
  for (int k = 0; k < 3; k++) y[k] -= o->x[k];
  return square(o->a, y) > s->min_px * s->min_px;
}

// Where in the list one is that moves; -1: they are few.
static int draw_mover(search *q) {
  for (int i = 0; i < N_DRAWS; i++) {
    int at = (int)sv_rng_below(&q->rng, (uint32_t)q->n);
    if (moves(q->s, q->s->list[at])) return at;
  }
  return -1;
}

// Two others near place at, three different ones in all.
static bool draw(search *q, int at, int side, uint32_t index[3]) {
  int lo = sv_maxi(at - side, 0), n = sv_mini(at + side, q->n - 1) - lo + 1;
  if (n < 3) return false;
  int a = lo + (int)sv_rng_below(&q->rng, (uint32_t)n), b = lo + (int)sv_rng_below(&q->rng, (uint32_t)n);
  index[0] = q->s->list[at];
  index[1] = q->s->list[a];
  index[2] = q->s->list[b];
  return a != at && b != at && a != b;
}

static void gather_inliers(const search *q, const sv_rigid *m, const float c[3], float tolerance, int *n) {
  *n = 0;
  for (int i = 0; i < q->n; i++) {
    float e[3];
    uint32_t index = q->s->list[i];
    if (off2(&q->s->of[index], m, c, e) < tolerance * tolerance) q->found[(*n)++] = index;
  }
}

// A motion that three neighbours propose and those around them agree to; c: the first's place.
static bool propose(search *q, int side, sv_rigid *m, float c[3]) {
  const sv_rigid_search *s = q->s;
  uint32_t index[3];
  const int at = draw_mover(q);
  if (at < 0 || !draw(q, at, side, index)) return false;
  memcpy(c, s->of[index[0]].x, 3 * sizeof *c);
  const cloud three = {s->of, index, 3, c, NULL};
  shift_by_mean(&three, m);
  if (!iterate(&three, 64.0f * s->tolerance_px, 0, N_STEPS / 2, m)) return false;
  if (count_inliers(&three, m, s->tolerance_px) < 3) return false;
  const int lo = sv_maxi(at - side, 0), hi = sv_mini(at + side, q->n - 1);
  const cloud near = {s->of, s->list + lo, hi - lo + 1, c, NULL};
  if ((float)count_inliers(&near, m, 2 * s->tolerance_px) < MIN_NEAR * (float)near.n) return false;
  return iterate(&near, s->tolerance_px, 1, N_STEPS / 2, m) && is_moved(s, index[0], m, c) &&
         length2(m->q + 1) < MAX_TURN * MAX_TURN;
}

// All that go along with m, in q->found, after m was fitted to them.
static int widen(search *q, sv_rigid *m, const float c[3]) {
  const sv_rigid_search *s = q->s;
  int n = 0;
  for (int round = 0; round < 3; round++) {
    gather_inliers(q, m, c, round < 2 ? 2 * s->tolerance_px : s->tolerance_px, &n);
    const cloud p = {s->of, q->found, n, c, NULL};
    if (n < 3 || (round < 2 && !iterate(&p, s->tolerance_px, 0, N_STEPS / 2, m))) return 0;
  }
  return length2(m->q + 1) < MAX_TURN * MAX_TURN ? n : 0;
}

// The motion that most go along with, and its centre of turning; how many.
static int best_motion(search *q, sv_rigid *best, float c[3]) {
  int most = 0;
  for (int trial = 0, refined = 0; trial < N_TRIALS && refined < N_REFINED; trial++) {
    sv_rigid m;
    float at[3];
    if (!propose(q, SIDE >> trial % 4, &m, at)) continue;
    refined++;
    int n = widen(q, &m, at);
    if (n > most) {
      most = n;
      *best = m;
      memcpy(c, at, sizeof at);
    }
  }
  return most;
}

// --- what hangs together -------------------------------------------------------------------------

// Mean distance of the n Gaussians to the nearest other, over some of them; a share of their spread
// if that is more.
static float usual_gap(const sv_displaced *of, const uint32_t *index, int n) {
  const int every = sv_maxi(n / 64, 1);
  float sum = 0;
  int count = 0;
  for (int i = 0; i < n; i += every, count++) {
    float least = 1e30f;
    for (int j = 0; j < n; j++)
      if (j != i) least = sv_minf(least, distance2(&of[index[i]], &of[index[j]]));
    sum += sqrtf(least);
  }
  return sum / (float)count;
}

// The largest set of the n Gaussians in which each is near another of it, moved to the front.
// Returns its size.
static int largest_part(const sv_displaced *of, uint32_t *index, int n) {
  const float gap = GAP * usual_gap(of, index, n), gap2 = gap * gap;
  int first = 0, most = 0, begin = 0;
  while (begin < n) {
    int end = begin + 1; // of the part that grows from index[begin]
    for (int i = begin; i < end; i++)
      for (int j = end; j < n; j++) {
        if (!(distance2(&of[index[i]], &of[index[j]]) < gap2)) continue;
        uint32_t keep = index[end];
        index[end++] = index[j];
        index[j] = keep;
      }
    if (end - begin > most) {
      most = end - begin;
      first = begin;
    }
    begin = end;
  }
  memmove(index, index + first, (size_t)most * sizeof *index);
  return most;
}

static bool most_move(const sv_rigid_search *s, const uint32_t *index, int n, const sv_rigid *m,
                      const float c[3]) {
  int count = 0;
  for (int i = 0; i < n; i++) count += is_moved(s, index[i], m, c);
  return 2 * count > n;
}

// m about another centre.
static void recentre(sv_rigid *m, const float from[3], const float to[3]) {
  float y[3];
  sv_rigid_apply(m, from, to, y);
  for (int k = 0; k < 3; k++) m->d[k] = y[k] - to[k];
}

static int members(search *q, sv_rigid *m, float c[3]) {
  const sv_rigid_search *s = q->s;
  sv_rigid fitted = *m;
  float centre[3] = {0};
  int n;
  gather_inliers(q, m, c, s->tolerance_px, &n);
  if (n >= 3) n = largest_part(s->of, q->found, n);
  if (n < sv_maxi(s->min_members, 3)) return 0;
  for (int i = 0; i < n; i++)
    for (int k = 0; k < 3; k++) centre[k] += s->of[q->found[i]].x[k] / (float)n;
  recentre(&fitted, c, centre);
  const cloud p = {s->of, q->found, n, centre, NULL};
  if (!iterate(&p, s->tolerance_px, 0, N_STEPS, &fitted) || !most_move(s, q->found, n, &fitted, centre))
    return 0;
  *m = fitted;
  memcpy(c, centre, sizeof centre);
  return n;
}

// --- strays --------------------------------------------------------------------------------------

typedef struct {
  int n;
  uint32_t index[VOTERS];
  float d2[VOTERS];
} voters;

static void add_voter(voters *v, uint32_t index, float d2) {
  if (v->n == VOTERS && d2 >= v->d2[VOTERS - 1]) return;
  int at = v->n < VOTERS ? v->n++ : VOTERS - 1;
  for (; at > 0 && v->d2[at - 1] > d2; at--) {
    v->index[at] = v->index[at - 1];
    v->d2[at] = v->d2[at - 1];
  }
  v->index[at] = index;
  v->d2[at] = d2;
}

// Nearest of those before and after at in the order that are of a body, or stand still.
static void find_voters(const sv_rigid_search *s, int at, voters *v) {
  const int last = sv_mini(at + SIDE, s->n - 1);
  v->n = 0;
  for (int i = sv_maxi(at - SIDE, 0); i <= last; i++) {
    uint32_t index = s->order[i];
    if (i == at || !s->of[index].is_known) continue;
    if (s->label[index] || !moves(s, index))
      add_voter(v, index, distance2(&s->of[s->order[at]], &s->of[index]));
  }
}

// Mean squared distance of body b's members from its centre.
static float size2(const sv_rigid_search *s, int label, const float c[3]) {
  float sum = 0, n = 0;
  for (int i = 0; i < s->n; i++) {
    if (s->label[s->order[i]] != label) continue;
    const float *x = s->of[s->order[i]].x, y[3] = {x[0] - c[0], x[1] - c[1], x[2] - c[2]};
    sum += length2(y);
    n += 1;
  }
  return sum / n;
}

// The new body that index order[at] is amid; -1: none.
static int body_around(const sv_rigid_search *s, int at, const sv_rigid *motion, float centre[][3],
                       const float *near2, int n_bodies) {
  const uint32_t index = s->order[at];
  const sv_displaced *o = &s->of[index];
  voters v;
  find_voters(s, at, &v);
  for (int b = 0; b < n_bodies; b++) {
    int votes = 0, least = MAJORITY;
    float e[3], most = MAX_STRAY * s->tolerance_px;
    for (int i = 0; i < v.n; i++) votes += s->label[v.index[i]] == s->first_label + b && v.d2[i] < near2[b];
    if (votes < MAJORITY) continue;
    if (o->is_known && off2(o, &motion[b], centre[b], e) > most * most) {
      if (!moves(s, index)) return -1; // still: what lies behind or beside it
      least = UNANIMITY;
    }
    return votes >= least ? b : -1;
  }
  return -1;
}

static void take_strays(search *q, const sv_rigid *motion, float centre[][3], int n_bodies) {
  const sv_rigid_search *s = q->s;
  float near2[SV_CAP_BODIES];
  for (int b = 0; b < n_bodies; b++) near2[b] = NEAR * NEAR * size2(s, s->first_label + b, centre[b]);
  int n = 0; // they do not vote themselves: index and label side by side, then taken together
  for (int i = 0; i < s->n; i++) {
    if (s->label[s->order[i]]) continue;
    int b = body_around(s, i, motion, centre, near2, n_bodies);
    if (b >= 0) {
      s->list[n++] = (uint32_t)i;
      s->list[n++] = (uint32_t)b;
    }
  }
  for (int i = 0; i < n; i += 2)
    s->label[s->order[s->list[i]]] = (uint8_t)(s->first_label + (int)s->list[i + 1]);
}

int sv_rigid_find(const sv_rigid_search *s, sv_rigid *motion, float centre[][3]) {
  search q = {.s = s, .rng = sv_rng_make(s->seed, 0), .found = s->list + s->n};
  int n_bodies = 0;
  for (int failed = 0; n_bodies < s->cap_bodies && failed < N_FAILED;) {
    float c[3];
    list_free(&q);
    if (q.n < s->min_members || !best_motion(&q, &motion[n_bodies], c)) break;
    int n = members(&q, &motion[n_bodies], c);
    if (!n) {
      failed++;
      continue;
    }
    for (int i = 0; i < n; i++) s->label[q.found[i]] = (uint8_t)(s->first_label + n_bodies);
    memcpy(centre[n_bodies++], c, sizeof c);
  }
  take_strays(&q, motion, centre, n_bodies);
  return n_bodies;
}
