// SPDX-License-Identifier: Apache-2.0
// Outcomes of the library's calls.
// Owns: the status codes, and one error sentence per failed call.
// Never: prints, aborts or sets errno.
#ifndef SUBVIEW_STATUS_H
#define SUBVIEW_STATUS_H

#ifdef __cplusplus
extern "C" {
#endif

// 0 is success, positive codes are normal outcomes, negative codes are failures.
typedef int subview_status;
enum {
  SUBVIEW_OK = 0,
  SUBVIEW_AGAIN = 1,          // nothing is ready yet; ask again
  SUBVIEW_END = 3,            // all planned steps are done, or the source has no more frames
  SUBVIEW_E_ARG = -1,         // an argument is out of its range
  SUBVIEW_E_NOMEM = -2,       // the memory block is too small
  SUBVIEW_E_IO = -4,          // reading or writing failed
  SUBVIEW_E_FORMAT = -5,      // the data is malformed
  SUBVIEW_E_RANGE = -6,       // a value is outside what is supported
  SUBVIEW_E_UNSUPPORTED = -7, // this form is not supported
  SUBVIEW_E_NOT_FOUND = -8,   // something needed is missing
  SUBVIEW_E_DEVICE = -10,     // a camera failed
  SUBVIEW_E_FULL = -11,       // a fixed pool is full
  SUBVIEW_E_CORRUPT = -12     // a checksum does not match
};

// One failure. Calls accept NULL instead.
typedef struct {
  subview_status status;
  char text[256]; // what happened and what was expected; always terminated
} subview_error;

// A short description of a status code, such as "the memory block is too small". Never NULL.
const char *subview_error_text(subview_status status);

#ifdef __cplusplus
}
#endif
#endif
