// SPDX-License-Identifier: Apache-2.0
// Real spherical harmonics constants, degrees 0-3, in the order and signs of 3D Gaussian Splatting.
#ifndef SV_KERNELS_SH_H
#define SV_KERNELS_SH_H

#define SH0  0.28209479177387814f
#define SH1  0.4886025119029199f
#define SH2A 1.0925484305920792f  // xy, -yz, -xz
#define SH2B 0.31539156525252005f // 2zz-xx-yy
#define SH2C 0.5462742152960396f  // xx-yy
#define SH3A 0.5900435899266435f  // -y(3xx-yy), -x(xx-3yy)
#define SH3B 2.890611442640554f   // xyz
#define SH3C 0.4570457994644658f  // -y(4zz-xx-yy), -x(4zz-xx-yy)
#define SH3D 0.3731763325901154f  // z(2zz-3xx-3yy)
#define SH3E 1.445305721320277f   // z(xx-yy)

#endif
