// SPDX-License-Identifier: Apache-2.0
// Time is signed 64-bit nanoseconds on a named clock. The runtime never reads a clock itself.
#ifndef SV_BASE_TIME_H
#define SV_BASE_TIME_H

#include <stdint.h>

typedef int64_t sv_ns;

#define SV_NS_PER_US 1000LL
#define SV_NS_PER_MS 1000000LL
#define SV_NS_PER_S  1000000000LL

static inline double sv_ns_to_s(sv_ns t_ns) { return (double)t_ns * 1e-9; }
static inline double sv_ns_to_ms(sv_ns t_ns) { return (double)t_ns * 1e-6; }

#endif
