// SPDX-License-Identifier: Apache-2.0
// How fast is this machine? Whole training steps on made-up scenes of several sizes, and each kernel of a step in
// each of its variants. Everything lives in the arena that is handed in; what does not fit there is skipped and
// said so. The order of calls: begin, steps (once per pool), kernels, end.
#ifndef SV_APP_BENCH_H
#define SV_APP_BENCH_H

#include "src/train/train.h"

#ifdef __cplusplus
extern "C" {
#endif

#define SV_BENCH_CAP_SAMPLES 200
#define SV_BENCH_CAP_SKIPPED 48

typedef struct {
  const sv_kernels *k; // whole steps run with these
  uint32_t isa_mask;   // variants that are timed one by one
  sv_clock clock;      // real time: port.machine
  sv_console console;  // progress, and the request to stop
  uint64_t seed;
  bool is_json; // one JSON object, else lines of text
  void *out;
  void (*write)(void *out, const char *text); // takes the output, piece by piece
} sv_bench_cfg;

typedef struct {
  int n_gaussians, width_px, height_px, n_threads;
  size_t bytes;                        // of the arena
  double step_ms, render_ms, bound_ms; // medians; bound: the pixel arithmetic at the measured peak of FMAs
  uint64_t pairs;                      // pixel-splat pairs of the picture
} sv_bench_step;

typedef struct {
  const char *op, *item; // what is timed, and what an item is
  sv_isa isa;
  double ns_per_item;
  bool is_pairs; // items are pixel-splat pairs: the inverse is the rate that counts
} sv_bench_kernel;

// A scene to be timed: one training view with a smooth, noisy picture, and Gaussians that together cover it about
// ten deep, as trained models do: half on a surface, log-normal sizes, flat, opacities of 0.05 to 0.95.
typedef struct {
  sv_trainer t;
  uint8_t *picture; // [height][width][3]
} sv_bench_scene;

typedef struct {
  sv_bench_cfg cfg;
  sv_arena *arena;
  sv_bench_scene scene;
  double step_ms[SV_BENCH_CAP_SAMPLES], render_ms[SV_BENCH_CAP_SAMPLES];
  sv_bench_step skipped[SV_BENCH_CAP_SKIPPED];
  int n_steps, n_skipped, n_kernels; // printed so far
  sv_bench_step best;                // most pairs a second in whole steps
} sv_bench;

// The largest arena that any case takes with so many threads.
size_t sv_bench_bytes(int n_threads);

// The bench takes from what is left of the arena and gives it back after each case.
void sv_bench_begin(sv_bench *b, const sv_bench_cfg *cfg, sv_arena *arena);
// All sizes on one pool. E_INTERRUPTED after a stop request.
sv_status sv_bench_steps(sv_bench *b, const sv_pool *pool, sv_err *err) SV_MUST_USE;
// Kernels of a step, on the caller's thread, in every variant that the mask and this CPU allow.
sv_status sv_bench_kernels(sv_bench *b, sv_err *err) SV_MUST_USE;
// extra: more JSON members ("\"peak_rss_bytes\": 1") or NULL.
void sv_bench_end(sv_bench *b, const char *extra);

// --- pieces --------------------------------------------------------------------------------------
// Bytes of a scene in an arena, and the scene itself in `a`.
size_t sv_bench_scene_bytes(const sv_bench_step *size);
sv_status sv_bench_scene_make(sv_bench_scene *b, const sv_bench_step *size, const sv_kernels *k,
                              const sv_pool *pool, uint64_t seed, sv_arena *a, sv_err *err) SV_MUST_USE;
size_t sv_bench_kernel_bytes(void); // what the kernels' part takes
// Floating-point operations a second of all threads of the pool together (a multiply-add is two).
double sv_bench_peak_flops(const sv_kernels *k, const sv_pool *pool, const sv_clock *clock);
void sv_bench_put_kernels_begin(sv_bench *b);
void sv_bench_put_kernel(sv_bench *b, const sv_bench_kernel *r);
void sv_bench_put_skipped(sv_bench *b, const sv_bench_step *size);

#ifdef __cplusplus
}
#endif
#endif
