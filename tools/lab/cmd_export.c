// SPDX-License-Identifier: Apache-2.0
#include <stdio.h>
#include <stdlib.h>

#include "src/base/str.h"
#include "src/format/splat_file.h"
#include "tools/lab/lab.h"

typedef struct {
  float order;
  int i;
} ranked;

static int by_order(const void *a, const void *b) { // largest first; equal ones stay in the model's order
  const ranked *x = a, *y = b;
  return x->order > y->order ? -1 : x->order < y->order ? 1 : (x->i > y->i) - (x->i < y->i);
}

static sv_status write_splat(const sv_gaussians *g, const char *path, sv_err *err) {
  ranked *rank = malloc((size_t)g->n * sizeof *rank);
  uint8_t *out = malloc((size_t)g->n * SV_SPLAT_BYTES);
  sv_status s = rank && out ? SV_OK : sv_fail(err, SV_E_NOMEM, "%s: no memory for %d Gaussians", path, g->n);
  sv_gaussian v;
  for (int i = 0; s == SV_OK && i < g->n; i++) {
    sv_gaussians_get(g, i, &v);
    rank[i] = (ranked){sv_splat_order(&v), i};
  }
  if (s == SV_OK) qsort(rank, (size_t)g->n, sizeof *rank, by_order);
  for (int i = 0; s == SV_OK && i < g->n; i++) {
    sv_gaussians_get(g, rank[i].i, &v);
    sv_splat_encode(&v, out + (size_t)i * SV_SPLAT_BYTES);
  }
  if (s == SV_OK) s = sv_file_write(path, out, (size_t)g->n * SV_SPLAT_BYTES, err);
  free(rank);
  free(out);
  return s;
}

int lab_cmd_export(const lab_options *o) {
  sv_err err = {0};
  lab_session se;
  lab_model m = {0};
  int code = LAB_EXIT_OK;
  sv_status s = lab_session_start(&se, 1, o->is_quiet, &err);
  if (s == SV_OK) s = lab_model_read(&m, o->model, &err);
  if (s == SV_OK)
    s = sv_str_eq(o->format, "splat") ? write_splat(&m.g, o->out, &err)
                                      : lab_model_write(&m.g, m.is_mip, m.dilation_px2, o->out, &err);
  if (s != SV_OK) code = lab_failed(&se, &err);
  else lab_say(&se, "%s: %d Gaussians as %s", o->out, m.g.n, o->format);
  lab_session_stop(&se);
  lab_model_free(&m);
  return code;
}
