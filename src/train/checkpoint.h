// SPDX-License-Identifier: Apache-2.0
// A trainer's whole state in a checksummed container: a run that was killed goes on as if nothing
// had happened.
#ifndef SV_TRAIN_CHECKPOINT_H
#define SV_TRAIN_CHECKPOINT_H

#include "src/format/sections.h"
#include "src/train/train.h"

#ifdef __cplusplus
extern "C" {
#endif

#define SV_CHECKPOINT_KIND    "TRNR"
#define SV_CHECKPOINT_VERSION 8

// The most that a checkpoint of the trainer's configuration takes: with all the views that it has
// room for.
size_t sv_checkpoint_bytes(const sv_trainer *t);
sv_status sv_checkpoint_write(const sv_trainer *t, sv_sink sink, sv_err *err) SV_MUST_USE;
// Into a trainer that was initialised with the same sizes. After a failure the trainer is as it
// was, unless the file passed its checksums and still lies about its sizes. E_FORMAT, E_CORRUPT,
// E_RANGE (other sizes, another origin or seed).
sv_status sv_checkpoint_read(sv_trainer *t, const char *name, const void *buf, size_t bytes,
                             sv_err *err) SV_MUST_USE;

#ifdef __cplusplus
}
#endif
#endif
