// SPDX-License-Identifier: Apache-2.0
// Not alone: private to boards_*mrcal.c. C only (_Generic).
// What differs between the releases of mrcal: 2.2 (Debian 12) and 2.4 (Debian 13).
// mrcal has no version macro, so the type of each function tells which release it belongs to.
#ifndef SV_CALIB_SOLVE_MRCAL_RELEASES_H
#define SV_CALIB_SOLVE_MRCAL_RELEASES_H

#include <mrcal/mrcal.h>

#include "calib/solve/boards_mrcal.h"

typedef void sv_mrcal_unpack_2_2(double *, int, int, int, int, int, mrcal_problem_selections_t,
                                 const mrcal_lensmodel_t *);
typedef void sv_mrcal_unpack_2_4(double *, int, int, int, int, int, int, mrcal_problem_selections_t,
                                 const mrcal_lensmodel_t *);
typedef void sv_mrcal_any(void);

_Static_assert(_Generic(&mrcal_unpack_solver_state_vector, sv_mrcal_unpack_2_2 * : 1,
                        sv_mrcal_unpack_2_4 * : 1, default : 0),
               "this release of mrcal is unknown (2.2 and 2.4 are known): add its calls to "
               "calib/solve/mrcal_releases.h, or build without calibration: make WITH=minimal");

static inline void sv_mrcal_call_unpack_2_2(sv_mrcal_any *f, const sv_mrcal_problem *p, double *state) {
  ((sv_mrcal_unpack_2_2 *)f)(state, p->b->n_cameras, p->b->n_cameras - 1, p->n_frames, 0, 0, p->sel,
                             &p->lens);
}

static inline void sv_mrcal_call_unpack_2_4(sv_mrcal_any *f, const sv_mrcal_problem *p, double *state) {
  ((sv_mrcal_unpack_2_4 *)f)(state, p->b->n_cameras, p->b->n_cameras - 1, p->n_frames, 0, 0,
                             p->n_observations, p->sel, &p->lens);
}

// Scales a state vector [mrcal_num_states] from mrcal's packed units to full units, in place.
static inline void sv_mrcal_unpack(const sv_mrcal_problem *p, double *state) {
  _Generic(&mrcal_unpack_solver_state_vector, sv_mrcal_unpack_2_2 *
           : sv_mrcal_call_unpack_2_2, default
           : sv_mrcal_call_unpack_2_4)((sv_mrcal_any *)&mrcal_unpack_solver_state_vector, p, state);
}

#endif
