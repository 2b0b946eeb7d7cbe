// SPDX-License-Identifier: Apache-2.0
// Gaussians in binary glTF 2.0 with KHR_gaussian_splatting (Khronos, ratified): one POINTS
// primitive of float attributes POSITION, ROTATION (x y z w), SCALE (linear), OPACITY (0..1),
// SH_DEGREE_l_COEF_n, and COLOR_0 (8 bits, for viewers that show plain points). glTF is
// left-up-forward; models are assumed right-down-forward and turned by 180 degrees about z, as
// other converters do. Values stay floats, so only rounding is lost.
#ifndef SV_FORMAT_GLB_H
#define SV_FORMAT_GLB_H

#include <stdbool.h>
#include <stdint.h>

#include "src/base/file_data.h"
#include "src/base/unit.h"
#include "src/format/gaussian.h"
#include "src/format/json.h"

#ifdef __cplusplus
extern "C" {
#endif

#define SV_GLB_CAP_TOKENS 4096
#define SV_GLB_N_SH       16

// Writing: call extend for all Gaussians first (the file states the bounding box), then head once,
// then put for each.
typedef struct {
  uint32_t n; // Gaussians counted by extend
  int sh_degree;
  float min[3], max[3];
  sv_unit unit; // written as "extras" of the asset where it is known
} sv_glb;

void sv_glb_extend(sv_glb *z, const sv_gaussian *g);
size_t sv_glb_bytes(const sv_glb *z); // of the whole file
// file: [sv_glb_bytes]
sv_status sv_glb_head(const sv_glb *z, uint8_t *file, sv_err *err) SV_MUST_USE;
void sv_glb_put(const sv_glb *z, uint8_t *file, uint32_t i, const sv_gaussian *g);

typedef struct {
  const uint8_t *at; // NULL: absent
  size_t stride_bytes;
} sv_glb_field;

typedef struct {
  uint32_t n;
  int sh_degree;
  sv_unit unit; // of the "extras" that sv_glb_head writes; glTF itself always says meters
  sv_glb_field position, rotation, scale, opacity, sh[SV_GLB_N_SH];
} sv_glb_reader;

// Finds the first primitive with the extension. tok: [SV_GLB_CAP_TOKENS] workspace of the call;
// data must outlive r. Transforms of nodes are not applied. E_FORMAT, E_RANGE, E_UNSUPPORTED
// (attributes that are not floats, data outside of the file).
sv_status sv_glb_open(sv_glb_reader *r, const sv_file_data *file, jsmntok_t *tok, sv_err *err) SV_MUST_USE;
void sv_glb_get(const sv_glb_reader *r, uint32_t i, sv_gaussian *out);

#ifdef __cplusplus
}
#endif
#endif
