// SPDX-License-Identifier: Apache-2.0
// PLY point clouds and 3DGS models over a buffer: ascii and binary_little_endian, properties found
// by name in any order and of any scalar type. Elements before "vertex" are skipped when they have
// no list properties; elements after it are ignored.
//
// A 3DGS model has x y z [nx ny nz] f_dc_0..2 f_rest_* opacity scale_0..2 rot_0..3, with f_rest
// channel-major: all coefficients of R, then G, then B. Anything else with x y z is a point cloud;
// its colour is red green blue (integers of full range, or floats 0..1) or f_dc_0..2.
#ifndef SV_FORMAT_PLY_H
#define SV_FORMAT_PLY_H

#include <stdbool.h>
#include <stdint.h>

#include "src/base/unit.h"
#include "src/format/gaussian.h"

#ifdef __cplusplus
extern "C" {
#endif

#define SV_PLY_CAP_PROPERTIES 160

typedef enum { SV_PLY_POINTS = 0, SV_PLY_GAUSSIANS } sv_ply_kind;
typedef struct {
  uint8_t type, field; // of ply.c
} sv_ply_property;

// The header's content and a reading position. 0.5 KiB; points only into the caller's buffer.
typedef struct {
  sv_ply_kind kind;
  uint32_t n;      // vertices
  int sh_degree;   // 0..3; 0 for points
  bool has_colour; // points only; without, sv_ply_read_point gives mid grey
  bool is_ascii;
  bool is_mip;         // Brush's "SplatRenderMode: mip"
  float dilation_px2;  // our "SplatDilation: 0.1": low-pass used in training, px^2; 0 when absent
  char up[4];          // our "SplatUp: z": the up axis (src/format/axes.h); empty when absent
  sv_unit unit;        // our "SplatUnit: m" and "SplatScaleSigma: 0.0005"
  uint32_t background; // our "SplatBackground: #867c75", 0xRRGGBB; 0 when absent
  char vertical[4];    // Brush's "Vertical axis: y" ("y", "-y", "z", ...); empty when absent

  const char *name; // from here on private to the reader
  const uint8_t *buf;
  size_t bytes, data_at; // data_at: offset of vertex 0
  uint32_t stride_bytes; // binary
  int n_properties, n_rest;
  sv_ply_property property[SV_PLY_CAP_PROPERTIES];
  uint32_t i_next; // ascii: the vertex at offset `at`
  size_t at;
} sv_ply;

// Reads the header. buf and name must outlive ply. E_FORMAT, E_UNSUPPORTED, E_RANGE with a
// sentence.
sv_status sv_ply_open(sv_ply *ply, const char *name, const void *buf, size_t bytes, sv_err *err) SV_MUST_USE;

// Vertex i. Binary files: any order; ascii: going backwards restarts from the top. Values that are
// not finite are refused, with two exceptions: an infinite opacity (converters write it for opacity
// 1) becomes +-15, and a scale of ln 0 becomes -30.
sv_status sv_ply_read_gaussian(sv_ply *ply, uint32_t i, sv_gaussian *out, sv_err *err) SV_MUST_USE;
// rgb in 0..1. Works on models too (colour from f_dc).
sv_status sv_ply_read_point(sv_ply *ply, uint32_t i, float xyz[3], float rgb[3], sv_err *err) SV_MUST_USE;

typedef struct {
  uint32_t n;
  int sh_degree;
  const char *vertical; // e.g. "-y"; NULL: no such comment
  const char *up;       // likewise: "SplatUp: z"
  bool is_mip;
  float dilation_px2;  // 0: no such comment
  sv_unit unit;        // writes "SplatUnit: m", and "SplatScaleSigma: 0.0005" where it is known
  uint32_t background; // 0xRRGGBB; writes "SplatBackground: #rrggbb" unless black
  bool has_normals;    // writes nx ny nz = 0, which some old readers require
} sv_ply_options;

typedef struct {
  sv_sink sink;
  sv_ply_options options;
  uint32_t n_written;
  size_t n_buffered;
  uint8_t buffer[4096];
} sv_ply_writer;

// Writes a binary 3DGS model: begin, options.n times write, end (which fails when the count
// differs).
sv_status sv_ply_write_begin(sv_ply_writer *w, sv_sink sink, const sv_ply_options *options,
                             sv_err *err) SV_MUST_USE;
sv_status sv_ply_write_gaussian(sv_ply_writer *w, const sv_gaussian *g, sv_err *err) SV_MUST_USE;
sv_status sv_ply_write_end(sv_ply_writer *w, sv_err *err) SV_MUST_USE;
// Bytes of the whole file, 0 when the options are out of range.
size_t sv_ply_file_bytes(const sv_ply_options *options);

#ifdef __cplusplus
}
#endif
#endif
