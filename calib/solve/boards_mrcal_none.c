// SPDX-License-Identifier: Apache-2.0
// For builds without mrcal.
#include "calib/solve/boards.h"

sv_status sv_boards_available(sv_err *err) {
  return sv_fail(
      err, SV_E_UNSUPPORTED,
      "this build cannot calibrate: it was built without mrcal (libmrcal-dev, libsuitesparse-dev)");
}

sv_status sv_boards_solve(const sv_boards *b, sv_boards_result *out, sv_err *err) {
  (void)b;
  (void)out;
  return sv_boards_available(err);
}
