// SPDX-License-Identifier: Apache-2.0
#include "tools/train/appearance.h"

#include "src/base/str.h"

static int camera_number(const lab_frame *f) { return f->f.sub_view; }
static int exposure_number(const lab_frame *f) { return f->f.exposure; }

// The place of a frame's number among those of all frames, in the order of the file. Frames without
// a number share one (is_shared), or each has its own.
static int place_of(const lab_views *v, int i_frame, int (*number)(const lab_frame *f), bool is_shared) {
  int n = 0;
  for (int i = 0; i <= i_frame; i++) {
    const int x = number(&v->frames[i]);
    bool is_new = true;
    int at = 0;
    for (int k = 0; k < i && is_new; k++) is_new = number(&v->frames[k]) != x || (x < 0 && !is_shared);
    if (is_new && i == i_frame) return n;
    if (is_new) {
      at = n++;
      if (number(&v->frames[i_frame]) == x && (x >= 0 || is_shared)) return at;
    }
  }
  return n;
}

static int camera_of(const lab_views *v, int i) { return place_of(v, i, camera_number, true); }
static int exposure_of(const lab_views *v, int i) { return place_of(v, i, exposure_number, false); }

sv_status lab_appearance_plan(const lab_views *v, const char *mode, sv_train_cfg *cfg, sv_err *err) {
  if (!mode || sv_str_eq(mode, "off")) return SV_OK;
  if (cfg->has_motion || v->n_measurements)
    return sv_fail(err, SV_E_UNSUPPORTED,
                   "--appearance %s: for still scenes, and not for measurements of multiplexed sensors",
                   mode);
  sv_appearance_cfg *a = &cfg->appearance;
  for (int i = 0; i < v->n; i++) {
    const int camera = camera_of(v, i), exposure = exposure_of(v, i);
    if (camera >= a->n_cameras) a->n_cameras = camera + 1;
    if (exposure >= a->n_exposures) a->n_exposures = exposure + 1;
  }
  if (sv_str_eq(mode, "exposures")) return SV_OK;
  a->n_exposures = 0;
  if (a->n_cameras < 2)
    return sv_fail(
        err, SV_E_ARG,
        "--appearance cameras: the frames name one camera (\"sub_view\"); with exposures each frame "
        "or exposure has a color of its own");
  return SV_OK;
}

void lab_appearance_set(const lab_views *v, int i_frame, sv_trainer *t, int i_view) {
  if (t->cfg.appearance.n_cameras > 0)
    sv_train_set_appearance(t, i_view, camera_of(v, i_frame), exposure_of(v, i_frame));
}
