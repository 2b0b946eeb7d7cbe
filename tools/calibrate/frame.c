// SPDX-License-Identifier: Apache-2.0
#include <stdlib.h>

#include "platform/linux/linux.h"
#include "tools/calibrate/calibrate.h"

int cal_frame_run(const cal_options *o, size_t job_bytes, size_t block_bytes, cal_work *work) {
  lab_session se;
  sv_err err = {0};
  void *job = calloc(1, job_bytes);
  uint8_t *block = malloc(block_bytes);
  sv_status s = lab_session_start(&se, o->threads, o->is_quiet, &err);
  if (s == SV_OK) s = sv_linux_catch_signals(&err);
  if (s == SV_OK && (!job || !block)) s = sv_fail(&err, SV_E_NOMEM, "no memory");
  if (s == SV_OK) {
    const cal_frame frame = {o, &se, sv_arena_make(block, block_bytes / 2),
                             sv_arena_make(block + block_bytes / 2, block_bytes / 2)};
    s = work(job, &frame, &err);
  }
  if (s != SV_OK) lab_failed(&se, &err);
  lab_session_stop(&se);
  free(job);
  free(block);
  return s == SV_OK ? CAL_EXIT_OK : CAL_EXIT_FAILED;
}
