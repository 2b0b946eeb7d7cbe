// SPDX-License-Identifier: Apache-2.0
// The simulator board's sizes and defaults.
#ifndef SV_BOARD_H
#define SV_BOARD_H

#define BOARD_NAME        "sim-x86"
#define BOARD_ARENA_BYTES (1024ull << 20)
#define BOARD_THREADS     2 // default; --threads overrides
#define BOARD_CAP_THREADS 16
#define BOARD_GAUSSIANS   20000 // default of `run`
#define BOARD_SH_DEGREE   1
#define BOARD_EXPOSURES   8 // default of `run`

#endif
