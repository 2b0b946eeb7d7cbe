// SPDX-License-Identifier: Apache-2.0
// Gaussians -> screen splats (EWA projection, SH colour) and back. Formulas: 3D Gaussian Splatting
// (Kerbl et al. 2023) with exact clamp gradients; anti-aliasing by Mip-Splatting's 2D compensation.
//
// Gaussian data is stored in blocks of 16: [n_blocks][n_rows][16] floats. Rows:
//   0-2 mean (world) | 3-6 quaternion w,x,y,z, unnormalised | 7-9 log-scale | 10 opacity logit |
//   11 + 3 k + c: SH coefficient k of channel c.  n_rows = 11 + 3 (degree+1)^2: 14, 23, 38, 59.
#ifndef SV_KERNELS_PROJECT_H
#define SV_KERNELS_PROJECT_H

#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

#define SV_LANES             16
#define SV_ROW_MEAN          0
#define SV_ROW_QUAT          3
#define SV_ROW_SCALE         7
#define SV_ROW_LOGIT         10
#define SV_ROW_SH            11
#define SV_CAP_ROWS          59
#define SV_N_ROWS(sh_degree) (SV_ROW_SH + 3 * ((sh_degree) + 1) * ((sh_degree) + 1))

// A tile is 32 x 32 pixels = 8 x 8 blocks of 4 x 4 pixels, one bit each in 64.
#define SV_TILE_PX  32
#define SV_BLOCK_PX 4

// log2(1/255): where a splat's alpha falls under 1/255 it is not evaluated.
#define SV_LOG2_ALPHA_MIN (-7.99435344f)
// Splats keep log2(alpha) less this, so that its fraction above the floor is exact, whatever is
// rounded on the way.
#define SV_POWER_SHIFT 8.0f
#define SV_POWER_MIN   (SV_LOG2_ALPHA_MIN - SV_POWER_SHIFT)
// Added to the real column (row) of an ellipse's edge before it is cut to the first pixel inside;
// 0.03 px of slack cover rounding errors.
#define SV_ROUND_UP  0.97f
#define SV_ALPHA_MAX 0.99f
#define SV_T_MIN     1e-4f // transmittance below which a pixel is saturated

// One Gaussian on the screen of one view, 64 bytes. alpha(p) = 2^(8 + qa dx^2 + qb dx dy + qc dy^2
// + lo) with (dx, dy) = (u, v) - p: conic and opacity folded into base 2.
typedef struct {
  float u_px, v_px;
  float qa, qb, qc, lo;
  float rgb[3];
  float z; // camera depth of the centre
  // px: height (v - y) of the rightmost point of the ellipse alpha = 1/255; the leftmost point has
  // -dy_right.
  float dy_right;
  float inv_2qa;                // 0.5 / qa
  uint16_t bx0, bx1, by0, by1;  // that region in 4x4 blocks of the image, inclusive
  uint32_t n_intersections;     // tiles under it; 0: not visible
  uint32_t intersection_offset; // index of its first intersection; binning writes it
} sv_splat;

// One (splat, tile) pair. mask bit 8 y + x: block (x, y) of the tile may be touched.
typedef struct {
  uint32_t tile;
  uint32_t id; // Gaussian
  uint64_t mask;
} sv_intersection;

// The per-intersection gradient that rasterization backward writes, 32 bytes: eleven values of 24
// bits (s1_store11 in kernels/simd/s1_math.h). Moments of g = dL/d(ln alpha) over the pixels (sum
// of g, g dx, g dy, g dx^2, g dx dy, g dy^2), dL/drgb (3), dL/dz, and the sum of weight *
// |residual|.
enum {
  SV_IGRAD_G,
  SV_IGRAD_GX,
  SV_IGRAD_GY,
  SV_IGRAD_GXX,
  SV_IGRAD_GXY,
  SV_IGRAD_GYY,
  SV_IGRAD_RGB,
  SV_IGRAD_Z = 9,
  SV_IGRAD_ERR,
  SV_IGRAD_VALUES,
  SV_IGRAD_BYTES = 32
};

// A fisheye lens. With h = (x, y) / (|p| + z) of a camera point p (the stereographic plane: |h| is
// the tangent of half the ray's angle) and w = |h|^2:  u = fx h_x F(w) + cx, v = fy h_y F(w) + cy.
// F and its inverse are polynomials, fitted once (calib/fisheye.h): no trigonometry in kernels.
#define SV_FISHEYE_TERMS 12
typedef struct sv_fisheye {
  float term[SV_FISHEYE_TERMS]; // of F in (scale w - 1), the highest power first
  float scale;
  float max_w; // of the widest ray that is projected
  // |h| / rho of rho = |((u - cx) / fx, (v - cy) / fy)| in (inverse_scale rho^2 - 1)
  float inverse_term[SV_FISHEYE_TERMS];
  float inverse_scale;
  float max_rho2; // of the widest ray that is projected
} sv_fisheye;
// The projection is linearized at a Gaussian's center (EWA). On a fisheye's image that holds while
// the Gaussian is small as seen from the camera: those whose deviations across the line of sight
// have squares that sum up to more than this (rad^2 in the image of an equidistant lens) are not
// drawn.
#define SV_FISHEYE_MAX_VAR 0.25f

typedef struct {
  int width_px, height_px;
  float fx, fy, cx, cy; // px, first pixel's centre at 0.5
  float r[9], t[3];     // cam_from_world, row-major
  float centre[3];      // camera centre, world
  float near_z;         // Gaussians nearer than this are not drawn
  float dilation_px2;   // added to both variances, 0.3
  int is_antialiased;
  // Clamps of x / z and y / z in the projection's Jacobian: sv_kview_set_limits.
  float min_x, max_x, min_y, max_y;
  // NULL: a pinhole. Else there are no clamps, and z of splats and near_z are distances from the
  // camera.
  const sv_fisheye *fisheye;
} sv_kview;

// From size, focal lengths and principal point: 0.3 of half an image beyond its edges (Kerbl et
// al. 2023).
static inline void sv_kview_set_limits(sv_kview *v) {
  const float w = (float)v->width_px, h = (float)v->height_px;
  const float more_x = 0.3f * (0.5f * w / v->fx), more_y = 0.3f * (0.5f * h / v->fy);
  v->min_x = -(v->cx / v->fx + more_x);
  v->max_x = (w - v->cx) / v->fx + more_x;
  v->min_y = -(v->cy / v->fy + more_y);
  v->max_y = (h - v->cy) / v->fy + more_y;
}

typedef struct {
  const float *param; // [n_blocks][n_rows][16]
  int n_rows;         // rows of a block, SV_N_ROWS of the stored SH degree
  int sh_degree;      // SH degree in use, at most the stored one
  int n_gaussians;    // Gaussians from this index on are never visible
  sv_kview view;      // the camera
  sv_splat *splat;    // [n_blocks * 16] out
  // [n_blocks * 16] out: bits of z, which sort as z does; undefined where not visible
  uint32_t *depth_key;
  // [n_blocks] bits of lanes that are dropped from this view; NULL: none
  const uint16_t *dropout_mask;
  // log2 of the opacity factor of all others, which makes up for dropout; >= 0
  float log2_compensation;
} sv_project_args;

// 64-byte aligned working memory of either direction, one per thread, contents free.
#define SV_PROJECT_SCRATCH_FLOATS 2048

typedef struct {
  uint32_t n_visible, n_intersections;
} sv_project_counts;

// Blocks [block0, block1). Returns how many of their Gaussians are visible, and the sum of their
// n_intersections. exact.
typedef sv_project_counts sv_project_fn(const sv_project_args *a, int block0, int block1, float *scratch);

typedef struct {
  const sv_project_args *fwd; // the arguments of the forward pass
  // [n_intersections] those of a block's Gaussians are contiguous
  const sv_intersection *intersection;
  // [n_intersections][SV_IGRAD_BYTES]; undefined where a mask is 0
  const uint8_t *igrad;
  // [6] out: this block's share of dL/d(omega, v), a twist on cam_from_world; or NULL
  float *pose_grad;
  float reg_opacity; // weight of the sum of opacities o: adds reg_opacity o (1 - o) to dL/dlogit
  float reg_scale;   // weight of the sum of scales s: adds reg_scale s to each dL/d(log-scale)
} sv_project_bwd_args;

// One block: grad [n_rows][16] (rows of SH degrees above sh_degree are not written), err [16]: sum
// of weight * |residual| per Gaussian. Returns the bits of the lanes that were touched; the other
// lanes of grad and err are 0. exact.
typedef uint32_t sv_project_bwd_fn(const sv_project_bwd_args *a, int block, float *grad, float *err,
                                   float *scratch);

#ifdef __cplusplus
}
#endif
#endif
