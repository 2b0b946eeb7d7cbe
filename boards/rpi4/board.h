// SPDX-License-Identifier: Apache-2.0
// Raspberry Pi 4 with 2 GiB or more: a quarter of the memory at most.
#ifndef SV_BOARD_H
#define SV_BOARD_H

#define BOARD_NAME        "rpi4"
#define BOARD_ARENA_BYTES (512ull << 20)
#define BOARD_THREADS     4 // default; --threads overrides
#define BOARD_CAP_THREADS 4
#define BOARD_GAUSSIANS   20000 // default of `run`
#define BOARD_SH_DEGREE   1
#define BOARD_EXPOSURES   8 // default of `run`

#endif
