// SPDX-License-Identifier: Apache-2.0
// Motion's part of a checkpoint (src/train/checkpoint.h). Hooks of the trainer's; self is an
// sv_dynamic.
#ifndef SV_DYNAMIC_CHECKPOINT_H
#define SV_DYNAMIC_CHECKPOINT_H

#include "src/dynamic/dynamic.h"

#ifdef __cplusplus
extern "C" {
#endif

size_t sv_dynamic_checkpoint_bytes(const void *self);
void sv_dynamic_save_head(const void *self, sv_checkpoint_motion *head);
sv_status sv_dynamic_save(const void *self, sv_sections_writer *w, sv_err *err) SV_MUST_USE;
bool sv_dynamic_is_loadable(const void *self, const sv_checkpoint_motion *head);
sv_status sv_dynamic_load(void *self, const sv_sections *r, const sv_checkpoint_motion *head,
                          sv_err *err) SV_MUST_USE;

#ifdef __cplusplus
}
#endif
#endif
