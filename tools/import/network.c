// SPDX-License-Identifier: Apache-2.0
#include "tools/import/network.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <strings.h>

#include "src/base/str.h"

static bool is_picture(const char *name) {
  const char *e = sv_path_extension(name);
  return !strcasecmp(e, ".png") || !strcasecmp(e, ".jpg") || !strcasecmp(e, ".jpeg");
}

static void drop_others(sv_names *n, const char *word) {
  int kept = 0;
  for (int i = 0; i < n->n; i++) {
    if (is_picture(n->names[i]) && (!word || strstr(n->names[i], word))) n->names[kept++] = n->names[i];
    else free(n->names[i]);
  }
  n->n = kept;
}

sv_status lab_net_list(lab_net_pictures *p, const lab_options *o, const char *file, size_t n, sv_err *err) {
  char beside[SV_CAP_PATH], inner[SV_CAP_PATH];
  bool has_folder = false;
  memset(p, 0, sizeof *p);
  sv_path_folder(beside, sizeof beside, file);
  sv_status s = o->images ? sv_path_join(p->folder, sizeof p->folder, ".", o->images, err)
                          : sv_path_join(p->folder, sizeof p->folder, beside, "images", err);
  if (s == SV_OK && !sv_path_is_folder(p->folder))
    return sv_fail(err, SV_E_NOT_FOUND, "%s: no such folder; tell the pictures' folder by --images",
                   p->folder);
  if (s == SV_OK && o->stream) {
    s = sv_path_join(inner, sizeof inner, p->folder, o->stream, err);
    has_folder = s == SV_OK && sv_path_is_folder(inner);
    if (has_folder) snprintf(p->prefix, sizeof p->prefix, "%.60s/", o->stream);
  }
  if (s == SV_OK) s = sv_folder_list(has_folder ? inner : p->folder, &p->names, err);
  if (s != SV_OK) return s;
  drop_others(&p->names, has_folder ? NULL : o->stream);
  if ((size_t)p->names.n == n) return SV_OK;
  s = sv_fail(err, SV_E_FORMAT, "%s: has %d pictures, and %s has %zu poses; --images tells the folder",
              has_folder ? inner : p->folder, p->names.n, file, n);
  sv_names_free(&p->names);
  return s;
}

static sv_status path_of(const lab_net_pictures *p, size_t i, char name[SV_TRANSFORMS_CAP_PATH],
                         char path[SV_CAP_PATH], sv_err *err) {
  if (snprintf(name, SV_TRANSFORMS_CAP_PATH, "%s%s", p->prefix, p->names.names[i]) >= SV_TRANSFORMS_CAP_PATH)
    return sv_fail(err, SV_E_RANGE, "%.150s: a name too long", p->names.names[i]);
  return sv_path_join(path, SV_CAP_PATH, p->folder, name, err);
}

sv_status lab_net_size(const lab_net_pictures *p, size_t i, lab_peek *out, sv_err *err) {
  char name[SV_TRANSFORMS_CAP_PATH], path[SV_CAP_PATH];
  sv_status s = path_of(p, i, name, path, err);
  return s == SV_OK ? lab_picture_peek(path, out, err) : s;
}

sv_status lab_net_pose(const char *file, const double m[12], size_t i, sv_pose *out, sv_err *err) {
  double q[4];
  for (int k = 0; k < 12; k++)
    if (!isfinite(m[k])) return sv_fail(err, SV_E_FORMAT, "%s: pose %zu is not finite", file, i);
  for (int r = 0; r < 3; r++) {
    memcpy(out->r + 3 * r, m + 4 * r, 3 * sizeof *m);
    out->t[r] = m[4 * r + 3];
  }
  if (!(sv_rotation_error(out->r) < 1e-2))
    return sv_fail(err, SV_E_FORMAT, "%s: pose %zu is no rotation and translation", file, i);
  sv_quat_from_mat(q, out->r); // networks work in 16 or 32 bits
  sv_quat_to_mat(out->r, q);
  return SV_OK;
}

sv_status lab_net_add(lab_import *im, const lab_net_pictures *p, size_t i, const lab_net_camera *c,
                      sv_err *err) {
  lab_peek size;
  sv_status s = lab_net_size(p, i, &size, err);
  if (s != SV_OK) return s;
  const double lens[4] = {c->k[0] * c->fit.scale[0], c->k[4] * c->fit.scale[1],
                          (c->k[2] - c->fit.shift[0]) * c->fit.scale[0],
                          (c->k[5] - c->fit.shift[1]) * c->fit.scale[1]};
  const double cap = 100.0 * (size.width_px + size.height_px);
  for (int k = 0; k < 4; k++)
    if (!(fabs(lens[k]) < cap) || (k < 2 && !(lens[k] > 1)))
      return sv_fail(err, SV_E_FORMAT, "%s: the focal length or center of pose %zu cannot be right",
                     p->names.names[i], i);
  lab_import_view *v = lab_import_add(im);
  if (!v) return sv_fail(err, SV_E_NOMEM, "no memory for %d views", im->n + 1);
  v->model =
      (sv_camera_model){.kind = SV_MODEL_PINHOLE, .width_px = size.width_px, .height_px = size.height_px};
  memcpy(v->model.p, lens, sizeof lens);
  v->cam_from_world = c->cam_from_world;
  return path_of(p, i, v->name, v->source, err);
}
