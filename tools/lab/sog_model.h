// SPDX-License-Identifier: Apache-2.0
// Quantization for SOG: codes of each Gaussian, a palette of SH, and the choice of their steps: the
// coarsest whose loss in rendered images is not visible.
// Owns its arrays. Writes no files.
#ifndef SV_TOOLS_LAB_SOG_MODEL_H
#define SV_TOOLS_LAB_SOG_MODEL_H

#include "tools/lab/export_sog.h"

#define SOG_CODES 256

// A codebook of even steps.
typedef struct {
  double first, step;
} sog_codebook;

// What has steps of its own, beside SH.
enum { SOG_POSITION, SOG_SCALE, SOG_QUAT, SOG_COLOR, SOG_N_PARTS };

typedef struct {
  uint16_t position[3];
  uint8_t scale[3], quat[3], color[3], alpha;
} sog_coded;

// The sets of SH coefficients that Gaussians share or have of their own.
typedef struct {
  float *set;      // [n][3 n_rest]
  int *level;      // [n] as that of Gaussians
  int n, n_shared; // those of single Gaussians come after n_shared others
  double step;     // codes are multiples of it around SOG_CODES / 2
} sog_palette;

typedef struct {
  const sv_pool *pool;
  const lab_seen *seen; // or NULL
  sv_gaussian *v;       // [n] by level, then those with SH of their own, then along a curve
  int *index;           // [n] of these in the model
  float *weight;        // [n] how much of the pictures they color, about
  int *level;           // [n] their steps are 2^(level + coarser[part]) times the finest
  int *label;           // [n] set of the palette
  int coarser[SOG_N_PARTS];
  float (*dc)[3];               // [n] DC, refitted to the palette
  int n, n_rest;                // n_rest: SH coefficients after the first: 0, 3, 8, 15
  double full_weight;           // from which on the level is 0
  double lo[3], hi[3], unit[3]; // of positions: range, and step of the 16 bits
  sog_codebook scale, color;
  sog_palette palette;
} sog_model;

// m must be zero; stop it, also after a failure. seen: NULL, or views that colors are kept best
// for. judge: started; its target is lowered where the format cannot reach it.
sv_status sog_model_start(sog_model *m, const sv_gaussians *g, const lab_seen *seen, sog_judge *judge,
                          sv_err *err) SV_MUST_USE;
void sog_model_stop(sog_model *m);

sog_coded sog_model_code(const sog_model *m, int i);
// Coefficient c of set j, in steps of the palette.
int sog_model_sh(const sog_model *m, int j, int c);

#endif
