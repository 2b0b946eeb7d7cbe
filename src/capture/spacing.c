// SPDX-License-Identifier: Apache-2.0
#include "src/capture/spacing.h"

#include <math.h>
#include <string.h>

#include "src/base/mathx.h"

#define N_CELLS       (SV_SPACING_ROWS * SV_SPACING_COLS)
#define REACH         4     // cells to each side in which the old thumbnail is looked for
#define FLAT          0.02f // standard deviation over the mean, below which motion cannot be seen
#define MIN_EXPLAINED 0.5f  // of the variance; less is another picture

void sv_spacing_init(sv_spacing *s, const sv_spacing_cfg *cfg, sv_spacing_cells *cells) {
  *s = (sv_spacing){.cfg = *cfg, .cell = cells};
}

static bool is_of_turn(const sv_spacing *s, const sv_spacing_exposure *e) {
  return s->n_left > 0 && e->shutter_ns != s->shutter_ns;
}

bool sv_spacing_is_due(const sv_spacing *s, const sv_spacing_exposure *e) {
  return !s->has_kept || s->cfg.every_ns <= 0 || e->time_ns >= s->due_ns - s->cfg.early_ns ||
         is_of_turn(s, e);
}

static void thumbnail(const sv_image_u8 *im, float *cell) {
  for (int r = 0; r < SV_SPACING_ROWS; r++)
    for (int c = 0; c < SV_SPACING_COLS; c++) {
      const int x0 = c * im->width_px / SV_SPACING_COLS, y0 = r * im->height_px / SV_SPACING_ROWS,
                x1 = sv_maxi((c + 1) * im->width_px / SV_SPACING_COLS, x0 + 1),
                y1 = sv_maxi((r + 1) * im->height_px / SV_SPACING_ROWS, y0 + 1);
      uint32_t sum = 0;
      for (int y = y0; y < y1; y++) {
        const uint8_t *p = im->px + (size_t)y * (size_t)im->stride_bytes + 3 * (size_t)x0;
        for (int x = x0; x < x1; x++, p += 3) sum += p[0] + 2u * p[1] + p[2];
      }
      cell[r * SV_SPACING_COLS + c] = (float)sum / (float)(4 * (x1 - x0) * (y1 - y0));
    }
}

// Mean zero and variance one, so that exposure time and gain cancel. False: it is flat.
static bool normalize(float *cell) {
  float sum = 0, sum2 = 0;
  for (int i = 0; i < N_CELLS; i++) sum += cell[i];
  const float mean = sum / N_CELLS;
  for (int i = 0; i < N_CELLS; i++) sum2 += (cell[i] - mean) * (cell[i] - mean);
  const float deviation = sqrtf(sum2 / N_CELLS);
  if (!(deviation > FLAT * mean) || !(mean > 0)) return false;
  for (int i = 0; i < N_CELLS; i++) cell[i] = (cell[i] - mean) / deviation;
  return true;
}

// Mean squared difference of b and of a moved by (dx, dy), where both are.
static float difference(const float *a, const float *b, int dx, int dy) {
  float sum = 0;
  int n = 0;
  for (int r = sv_maxi(dy, 0); r < SV_SPACING_ROWS + sv_mini(dy, 0); r++)
    for (int c = sv_maxi(dx, 0); c < SV_SPACING_COLS + sv_mini(dx, 0); c++, n++) {
      const float d = b[r * SV_SPACING_COLS + c] - a[(r - dy) * SV_SPACING_COLS + c - dx];
      sum += d * d;
    }
  return sum / (float)n;
}

bool sv_spacing_has_moved(sv_spacing *s, const sv_image_u8 *image, const sv_spacing_exposure *e) {
  if (!s->cfg.is_by_motion || is_of_turn(s, e)) return true;
  thumbnail(image, s->cell[1]);
  const bool is_flat = !normalize(s->cell[1]);
  if (is_flat) memset(s->cell[1], 0, sizeof s->cell[1]);
  if (!s->has_kept || e->time_ns - s->kept_ns >= SV_SPACING_STILL_NS) return true;
  if (is_flat) return false;
  int best_x = 0, best_y = 0;
  float best = difference(s->cell[0], s->cell[1], 0, 0);
  for (int dy = -REACH; dy <= REACH; dy++)
    for (int dx = -REACH; dx <= REACH; dx++) {
      const float d = difference(s->cell[0], s->cell[1], dx, dy);
      if (d >= best) continue;
      best = d;
      best_x = dx;
      best_y = dy;
    }
  return best_x * best_x + best_y * best_y >= SV_SPACING_MOVED * SV_SPACING_MOVED ||
         best > 2 * (1 - MIN_EXPLAINED);
}

void sv_spacing_keep(sv_spacing *s, const sv_spacing_exposure *e) {
  const sv_ns time_ns = e->time_ns;
  const bool is_more = is_of_turn(s, e);
  s->shutter_ns = e->shutter_ns;
  s->n_left = is_more ? s->n_left - 1 : s->cfg.n_brackets - 1;
  if (is_more) return;
  // On the grid of times, so that frame times do not add up; anew after a pause.
  s->due_ns = s->has_kept && s->due_ns + s->cfg.every_ns > time_ns ? s->due_ns : time_ns;
  s->due_ns += s->cfg.every_ns;
  s->kept_ns = time_ns;
  s->has_kept = true;
  if (s->cell) memcpy(s->cell[0], s->cell[1], sizeof s->cell[0]);
}
