// SPDX-License-Identifier: Apache-2.0
// The window and the constants, shared by reference and variants.
#ifndef SV_KERNELS_SSIM_CONST_H
#define SV_KERNELS_SSIM_CONST_H

// exp(-k^2 / (2 1.5^2)) / sum over k = -5..5
#define SSIM_G0     0.2660117249f
#define SSIM_G1     0.2130055377f
#define SSIM_G2     0.1093606895f
#define SSIM_G3     0.03600077213f
#define SSIM_G4     0.007598758135f
#define SSIM_G5     0.001028380084f
#define SSIM_C1     1e-4f
#define SSIM_C2     9e-4f
#define SSIM_R      5  // radius of the window
#define SSIM_BORDER 16 // zeros on each side of a scratch row, at least SSIM_R and a whole vector

#endif
