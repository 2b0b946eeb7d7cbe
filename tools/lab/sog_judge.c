// SPDX-License-Identifier: Apache-2.0
#include "tools/lab/sog_judge.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "src/metric/metric.h"

// Renders view v. is_first: keeps the image; else adds the squared differences from it to *sum.
static sv_status look(sog_judge *j, const sv_gaussians *g, int v, bool is_first, double *sum, sv_err *err) {
  const int w = j->view[v].width_px, h = j->view[v].height_px;
  float *kept = j->image + (size_t)v * 3 * (size_t)w * (size_t)h;
  const sv_status st = sv_render(&j->viewer.r, g, &j->view[v], &j->render);
  if (st < 0) return sv_fail(err, st, "the model cannot be rendered: %s", sv_status_text(st));
  const sv_planes *p = &j->viewer.r.rgb;
  for (int c = 0; c < 3; c++)
    for (int y = 0; y < h; y++)
      for (int x = 0; x < w; x++, kept++) {
        const float f = fminf(fmaxf(p->c[c][(size_t)y * (size_t)p->stride + (size_t)x], 0), 1);
        if (is_first) *kept = f;
        *sum += (double)((f - *kept) * (f - *kept));
      }
  return SV_OK;
}

sv_status sog_judge_start(sog_judge *j, const sv_gaussians *g, sv_err *err) {
  const int w = j->view[0].width_px, h = j->view[0].height_px;
  double sum = 0;
  j->image = malloc((size_t)j->n_views * 3 * (size_t)w * (size_t)h * sizeof *j->image);
  if (!j->image) return sv_fail(err, SV_E_NOMEM, "no memory for %d images", j->n_views);
  const sv_renderer_cfg cfg = {.cap_gaussians = g->n, .cap_width_px = w, .cap_height_px = h};
  sv_status s = lab_viewer_start(&j->viewer, j->session, cfg, err);
  for (int v = 0; s == SV_OK && v < j->n_views; v++) s = look(j, g, v, true, &sum, err);
  return s;
}

void sog_judge_stop(sog_judge *j) {
  lab_viewer_stop(&j->viewer);
  free(j->image);
  j->image = NULL;
}

sv_status sog_judge_ask(sog_judge *j, const sv_gaussians *quantized, double *psnr, sv_err *err) {
  double sum = 0;
  sv_status s = SV_OK;
  for (int v = 0; s == SV_OK && v < j->n_views; v++) s = look(j, quantized, v, false, &sum, err);
  *psnr = sv_psnr_of_mse(sum / (3.0 * j->n_views * j->view[0].width_px * j->view[0].height_px));
  return s;
}
