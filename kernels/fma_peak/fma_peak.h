// SPDX-License-Identifier: Apache-2.0
// Fused multiply-adds and nothing else, as fast as the unit gives them: run against the clock, this
// is the machine's measured peak, from which a step's lower bound follows.
#ifndef SV_KERNELS_FMA_PEAK_H
#define SV_KERNELS_FMA_PEAK_H

#ifdef __cplusplus
extern "C" {
#endif

// Of 16 lanes: enough independent sums to hide the latency of two units.
#define SV_FMA_PEAK_CHAINS 12
// Floating-point operations of one round: a multiply-add counts as two.
#define SV_FMA_PEAK_FLOPS (2 * 16 * SV_FMA_PEAK_CHAINS)

// Lane k of chain c starts at c + k (equal lanes would let the compiler do one for all) and does
// `n_rounds` times s = 0.999 s + x; out[16]: the chains' sums, added in order. exact.
typedef void sv_fma_peak_fn(int n_rounds, float x, float *out);

#ifdef __cplusplus
}
#endif
#endif
