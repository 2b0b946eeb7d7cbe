// SPDX-License-Identifier: Apache-2.0
// Sequences of a moving model (src/format/sequence.h) on disk: written from a model with motion,
// and read as a model that moves.
#ifndef SV_TOOLS_LAB_SEQUENCE_H
#define SV_TOOLS_LAB_SEQUENCE_H

#include "tools/lab/lab.h"

// n_frames: at least 2, evenly from time 0 to 1. st: its scene's center and radius.
sv_status lab_write_sequence(lab_model *m, const lab_session *se, const lab_settings *st, int n_frames,
                             const char *path, sv_err *err) SV_MUST_USE;

bool lab_is_sequence(const void *data, size_t bytes);
// The base model becomes m->g and the frames m->sequence, which takes the file's data: from malloc,
// freed by lab_sequence_free.
sv_status lab_read_sequence(lab_model *m, const sv_file_data *file, sv_err *err) SV_MUST_USE;
// Between two frames all values are interpolated linearly.
sv_status lab_sequence_at(lab_sequence *q, sv_gaussians *g, float t, sv_err *err) SV_MUST_USE;
void lab_sequence_free(lab_sequence *q);

#endif
