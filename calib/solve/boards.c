// SPDX-License-Identifier: Apache-2.0
#include "calib/solve/boards.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "src/base/mathx.h"

#define N_CELLS 5

static size_t at(const sv_boards *b, int camera, int frame) {
  return (size_t)camera * (size_t)b->n_frames + (size_t)frame;
}

static size_t n_corners(const sv_boards *b) { return (size_t)b->n_cols * (size_t)b->n_rows; }

void sv_boards_corner(double out[3], const sv_boards *b, const double warp_m[2], int i, int j) {
  // mrcal's calobject_warp: z = kx (1 - 4 (u - 1/2)^2) + ky (1 - 4 (v - 1/2)^2), u and v from 0 to
  // 1
  double u = (double)i / (b->n_cols - 1) - 0.5, v = (double)j / (b->n_rows - 1) - 0.5;
  out[0] = i * b->spacing_m;
  out[1] = j * b->spacing_m;
  out[2] = warp_m[0] * (1 - 4 * u * u) + warp_m[1] * (1 - 4 * v * v);
}

void sv_boards_free(sv_boards_result *r) {
  for (int c = 0; r->models && c < r->n_cameras; c++) free((double *)r->models[c].spline.control);
  free(r->models);
  free(r->cam_from_rig);
  free(r->rig_from_board);
  free(r->residual_px);
  free(r->is_outlier);
  free(r->board_rms_px);
  free(r->cameras);
  memset(r, 0, sizeof *r);
}

static double largest_tilt(const sv_boards *b, int i_camera, const sv_pose *cam_from_board) {
  double worst = 0;
  for (int f = 0; f < b->n_frames; f++)
    for (int g = 0; g < f; g++) {
      if (!b->is_seen[at(b, i_camera, f)] || !b->is_seen[at(b, i_camera, g)]) continue;
      const double *p = cam_from_board[f].r, *q = cam_from_board[g].r;
      double angle = sv_angle_between((double[3]){p[2], p[5], p[8]}, (double[3]){q[2], q[5], q[8]});
      if (angle > worst) worst = angle;
    }
  return worst * 180 / SV_PI;
}

void sv_boards_measure(const sv_boards *b, int i_camera, const sv_pose *cam_from_board,
                       sv_boards_camera *out) {
  bool is_hit[N_CELLS * N_CELLS] = {false};
  double lo[2] = {1e9, 1e9}, hi[2] = {-1e9, -1e9}, sum[2] = {0, 0};
  long n = 0;
  out->n_boards = 0;
  for (int f = 0; f < b->n_frames; f++) {
    if (!b->is_seen[at(b, i_camera, f)]) continue;
    const double *uv = b->uv_px + 2 * n_corners(b) * at(b, i_camera, f);
    out->n_boards++;
    for (size_t k = 0; k < n_corners(b); k++, n++) {
      int cell[2];
      for (int c = 0; c < 2; c++) {
        double share = uv[2 * k + (size_t)c] / b->size_px[i_camera][c];
        sum[c] += share;
        if (share < lo[c]) lo[c] = share;
        if (share > hi[c]) hi[c] = share;
        cell[c] = sv_clampi((int)(share * N_CELLS), 0, N_CELLS - 1);
      }
      is_hit[cell[1] * N_CELLS + cell[0]] = true;
    }
  }
  int n_hit = 0;
  for (int i = 0; i < N_CELLS * N_CELLS; i++) n_hit += is_hit[i];
  out->coverage = (double)n_hit / (N_CELLS * N_CELLS);
  if (n) {
    out->centre_u = sum[0] / (double)n;
    out->centre_v = sum[1] / (double)n;
    out->spread_u = hi[0] - lo[0];
    out->spread_v = hi[1] - lo[1];
  }
  out->tilt_deg = largest_tilt(b, i_camera, cam_from_board);
}

// --- relative poses ------------------------------------------------------------------------------
static int n_shared(const sv_boards *b, int i, int j) {
  int n = 0;
  for (int f = 0; f < b->n_frames; f++) n += b->is_seen[at(b, i, f)] && b->is_seen[at(b, j, f)];
  return n;
}

static sv_pose relative(const sv_boards *b, const sv_pose *cam_from_board, int to, int from, int frame) {
  sv_pose back = sv_pose_inv(&cam_from_board[at(b, from, frame)]);
  return sv_pose_mul(&cam_from_board[at(b, to, frame)], &back);
}

static double distance(const sv_pose *p, const sv_pose *q, double unit_m) {
  double d[3], w[3], r[9];
  sv_pose inv = sv_pose_inv(q);
  sv_mul33(r, p->r, inv.r);
  sv_rodrigues_inv(w, r);
  sv_sub3(d, p->t, q->t);
  return sv_norm3(w) + sv_norm3(d) / unit_m;
}

// The relative pose that is nearest to all others: a board whose pose was seen the wrong way round
// (a flat board has two that look alike from afar) does not count.
static sv_pose medoid(const sv_boards *b, const sv_pose *cam_from_board, int to, int from) {
  double best = 1e300, unit_m = b->spacing_m * (b->n_cols + b->n_rows);
  sv_pose out = sv_pose_identity();
  for (int f = 0; f < b->n_frames; f++) {
    if (!b->is_seen[at(b, to, f)] || !b->is_seen[at(b, from, f)]) continue;
    sv_pose p = relative(b, cam_from_board, to, from, f);
    double sum = 0;
    for (int g = 0; g < b->n_frames; g++) {
      if (!b->is_seen[at(b, to, g)] || !b->is_seen[at(b, from, g)]) continue;
      sv_pose q = relative(b, cam_from_board, to, from, g);
      sum += distance(&p, &q, unit_m);
    }
    if (sum < best) {
      best = sum;
      out = p;
    }
  }
  return out;
}

// The camera that saw the frame's board largest knows its pose best.
static void place_frame(const sv_boards *b, const sv_pose *cam_from_board, const sv_pose *cam_from_rig,
                        int frame, sv_pose *rig_from_board) {
  double best = 0;
  *rig_from_board = sv_pose_identity();
  for (int c = 0; c < b->n_cameras; c++) {
    if (!b->is_seen[at(b, c, frame)]) continue;
    const double *uv = b->uv_px + 2 * n_corners(b) * at(b, c, frame);
    size_t last = n_corners(b) - 1;
    double w = b->size_px[c][0], u = (uv[2 * last] - uv[0]) / w, v = (uv[2 * last + 1] - uv[1]) / w;
    if (u * u + v * v <= best) continue;
    best = u * u + v * v;
    sv_pose back = sv_pose_inv(&cam_from_rig[c]);
    *rig_from_board = sv_pose_mul(&back, &cam_from_board[at(b, c, frame)]);
  }
}

sv_status sv_boards_chain(const sv_boards *b, const sv_pose *cam_from_board, sv_pose *cam_from_rig,
                          sv_pose *rig_from_board, sv_err *err) {
  bool is_done[SV_BOARDS_CAP_CAMERAS] = {true};
  cam_from_rig[0] = sv_pose_identity();
  for (int n = 1; n < b->n_cameras; n++) {
    int best = 0, to = -1, from = -1;
    for (int i = 0; i < b->n_cameras; i++)
      for (int j = 0; j < b->n_cameras && !is_done[i]; j++)
        if (is_done[j] && n_shared(b, i, j) > best) {
          best = n_shared(b, i, j);
          to = i;
          from = j;
        }
    if (to < 0) {
      for (to = 0; is_done[to];) to++;
      return sv_fail(err, SV_E_FORMAT,
                     "%s never saw the board at the same time as %s or a camera linked to it: take images in "
                     "which both see the whole board",
                     b->names[to], b->names[0]);
    }
    sv_pose p = medoid(b, cam_from_board, to, from);
    cam_from_rig[to] = sv_pose_mul(&p, &cam_from_rig[from]);
    is_done[to] = true;
  }
  for (int f = 0; f < b->n_frames; f++) place_frame(b, cam_from_board, cam_from_rig, f, &rig_from_board[f]);
  return SV_OK;
}
