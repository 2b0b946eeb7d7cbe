// SPDX-License-Identifier: Apache-2.0
// The description of a monocular depth network: a text file with a word and its values on each
// line. It owns nothing; it never reads the network itself.
#ifndef SV_TOOLS_PRIOR_NETWORK_H
#define SV_TOOLS_PRIOR_NETWORK_H

#include <stdbool.h>

#include "tools/common/fileio.h"

#ifdef __cplusplus
extern "C" {
#endif

#define SV_NETWORK_CAP_SIDE_PX 4096

typedef struct {
  char path[SV_CAP_PATH];  // the network; a relative name is relative to the text file's folder
  char layer[128];         // the output to take; "": the network's last one
  int width_px, height_px; // of the input; images are resized to it, whatever their aspect
  double mean[3];          // of red, green, blue in [0, 1]; input = (value - mean) / deviation
  double deviation[3];
  bool is_bgr;       // the input's first channel is blue
  bool is_disparity; // the output is inverse depth (near is large), else depth
} sv_network;

// Keys: network, size, output (required); mean, std, order, layer. '#' begins a comment.
// Sentences name the file and the line. E_FORMAT, and what sv_file_read returns.
sv_status sv_network_read(const char *path, sv_network *out, sv_err *err) SV_MUST_USE;

#ifdef __cplusplus
}
#endif
#endif
