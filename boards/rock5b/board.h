// SPDX-License-Identifier: Apache-2.0
// ROCK 5B with 8 GiB or more; the four large cores do the work.
#ifndef SV_BOARD_H
#define SV_BOARD_H

#define BOARD_NAME        "rock5b"
#define BOARD_ARENA_BYTES (2048ull << 20)
#define BOARD_THREADS     4 // default; --threads overrides
#define BOARD_CAP_THREADS 8
#define BOARD_GAUSSIANS   60000 // default of `run`
#define BOARD_SH_DEGREE   2
#define BOARD_EXPOSURES   8 // default of `run`

#endif
