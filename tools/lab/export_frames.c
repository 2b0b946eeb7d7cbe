// SPDX-License-Identifier: Apache-2.0
// A moving model as numbered still models, as SuperSplat and Brush play them from a folder.
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "src/base/str.h"
#include "tools/lab/model_formats.h"

// The Gaussians of a time become the stored ones.
static void take_moved(sv_gaussians *g) {
  const size_t n_rows = (size_t)g->n_rows;
  for (int i = 0; i < g->n_moved; i++)
    for (size_t r = 0; r < n_rows; r++) {
      const size_t at = ((size_t)(i >> 4) * n_rows + r) * 16 + (size_t)(i & 15);
      g->param[at] = g->moved[at];
    }
  g->moved = NULL;
  g->n_moved = 0;
}

sv_status lab_write_frames(lab_model *m, lab_session *se, const lab_frames *f, sv_err *err) {
  char name[64], path[SV_CAP_PATH], up[sizeof m->up];
  const sv_gaussians stored = m->g;
  const size_t bytes = (size_t)m->g.cap * (size_t)m->g.n_rows * sizeof(float);
  const lab_motion motion = lab_model_motion(m);
  if (!lab_moves(&motion))
    return sv_fail(err, SV_E_NOT_FOUND,
                   "the model is static (no motion.bin beside it); --frames needs a moving one");
  float *param = malloc(bytes);
  if (!param) return sv_fail(err, SV_E_NOMEM, "%s: no memory for a frame", f->folder);
  memcpy(param, m->g.param, bytes);
  memcpy(up, m->up, sizeof up);
  sv_status s = lab_session_folder(se, f->folder, err);
  for (int k = 0; k < f->n && s == SV_OK; k++) {
    if (lab_is_stopped(se))
      s = sv_fail(err, SV_E_INTERRUPTED, "stopped by request at frame %d of %d", k, f->n);
    if (s == SV_OK) s = lab_motion_at(&motion, se, &m->g, (float)k / (float)(f->n - 1), err);
    if (s != SV_OK) break;
    take_moved(&m->g);
    snprintf(name, sizeof name, "frame_%04d%s", k, f->extension);
    s = sv_path_join(path, sizeof path, f->folder, name, err);
    if (s == SV_OK) s = f->write(f->o, m, se, path, err);
    snprintf(name, sizeof name, "wrote %d of %d frames", k + 1, f->n);
    se->console.log(se->console.self, SV_LOG_LIVE, name);
    m->g = stored; // what was turned or cropped
    memcpy(m->g.param, param, bytes);
    memcpy(m->up, up, sizeof up);
  }
  free(param);
  return s;
}
