// SPDX-License-Identifier: Apache-2.0
// How fast is this machine, and how far from what its arithmetic and memory allow? Whole training
// steps on made-up scenes of several sizes with the share of each stage, and each kernel of a step
// in each of its variants. Everything lives in the arena that is handed in; what does not fit there
// is skipped and said so. The order of calls: begin, steps (once per pool), kernels, end.
//
// Machines are noisy: every time is the median of repeated runs, with the least and the quartiles
// beside it. Ratios, shares and growth are those of the least times, as the peaks are, which other
// programs disturbed least; peaks are measured before and behind the steps.
//
// The model bound of a step is the sum over its operations of the longer of two times:
// floating-point operations at the measured peak of multiply-adds (which the CPU runs nothing else
// at), and bytes that must move (each array once) at the measured rate of copying a block as large
// as all arrays of the step together. Operations are counted as written in the kernels, a
// multiply-add as two; blended pairs are those that the kernels evaluate, whole blocks of 16 lanes.
//
// That bound takes every operation for half of a multiply-add. Blending cannot be written so:
// comparisons, minimum, conversions and sums of two terms go through the same ports and do one
// operation or none that is counted. The bound by ports takes for blending the instructions that
// AVX-512 needs, one a vector, at the rate of multiply-adds.
#ifndef SV_TOOLS_BENCH_BENCH_H
#define SV_TOOLS_BENCH_BENCH_H

#include "src/train/train.h"

#ifdef __cplusplus
extern "C" {
#endif

#define SV_BENCH_CAP_SAMPLES 200
#define SV_BENCH_CAP_CASES   12 // sizes of one pool
#define SV_BENCH_CAP_SKIPPED 48
#define SV_BENCH_CAP_POOLS   4
#define SV_BENCH_COPY_SIZES  9

// Stages of a step, each with the operations of the kernel table that it runs.
typedef enum {
  SV_STAGE_TARGET,     // the image to planes
  SV_STAGE_PROJECT,    // Gaussians to splats
  SV_STAGE_ORDER,      // depth sort and lists of the tiles
  SV_STAGE_RASTER,     // blending
  SV_STAGE_LOSS,       // with its gradient
  SV_STAGE_CURVATURE,  // probe, its gradients and their squares: every few steps, a step's share
  SV_STAGE_RASTER_BWD, // gradients of the splats
  SV_STAGE_OPTIMISE,   // back to the parameters, and the Gauss-Newton step
  SV_N_STAGES
} sv_bench_stage;

typedef enum {
  SV_BENCH_UNPACK,
  SV_BENCH_PROJECT,
  SV_BENCH_SORT,
  SV_BENCH_BIN,
  SV_BENCH_RASTER,
  SV_BENCH_SSIM,
  SV_BENCH_SSIM_BWD,
  SV_BENCH_RASTER_BWD,
  SV_BENCH_PROJECT_BWD,
  SV_BENCH_NEWTON,
  SV_N_BENCH_OPS
} sv_bench_op;
const char *sv_bench_op_name(sv_bench_op op); // as in kernels/variants.inc

typedef struct {
  const sv_kernels *k; // whole steps run with these
  uint32_t isa_mask;   // variants that are timed one by one
  sv_clock clock;      // real time, or CPU time of the caller where it is the only thread
  sv_console console;  // progress, and the request to stop
  uint64_t seed;
  bool is_cpu_time; // what `clock` is, for the output
  bool is_json;     // one JSON object, else lines of text
  void *out;
  void (*write)(void *out, const char *text); // takes the output, piece by piece
} sv_bench_cfg;

typedef struct {
  double median, least, q1, q3; // ms; quartiles
} sv_bench_times;

// What one image of a scene asks for.
typedef struct {
  uint64_t pairs; // pixel-splat pairs that the kernels evaluate
  // Of those, pairs that are blended: alpha of 1/255 and more, and transmittance left to stop
  uint64_t useful;
  uint64_t rows;       // rows of 4x4 blocks under the visible splats
  uint64_t block_rows; // rows of a tile's blocks that the kernels evaluate
  uint32_t n_gaussians, n_visible, n_intersections, n_touched;
  uint32_t n_pixels;
  int n_rows;        // floats of a Gaussian
  int n_probe_steps; // from one estimate of the curvature to the next
} sv_bench_counts;

typedef struct {
  double flop, bytes;
} sv_bench_cost;

// What a pool of threads reaches when it does nothing else.
typedef struct {
  double flop_per_s;
  int n_copy_sizes;
  size_t copy_bytes[SV_BENCH_COPY_SIZES]; // read and written together
  double copy_bytes_per_s[SV_BENCH_COPY_SIZES];
} sv_bench_peak;

typedef struct {
  int n_gaussians, width_px, height_px, n_threads;
  size_t bytes; // of the arena
  int n_samples;
  sv_bench_times step_ms, render_ms, stage_ms[SV_N_STAGES];
  double bound_ms, stage_bound_ms[SV_N_STAGES]; // the model bound, see above
  // Blending alone, forward and backward, arithmetic alone
  double pixel_bound_ms;
  double slot_bound_ms; // the bound by ports, see above
  sv_bench_counts n;
} sv_bench_step;

// How step times grow: t = fixed + per Gaussian + per pixel, least squares of relative errors over
// all sizes; and the exponents of powers through each row of sizes.
typedef struct {
  // Worst: largest relative error of the plane
  double fixed_ms, ns_per_gaussian, ns_per_pixel, worst;
  double by_gaussians, by_pixels; // mean exponents; 1 is linear
} sv_bench_growth;

typedef struct {
  int n_threads;
  bool is_cpu_time;
  sv_bench_peak peak;
  sv_bench_growth growth;
} sv_bench_pool;

typedef struct {
  sv_bench_op op;
  sv_isa isa;
  sv_bench_times ns;  // of one item
  sv_bench_cost cost; // of one item
} sv_bench_kernel;

// A scene to be timed: one training view with a smooth, noisy image, and Gaussians that together
// cover it about ten deep, as trained models do: half on a surface, log-normal sizes, flat,
// opacities of 0.05 to 0.95. Learning rates are so low that no parameter moves: all steps are the
// same work.
typedef struct {
  sv_trainer t;
  uint8_t *picture; // [height][width][3]
} sv_bench_scene;

typedef struct {
  double step[SV_BENCH_CAP_SAMPLES], render[SV_BENCH_CAP_SAMPLES], stage[SV_N_STAGES][SV_BENCH_CAP_SAMPLES];
} sv_bench_samples;

typedef struct {
  sv_bench_cfg cfg;
  sv_arena *arena;
  sv_bench_scene scene;
  sv_bench_samples samples; // ms
  sv_bench_peak peak;       // of the pool that is timed
  sv_bench_step cases[SV_BENCH_CAP_CASES];
  int n_cases; // of the pool that is timed
  sv_bench_step skipped[SV_BENCH_CAP_SKIPPED];
  int n_steps, n_skipped, n_kernels, n_pools; // printed so far
  sv_bench_step best;                         // most pairs a second in whole steps
  sv_bench_pool pools[SV_BENCH_CAP_POOLS];
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
sv_status sv_bench_scene_make(sv_bench_scene *b, const sv_bench_step *size, sv_compute compute, uint64_t seed,
                              sv_arena *a, sv_err *err) SV_MUST_USE;
size_t sv_bench_kernel_bytes(void); // what the kernels' part takes

// Median, least and quartiles of v[n], which is sorted; zeros when n < 1.
sv_bench_times sv_bench_times_of(double *v, int n);

// Counts of the trainer's last image, which has no depth: the plane of depths is overwritten.
// n_touched is left 0.
sv_bench_counts sv_bench_count(sv_trainer *t);
sv_bench_cost sv_bench_cost_of(sv_bench_op op, const sv_bench_counts *n);
// Bytes of all arrays that a step works on.
double sv_bench_arrays_bytes(const sv_bench_counts *n);
// Seconds that `cost` takes at the peak at least; arrays_bytes: of the whole step, which says what
// caches can hold. Between the sizes that were copied, rates are interpolated over the logarithm of
// the size.
double sv_bench_bound_s(const sv_bench_peak *peak, sv_bench_cost cost, double arrays_bytes);
// Fills bound_ms, stage_bound_ms, pixel_bound_ms and slot_bound_ms of a case from its counts.
void sv_bench_bound(sv_bench_step *r, const sv_bench_peak *peak);
// Measures a pool. Copies are between halves of what is free in the arena, at most 64 MiB.
sv_bench_peak sv_bench_peak_of(const sv_kernels *k, const sv_pool *pool, const sv_clock *clock,
                               sv_arena *arena);
// Times the stages of a step and fills r, samples and counts.
sv_status sv_bench_time_scene(sv_bench *b, const sv_pool *pool, sv_bench_step *r) SV_MUST_USE;
// Needs two sizes and two counts at least, else all is 0.
sv_bench_growth sv_bench_growth_of(const sv_bench_step *r, int n);

void sv_bench_put(sv_bench *b, const char *fmt, ...) SV_PRINTF(2, 3);
void sv_bench_put_peak(sv_bench *b, int n_threads);
void sv_bench_put_step(sv_bench *b, const sv_bench_step *r);
void sv_bench_put_growth(sv_bench *b, const sv_bench_growth *g, int n_threads);
void sv_bench_put_kernels_begin(sv_bench *b);
void sv_bench_put_kernel(sv_bench *b, const sv_bench_kernel *r);
void sv_bench_put_skipped(sv_bench *b, const sv_bench_step *size);

#ifdef __cplusplus
}
#endif
#endif
