// SPDX-License-Identifier: Apache-2.0
// Which frames to train on, and which test views are near them.
#include <stdlib.h>
#include <string.h>

#include "src/rig/dispersion.h"
#include "tools/dataset/dataset.h"

static int count(const bool *is_in, int n) {
  int k = 0;
  for (int i = 0; i < n; i++) k += is_in[i];
  return k;
}

// Up for elevations: the mean up of images from all sides is a few degrees off, and datasets have
// their up along an axis; within 32 degrees of one, that axis is taken.
static void up_of(double up[3], const lab_scene *scene) {
  for (int k = 0; k < 3; k++) up[k] = (double)scene->up[k];
  for (int k = 0; k < 3; k++)
    if (fabs(up[k]) > 0.85) {
      double sign = up[k] < 0 ? -1 : 1;
      up[0] = up[1] = up[2] = 0;
      up[k] = sign;
      return;
    }
}

static sv_status choose(const sv_transforms_frame *frames, const int *from, int n, int n_wanted, int *chosen,
                        sv_err *err) {
  lab_views v = {.frames = calloc((size_t)n, sizeof *v.frames), .n = n};
  double(*at)[3] = malloc((size_t)n * sizeof *at);
  double *scratch = malloc(sv_dispersion_scratch(n) * sizeof *scratch);
  sv_status s = SV_E_NOMEM;
  if (v.frames && at && scratch) {
    for (int i = 0; i < n; i++) {
      v.frames[i].f = frames[from[i]];
      sv_pose_centre(at[i], &frames[from[i]].cam_from_world);
    }
    lab_scene scene = lab_scene_of(&v);
    double up[3];
    up_of(up, &scene);
    sv_dispersion d = {.n = n, .at = (const double(*)[3])at, .up = up};
    for (int k = 0; k < 3; k++) d.centre[k] = (double)scene.centre[k];
    s = sv_disperse(&d, n_wanted, chosen, scratch);
  }
  free(v.frames);
  free(at);
  free(scratch);
  return s == SV_OK ? SV_OK : sv_fail(err, s, "could not choose %d of %d views", n_wanted, n);
}

sv_status lab_disperse_frames(const sv_transforms_frame *frames, int n_frames, int n_wanted, bool *is_in,
                              sv_err *err) {
  int n = count(is_in, n_frames), k = 0;
  if (n <= n_wanted) return SV_OK;
  int *from = malloc((size_t)n * sizeof *from), *chosen = malloc((size_t)n * sizeof *chosen);
  sv_status s = from && chosen ? SV_OK : sv_fail(err, SV_E_NOMEM, "no memory to choose among %d views", n);
  for (int i = 0; s == SV_OK && i < n_frames; i++)
    if (is_in[i]) from[k++] = i;
  if (s == SV_OK) s = choose(frames, from, n, n_wanted, chosen, err);
  if (s == SV_OK) memset(is_in, 0, (size_t)n_frames * sizeof *is_in);
  for (int i = 0; s == SV_OK && i < n_wanted; i++) is_in[from[chosen[i]]] = true;
  free(from);
  free(chosen);
  return s;
}

void lab_mean_centre(const sv_transforms_frame *frames, int n_frames, const bool *is_in, double centre[3]) {
  int n = count(is_in, n_frames);
  centre[0] = centre[1] = centre[2] = 0;
  for (int i = 0; i < n_frames; i++) {
    double c[3];
    if (!is_in[i]) continue;
    sv_pose_centre(c, &frames[i].cam_from_world);
    for (int k = 0; k < 3; k++) centre[k] += c[k] / n;
  }
}

void lab_keep_nearest(const sv_transforms_frame *frames, int n_frames, const double centre[3], int n_wanted,
                      bool *is_in) {
  for (int n = count(is_in, n_frames); n > n_wanted; n--) { // of equals the later one goes
    int far = -1;
    double most = -1;
    for (int i = 0; i < n_frames; i++) {
      double c[3];
      if (!is_in[i]) continue;
      sv_pose_centre(c, &frames[i].cam_from_world);
      sv_sub3(c, c, centre);
      if (sv_dot3(c, c) >= most) {
        most = sv_dot3(c, c);
        far = i;
      }
    }
    is_in[far] = false;
  }
}
