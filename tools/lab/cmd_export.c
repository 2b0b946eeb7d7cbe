// SPDX-License-Identifier: Apache-2.0
#include "src/base/str.h"
#include "tools/lab/lab.h"
#include "tools/lab/model_formats.h"

static sv_status write_as(const lab_options *o, lab_model *m, const lab_session *se, sv_err *err) {
  if (o->up) sv_copy(m->up, sizeof m->up, o->up); // better known than said in the file
  const sv_model_notes notes = lab_model_notes(m);
  int version = o->spz_version > 0 ? (int)o->spz_version : 4;
  if (sv_str_eq(o->format, "splat")) return lab_write_splat(&m->g, o->out, err);
  if (sv_str_eq(o->format, "spz")) return lab_write_spz(&m->g, m->is_mip, version, notes.up, o->out, err);
  if (sv_str_eq(o->format, "delta"))
    return lab_write_delta(m, se, o->frames > 0 ? (int)o->frames : 25, o->out, err);
  if (sv_str_eq(o->format, "glb")) return lab_write_glb(&m->g, notes.up, o->out, err);
  return lab_model_write(&m->g, &notes, o->out, err);
}

int lab_cmd_export(const lab_options *o) {
  sv_err err = {0};
  lab_session se;
  lab_model m = {0};
  int code = LAB_EXIT_OK;
  sv_status s = lab_session_start(&se, 1, o->is_quiet, &err);
  if (s == SV_OK) s = lab_model_read(&m, o->model, &err);
  if (s == SV_OK) s = write_as(o, &m, &se, &err);
  if (s != SV_OK) code = lab_failed(&se, &err);
  else lab_say(&se, "%s: %d Gaussians as %s", o->out, m.g.n, o->format);
  lab_session_stop(&se);
  lab_model_free(&m);
  return code;
}
