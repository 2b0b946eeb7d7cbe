// SPDX-License-Identifier: Apache-2.0
// The folder of the paper's authors -> datasets of ours, one for each scene and capture. It reads
// what their release holds and what their `prepare` makes of it; it finds no poses and decodes no
// videos.
//   static_SCENE_CAPTURE   one exposure; CAPTURE is iphone, stereo or lightfield
//   casual_SCENE_CAPTURE   training and evaluation videos; CAPTURE is iphone or stereo
//   dynamic_SCENE_CAPTURE  moving scenes of cameras that stand still
//   synthetic_SCENE        five devices, 1 and 3 exposures
//   multiplexed            one measurement without held-out views
// A dataset has transforms_train_DEVICE.json for the device and for its own single camera (mono),
// or transforms_train_DEVICE_Nviews.json, and transforms_test.json: what `tables` reads.
#ifndef SV_TOOLS_IMPORT_RELEASE_H
#define SV_TOOLS_IMPORT_RELEASE_H

#include "tools/import/import.h"

typedef struct {
  lab_session *se;
  const char *data; // the folder that holds casual, dynamic, multiplexed and synthetic
  const char *out;
  int n_made, n_without_poses;
} lab_release;

// Each looks at one kind of scenes; SV_OK when there are none.
sv_status lab_release_static(lab_release *r, sv_err *err) SV_MUST_USE;
sv_status lab_release_casual(lab_release *r, sv_err *err) SV_MUST_USE;
sv_status lab_release_dynamic(lab_release *r, sv_err *err) SV_MUST_USE;
sv_status lab_release_synthetic(lab_release *r, sv_err *err) SV_MUST_USE;
sv_status lab_release_multiplexed(lab_release *r, sv_err *err) SV_MUST_USE;

// --- what they share (release.c) -----------------------------------------------------------------

// OUT/KIND_SCENE[_CAPTURE], made. capture NULL: none.
sv_status lab_release_folder(const lab_release *r, char out[SV_CAP_PATH], const char *const name[3],
                             sv_err *err) SV_MUST_USE;
// A dataset is complete: says so.
void lab_release_made(lab_release *r, const char *folder, const char *fmt, ...) SV_PRINTF(3, 4);
// Whether `word` stands in `text`, in any case, with no letter or digit beside it: so the authors
// choose streams by name ("wide" is not in "ultrawide").
bool lab_release_has_word(const char *text, const char *word);
// Lines of a list of names (splits/*.txt) without comments; n 0 when the file is not there.
sv_status lab_release_names(sv_names *out, const char *folder, const char *file, sv_err *err) SV_MUST_USE;
bool lab_release_is_named(const sv_names *names, const char *name);
// The same pinhole with 1/k of the pixels a side, sizes rounded down.
void lab_release_reduce_model(sv_camera_model *m, int k);
// Copies the view; E_NOMEM.
sv_status lab_release_copy(lab_import *to, const lab_import_view *v, sv_err *err) SV_MUST_USE;
// Synthetic test views get the depth of SCENE/positions, where that is there; images go to
// FOLDER/images.
sv_status lab_release_positions(const lab_release *r, lab_import *im, const char *scene, const char *folder,
                                sv_err *err) SV_MUST_USE;
// Calls fn for each subfolder of data/KIND, by name.
typedef sv_status lab_release_scene_fn(lab_release *r, const char *folder, const char *scene, sv_err *err);
sv_status lab_release_scenes(lab_release *r, const char *kind, lab_release_scene_fn *fn,
                             sv_err *err) SV_MUST_USE;

#endif
