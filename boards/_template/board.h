// SPDX-License-Identifier: Apache-2.0
// How much this board gives to the runtime.
#ifndef SV_BOARD_H
#define SV_BOARD_H

#define BOARD_NAME "my-board" // the folder's name
// The one static block everything lives in. It is .bss: pages that are never touched cost nothing.
// Leave room for the system and the camera buffers; `make BOARD=... plan` tells whether the
// defaults below fit.
#define BOARD_ARENA_BYTES (512ull << 20)
// Threads of `run` unless --threads says otherwise, and the most that may be asked for (each takes
// scratch memory).
#define BOARD_THREADS     4 // default; --threads overrides
#define BOARD_CAP_THREADS 8
// What `run` starts with when the command line is silent: Gaussians, degree of their colour (0..3),
// exposures kept.
#define BOARD_GAUSSIANS 20000 // default of `run`
#define BOARD_SH_DEGREE 1
#define BOARD_EXPOSURES 8 // default of `run`

#endif
