// SPDX-License-Identifier: Apache-2.0
// A moving model as a sequence of frames (src/format/sequence.h).
// Owns nothing. Never decides when or where it is saved.
#ifndef SV_DEFORM_DEFORM_SEQUENCE_H
#define SV_DEFORM_DEFORM_SEQUENCE_H

#include "src/deform/deform.h"
#include "src/format/sequence.h"

#ifdef __cplusplus
extern "C" {
#endif

// Bytes of scratch for a model of n Gaussians, aligned to 8.
size_t sv_deform_sequence_bytes(int n, int n_frames);
// Writes h->n_frames frames, evenly from time 0 to 1. Of h the caller fills n_frames, group (0:
// the usual one) and what is known of the model; numbers of Gaussians and the SH degree are filled
// in here. The Gaussians stand at time 1 afterwards.
sv_status sv_deform_write_sequence(sv_deform *d, const sv_compute *c, sv_gaussians *g,
                                   const sv_sequence_head *h, void *scratch, sv_sink sink,
                                   sv_err *err) SV_MUST_USE;

#ifdef __cplusplus
}
#endif
#endif
