// SPDX-License-Identifier: Apache-2.0
// A live moving run over many exposures, on virtual clocks: does its quality stay? Prints a table
// of the PSNR and of the percentiles of the parameters, and fails when the last tenth of the
// exposures is more than 0.5 dB below the second tenth.
//
// live-soak EXPOSURES [GAUSSIANS [STEPS [PERIOD_S [WIDTHxHEIGHT]]]]
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "src/base/mathx.h"
#include "tests/common/test.h"
#include "tests/common/world.h"

#define N_LINES        40
#define MAX_FALL       0.5 // dB, from the second tenth of the exposures to the last
#define MAX_FALL_FIRST 3.0 // dB, from the first tenth, which has the first model
#define N_RING         8
#define THRESHOLD      0.005f // opacity of a Gaussian that counts as alive

typedef enum { SCALE, OPACITY, DISTANCE, QUATERNION, N_KINDS } parameter_kind;

typedef struct {
  world w;
  int n_exposures, n_steps;
  double period_s;
  uint64_t n_scored, next_line; // at the last line; exposures of the next one
  double psnr_sum;
  double tenth_sum[10];
  int tenth_n[10];
  float *sorted; // [n_gaussians]
} soak;

static int by_value(const void *a, const void *b) {
  const float x = *(const float *)a, y = *(const float *)b;
  return (x > y) - (x < y);
}

static float norm_of(const float *p, int n) {
  float sum = 0;
  for (int i = 0; i < n; i++) sum += p[16 * i] * p[16 * i];
  return sqrtf(sum);
}

static float value_of(const sv_trainer *t, int i, parameter_kind kind) {
  const float *p = sv_gaussians_at(&t->g, i, 0);
  switch (kind) {
  case SCALE: return (p[16 * SV_ROW_SCALE] + p[16 * SV_ROW_SCALE + 16] + p[16 * SV_ROW_SCALE + 32]) / 3;
  case OPACITY: return 1.0f / (1.0f + (float)sv_exp(-(double)p[16 * SV_ROW_LOGIT]));
  case DISTANCE: return norm_of(p + 16 * SV_ROW_MEAN, 3);
  default: return norm_of(p + 16 * SV_ROW_QUAT, 4);
  }
}

static void print_head(void) {
  static const char *const kinds[] = {"log_scale", "opacity", "distance", "quaternion"};
  printf("exposures,psnr_db,alive");
  for (int k = 0; k < N_KINDS; k++) printf(",%s_p1,%s_p50,%s_p99", kinds[k], kinds[k], kinds[k]);
  printf("\n");
}

static void print_line(soak *s) {
  const sv_trainer *t = &s->w.app.trainer;
  const sv_app_moving *m = &s->w.app.moving;
  const uint64_t n = m->n_scored - s->n_scored;
  int n_alive = 0;
  for (int i = 0; i < t->g.n; i++) n_alive += value_of(t, i, OPACITY) > THRESHOLD;
  printf("%llu,%.2f,%d", (unsigned long long)m->n_scored, n ? (m->psnr_sum - s->psnr_sum) / (double)n : 0.0,
         n_alive);
  for (int k = 0; k < N_KINDS; k++) {
    for (int i = 0; i < t->g.n; i++) s->sorted[i] = value_of(t, i, (parameter_kind)k);
    qsort(s->sorted, (size_t)t->g.n, sizeof *s->sorted, by_value);
    printf(",%.4g,%.4g,%.4g", (double)s->sorted[t->g.n / 100], (double)s->sorted[t->g.n / 2],
           (double)s->sorted[t->g.n - 1 - t->g.n / 100]);
  }
  printf("\n");
  fflush(stdout);
  s->n_scored = m->n_scored;
  s->psnr_sum = m->psnr_sum;
}

// The machine's clock: a step takes a period's share, so that each exposure gets n_steps.
static sv_ns now_ns(void *self) {
  soak *s = self;
  const sv_app_moving *m = &s->w.app.moving;
  static uint64_t n_seen;
  static double sum_seen;
  if (m->n_scored > n_seen) {
    const int tenth = sv_mini((int)(10 * (m->n_scored - 1) / (uint64_t)s->n_exposures), 9);
    s->tenth_sum[tenth] += m->psnr_sum - sum_seen;
    s->tenth_n[tenth] += (int)(m->n_scored - n_seen);
    n_seen = m->n_scored;
    sum_seen = m->psnr_sum;
  }
  if (m->n_scored >= s->next_line) {
    if (m->n_scored > 0) print_line(s);
    s->next_line += (uint64_t)sv_maxi(s->n_exposures / N_LINES, 1);
  }
  s->w.is_stop_at_once = m->n_scored >= (uint64_t)s->n_exposures;
  return (sv_ns)((double)s->w.app.trainer.step * s->period_s / s->n_steps * 1e9) + s->w.machine_ns++;
}

static void sleep_until(void *self, sv_ns until_ns) {
  (void)self;
  (void)until_ns;
}

static double argument(int argc, char **argv, int i, double otherwise) {
  return i < argc ? strtod(argv[i], NULL) : otherwise;
}

static double mean_of_tenth(const soak *s, int i) { return s->tenth_sum[i] / sv_maxi(s->tenth_n[i], 1); }

static int verdict(const soak *s) {
  const double first = mean_of_tenth(s, 0), second = mean_of_tenth(s, 1), last = mean_of_tenth(s, 9);
  const bool is_kept = last >= second - MAX_FALL && last >= first - MAX_FALL_FIRST;
  printf("# first tenth %.2f dB, second %.2f dB, last %.2f dB: %s\n", first, second, last,
         is_kept ? "kept" : "FALLEN");
  return is_kept ? 0 : 1;
}

int main(int argc, char **argv) {
  static soak s;
  char spec[128];
  s.n_exposures = (int)argument(argc, argv, 1, 0);
  const int n_gaussians = (int)argument(argc, argv, 2, 2000);
  s.n_steps = (int)argument(argc, argv, 3, 40);
  s.period_s = argument(argc, argv, 4, 0.05);
  if (s.n_exposures < 20 || n_gaussians < 1 || s.n_steps < 1 || s.period_s <= 0) {
    fprintf(
        stderr,
        "usage: live-soak EXPOSURES [GAUSSIANS [STEPS [PERIOD_S [WIDTHxHEIGHT]]]], at least 20 exposures\n");
    return 2;
  }
  snprintf(spec, sizeof spec, "moving,rig=stereo,size=%s,arc=0,fps=%g", argc > 5 ? argv[5] : "96x72",
           1 / s.period_s);
  world_open_well(&s.w, spec, N_RING, ~0u, 1);
  s.sorted = calloc((size_t)n_gaussians, sizeof *s.sorted);
  s.w.port.machine = (sv_clock){&s, now_ns, sleep_until};
  s.w.cfg.train.n_gaussians = n_gaussians;
  s.w.cfg.is_dynamic = s.w.cfg.is_continuous = true;
  s.w.cfg.exposure_s = s.period_s;
  s.w.cfg.time_limit_s = 1.2 * s.period_s * s.n_exposures;
  print_head();
  const sv_status end = world_run(&s.w);
  printf("# %s; %d steps an exposure of %g s, %d Gaussians, %u steps\n",
         end == SV_E_INTERRUPTED ? "complete" : s.w.err.text, s.n_steps, s.period_s, n_gaussians,
         s.w.app.trainer.step);
  const int code = verdict(&s);
  world_close(&s.w);
  free(s.sorted);
  return code;
}
