// SPDX-License-Identifier: Apache-2.0
#include "src/train/mask.h"

#include "src/base/mathx.h"

#define BAND_ROWS 32

typedef struct {
  const sv_image_u8 *im;
  int scale;
  const sv_planes *from; // NULL: zeros
  sv_planes *to;
} job;

static void mask_task(void *arg, int i_task, int i_thread) {
  const job *j = arg;
  (void)i_thread;
  for (int y = i_task * BAND_ROWS; y < sv_mini((i_task + 1) * BAND_ROWS, j->to->height_px); y++)
    for (int x = 0; x < j->to->width_px; x++) {
      const size_t at = (size_t)y * (size_t)j->to->stride + (size_t)x;
      if (sv_image_counts(j->im, j->scale, x, y)) continue;
      for (int c = 0; c < 3; c++) j->to->c[c][at] = j->from ? j->from->c[c][at] : 0.0f;
    }
}

static void run(const sv_trainer *t, job *j) {
  if (!j->im || !j->im->mask) return;
  sv_pool_run(t->compute.pool, mask_task, j, (j->to->height_px + BAND_ROWS - 1) / BAND_ROWS);
}

void sv_train_mask_copy(const sv_trainer *t, const sv_image_u8 *im, int scale, const sv_planes *from,
                        sv_planes *to) {
  run(t, &(job){im, scale, from, to});
}

void sv_train_mask_clear(const sv_trainer *t, const sv_image_u8 *im, int scale, sv_planes *to) {
  run(t, &(job){im, scale, NULL, to});
}
