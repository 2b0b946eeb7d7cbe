// SPDX-License-Identifier: Apache-2.0
#include <stdlib.h>
#include <string.h>

#include "src/format/cameramodel.h"
#include "src/format/rig_file.h"
#include "tools/calibrate/calibrate.h"
#include "tools/common/coverage.h"

#define JSON_BYTES  (SV_CAP_SUB_VIEWS * 1200 + 1024)
#define MODEL_BYTES (512 * 1024)

static sv_status save(const char *folder, const char *name, const sv_str *text, sv_err *err) {
  char path[SV_CAP_PATH];
  sv_status s = sv_path_join(path, sizeof path, folder, name, err);
  return s == SV_OK ? sv_file_write(path, text->buf, text->len, err) : s;
}

// names: of the images that are there already, or NULL: coverage is written.
static sv_status write_all(const char *folder, const sv_rig *rig, const sv_coverage_names *there, char *text,
                           sv_err *err) {
  sv_coverage_names *names = calloc(1, sizeof *names);
  sv_status s = names ? SV_OK : sv_fail(err, SV_E_NOMEM, "%s: no memory to write the rig", folder);
  if (names && there) *names = *there;
  for (int i = 0; i < rig->n_sub_views && s == SV_OK; i++) {
    const sv_sub_view *v = &rig->sub_views[i];
    char name[80];
    sv_str t = sv_str_make(text, MODEL_BYTES);
    s = sv_cameramodel_write(&t, &v->model, &v->cam_from_rig);
    if (s != SV_OK) s = sv_fail(err, s, "%s: the lens model of %s is too large to write", folder, v->name);
    sv_fmt(name, sizeof name, "%s.cameramodel", v->name);
    if (s == SV_OK) s = save(folder, name, &t, err);
    if (s == SV_OK && !there && v->footprint.coverage) {
      sv_fmt(names->name[i], sizeof names->name[i], "%s.coverage.png", v->name);
      s = sv_coverage_save(folder, names->name[i], &v->footprint, err);
    }
  }
  sv_str j = sv_str_make(text, JSON_BYTES);
  if (s == SV_OK && sv_rig_json_write_coverage(&j, rig, names) != SV_OK)
    s = sv_fail(err, SV_E_NOMEM, "%s: the rig's description is longer than %d bytes", folder, JSON_BYTES);
  if (s == SV_OK) s = save(folder, "rig.json", &j, err);
  free(names);
  return s;
}

static sv_status write_rig(const char *folder, const sv_rig *rig, const sv_coverage_names *there,
                           sv_err *err) {
  char *text = malloc(MODEL_BYTES > JSON_BYTES ? MODEL_BYTES : JSON_BYTES);
  sv_status s = text ? sv_path_make_folder(folder, err) : sv_fail(err, SV_E_NOMEM, "%s: no memory", folder);
  if (s == SV_OK) s = write_all(folder, rig, there, text, err);
  free(text);
  return s;
}

sv_status cal_rig_write(const char *folder, const sv_rig *rig, sv_err *err) {
  return write_rig(folder, rig, NULL, err);
}

sv_status cal_rig_update(const char *folder, const sv_rig *rig, const sv_coverage_names *names, sv_err *err) {
  return write_rig(folder, rig, names, err);
}
