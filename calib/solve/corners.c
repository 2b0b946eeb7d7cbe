// SPDX-License-Identifier: Apache-2.0
#include "calib/solve/corners.h"

#include <math.h>
#include <string.h>

typedef struct {
  const sv_corners_job *job;
  double *uv;
} grid;

static const double *corner(const grid *g, int i, int j) {
  return g->uv + 2 * ((size_t)j * (size_t)g->job->n_cols + (size_t)i);
}

// How much darker the squares of the first one's color are than the others: a sum over the middles
// of the inner squares.
static double first_is_black(const grid *g) {
  double sum = 0;
  for (int j = 0; j + 1 < g->job->n_rows; j++)
    for (int i = 0; i + 1 < g->job->n_cols; i++) {
      double x = 0, y = 0;
      for (int k = 0; k < 4; k++) {
        const double *c = corner(g, i + k % 2, j + k / 2);
        x += 0.25 * c[0];
        y += 0.25 * c[1];
      }
      int u = (int)floor(x), v = (int)floor(y);
      if (u < 0 || v < 0 || u >= g->job->width_px || v >= g->job->height_px) continue;
      double value = g->job->grey[(size_t)v * (size_t)g->job->width_px + (size_t)u];
      sum += (i + j) % 2 ? value : -value;
    }
  return sum;
}

// Is the order clockwise in the image, as a board's front shows it (y down)?
static bool is_front(const grid *g) {
  const double *o = corner(g, 0, 0), *x = corner(g, g->job->n_cols - 1, 0),
               *y = corner(g, 0, g->job->n_rows - 1);
  return (x[0] - o[0]) * (y[1] - o[1]) - (x[1] - o[1]) * (y[0] - o[0]) > 0;
}

static void swap_corners(grid *g, int a, int b) {
  for (int k = 0; k < 2; k++) {
    double t = g->uv[2 * a + k];
    g->uv[2 * a + k] = g->uv[2 * b + k];
    g->uv[2 * b + k] = t;
  }
}

static void mirror(grid *g) {
  int n = g->job->n_cols;
  for (int j = 0; j < g->job->n_rows; j++)
    for (int i = 0; i < n / 2; i++) swap_corners(g, j * n + i, j * n + n - 1 - i);
}

static void half_turn(grid *g) {
  int n = g->job->n_cols * g->job->n_rows;
  for (int i = 0; i < n / 2; i++) swap_corners(g, i, n - 1 - i);
}

static void quarter_turn(grid *g) { // square boards only: transpose, then mirror
  int n = g->job->n_cols;
  for (int j = 0; j < n; j++)
    for (int i = 0; i < j; i++) swap_corners(g, j * n + i, i * n + j);
  mirror(g);
}

// How far the first corner lies towards the top left of the last.
static double upright(const grid *g) {
  const double *a = corner(g, 0, 0), *b = corner(g, g->job->n_cols - 1, g->job->n_rows - 1);
  return b[0] - a[0] + b[1] - a[1];
}

static void put_in_order(grid *g) {
  const sv_corners_job *job = g->job;
  if (!is_front(g)) mirror(g);
  if ((job->n_cols + job->n_rows) % 2) {
    if (first_is_black(g) < 0) half_turn(g);
    return;
  }
  double best = upright(g);
  int n_turns = job->n_cols == job->n_rows ? 4 : 2, best_turn = 0;
  for (int k = 1; k < n_turns; k++) {
    if (n_turns == 4) quarter_turn(g);
    else half_turn(g);
    // a board lying on its corner has two equal choices: the later must be clearly better
    if (upright(g) > best * 1.0001) {
      best = upright(g);
      best_turn = k;
    }
  }
  for (int k = n_turns - 1; k != best_turn + n_turns; k++) {
    if (n_turns == 4) quarter_turn(g);
    else half_turn(g);
  }
}

bool sv_corners_find(const sv_corners_job *job, double *uv_px) {
  grid g = {job, uv_px};
  bool is_found = job->n_cols == job->n_rows && sv_corners_mrgingham(job, uv_px);
  if (!is_found) is_found = sv_corners_opencv(job, uv_px);
  if (is_found) put_in_order(&g);
  return is_found;
}

sv_status sv_corners_available(int n_cols, int n_rows, sv_err *err) {
  if (sv_corners_has_opencv() || (n_cols == n_rows && sv_corners_has_mrgingham())) return SV_OK;
  return sv_fail(err, SV_E_UNSUPPORTED,
                 "this build cannot find the corners of a %dx%d board: it was built without OpenCV "
                 "(libopencv-dev)%s",
                 n_cols, n_rows, n_cols == n_rows ? " and mrgingham (libmrgingham-dev)" : "");
}
