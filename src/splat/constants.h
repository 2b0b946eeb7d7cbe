// SPDX-License-Identifier: Apache-2.0
// The renderer's numbers, each once.
#ifndef SV_SPLAT_CONSTANTS_H
#define SV_SPLAT_CONSTANTS_H

#define SV_DILATION_PX2 0.3f // low-pass of the pixel grid added to both screen variances (3DGS)
// What a pixel really integrates over: the variance of a box one pixel wide is 1/12 (Mip-Splatting
// takes 0.1, too). For pictures that are coarser than those that are looked at, where the above
// would count as blur of the scene.
#define SV_DILATION_AREA_PX2 0.1f
#define SV_NEAR_FRACTION     0.01f  // near plane, in scene radii
#define SV_OPACITY_DEAD      0.005f // below it a Gaussian is dead: free for relocation (3DGS-MCMC)
// A Gaussian's screen size follows the focal length in pixels, the low-pass above does not: views
// whose focal lengths differ by more than this need Mip-Splatting's compensation.
#define SV_MIP_FOCAL_RATIO 1.5f

// Radii of the scene about its center; what is beyond is background (src/train/reach.h).
#define SV_REACH_RADII 10.0f

#endif
