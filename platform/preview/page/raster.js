// SPDX-License-Identifier: Apache-2.0
// The same picture as paint.js without a graphics processor: Gaussians near to far, each over the
// pixels of its ellipse row by row, and none behind what is opaque already.
"use strict";
let canvas = new Float32Array(0); // r g b and transmittance
// exp(x) for -8 < x < 8 from a table, to 2e-5 of itself.
const EXP_STEPS = 128, exp_table = new Float64Array(16 * EXP_STEPS + 2);
for (let i = 0; i < exp_table.length; i++) exp_table[i] = Math.exp(i / EXP_STEPS - 8);
function quick_exp(x) {
  const t = (x + 8) * EXP_STEPS, i = t | 0;
  return i >= 0 && i < 16 * EXP_STEPS ? exp_table[i] + (t - i) * (exp_table[i + 1] - exp_table[i]) : Math.exp(x);
}

// One Gaussian at (px, py) of a covariance (xx, xy, yy) in pixels. Along a row the exponent is
// quadratic, so its exponential goes on by two multiplications a pixel.
function cover(out, w, h, px, py, xx, xy, yy, rgba, o, opacity) {
  const det = xx * yy - xy * xy, reach2 = 2 * Math.log(255 * opacity), ry = Math.sqrt(reach2 * yy);
  const a = yy / det, b = -xy / det, r = rgba[o], g = rgba[o + 1], blue = rgba[o + 2];
  const y0 = Math.max(0, Math.ceil(py - ry - 0.5)), y1 = Math.min(h - 1, Math.floor(py + ry - 0.5)), step = Math.exp(-a);
  for (let y = y0; y <= y1; y++) {
    const dy = y + 0.5 - py, half = (reach2 - (dy * dy) / yy) / a;
    if (half <= 0) continue;
    const mid = px - (b / a) * dy, rx = Math.sqrt(half);
    const x0 = Math.max(0, Math.ceil(mid - rx - 0.5)), x1 = Math.min(w - 1, Math.floor(mid + rx - 0.5));
    if (x0 > x1) continue;
    const d = x0 + 0.5 - mid; // the exponent is -(a d^2 + dy^2 / yy) / 2
    let value = opacity * quick_exp(-0.5 * (a * d * d + (dy * dy) / yy)), rate = quick_exp(-a * (d + 0.5));
    for (let x = x0, i = 4 * (y * w + x0); x <= x1; x++, i += 4) {
      const left = out[i + 3];
      if (left > 0.004) {
        const k = (value < 0.99 ? value : 0.99) * left;
        out[i] += k * r, out[i + 1] += k * g, out[i + 2] += k * blue, out[i + 3] = left - k;
      }
      value *= rate, rate *= step;
    }
  }
}

// Where Gaussian i of the model m (sorter.js) falls, in EWA projection (Zwicker et al. 2001) as 3D
// Gaussian Splatting has it: fills flat; false when nothing of it is seen.
// dx, dy: slopes of its depth a pixel to the right and downwards (src/splat/surface.h).
const flat = { x: 0, y: 0, xx: 0, xy: 0, yy: 0, opacity: 0, depth: 0, dx: 0, dy: 0 };
function flatten(m, look, i) {
  const w = look.width, h = look.height, focal = look.focal, lx = (0.65 * w) / focal, ly = (0.65 * h) / focal;
  const r0 = look.right, r1 = look.down, r2 = look.forward, eye = look.eye, q = m.turn, s = m.scale;
  const p = 3 * i, o = 4 * i, x = m.place[p] - eye[0], y = m.place[p + 1] - eye[1], z = m.place[p + 2] - eye[2];
  const cz = r2[0] * x + r2[1] * y + r2[2] * z;
  if (cz < 0.05 || m.rgba[o + 3] < 1) return false;
  const tx = (r0[0] * x + r0[1] * y + r0[2] * z) / cz, ty = (r1[0] * x + r1[1] * y + r1[2] * z) / cz, f = focal / cz;
  const qx = tx > lx ? lx : tx < -lx ? -lx : tx, qy = ty > ly ? ly : ty < -ly ? -ly : ty;
  let xx = 0, xy = 0, yy = 0, zx = 0, zy = 0;
  const qw = q[o], qi = q[o + 1], qj = q[o + 2], qk = q[o + 3];
  for (let a = 0; a < 3; a++) { // column a of the rotation is the Gaussian's axis a
    const vx = a === 0 ? 1 - 2 * (qj * qj + qk * qk) : a === 1 ? 2 * (qi * qj - qw * qk) : 2 * (qi * qk + qw * qj);
    const vy = a === 0 ? 2 * (qi * qj + qw * qk) : a === 1 ? 1 - 2 * (qi * qi + qk * qk) : 2 * (qj * qk - qw * qi);
    const vz = a === 0 ? 2 * (qi * qk - qw * qj) : a === 1 ? 2 * (qj * qk + qw * qi) : 1 - 2 * (qi * qi + qj * qj);
    const depth = r2[0] * vx + r2[1] * vy + r2[2] * vz, size = f * s[p + a];
    const ux = size * (r0[0] * vx + r0[1] * vy + r0[2] * vz - qx * depth), uy = size * (r1[0] * vx + r1[1] * vy + r1[2] * vz - qy * depth);
    (xx += ux * ux), (xy += ux * uy), (yy += uy * uy), (zx += s[p + a] * depth * ux), (zy += s[p + a] * depth * uy);
  }
  const before = Math.max(0, xx * yy - xy * xy);
  (xx += m.dilation), (yy += m.dilation);
  let opacity = m.rgba[o + 3] / 255;
  const det = xx * yy - xy * xy;
  if (m.is_mip) opacity *= Math.sqrt(before / det);
  if (opacity * 255 <= 1.0001) return false;
  (flat.x = focal * tx + 0.5 * w), (flat.y = focal * ty + 0.5 * h), (flat.xx = xx), (flat.xy = xy), (flat.yy = yy);
  (flat.opacity = opacity), (flat.depth = cz), (flat.dx = (zx * yy - zy * xy) / det), (flat.dy = (zy * xx - zx * xy) / det);
  return true;
}

// The model over black as RGBA [height][width][4].
function raster(m, look) {
  const w = look.width, h = look.height, n = w * h;
  if (canvas.length < 4 * n) canvas = new Float32Array(4 * n);
  for (let i = 0; i < 4 * n; i += 4) (canvas[i] = canvas[i + 1] = canvas[i + 2] = 0), (canvas[i + 3] = 1);
  for (let k = m.n - 1; k >= 0; k--) {
    const i = m.order[k];
    if (flatten(m, look, i)) cover(canvas, w, h, flat.x, flat.y, flat.xx, flat.xy, flat.yy, m.rgba, 4 * i, flat.opacity);
  }
  const out = new Uint8ClampedArray(4 * n);
  for (let i = 0; i < 4 * n; i += 4) (out[i] = canvas[i]), (out[i + 1] = canvas[i + 1]), (out[i + 2] = canvas[i + 2]), (out[i + 3] = 255);
  return out;
}

// Sums of weights and of weighted depths of points in the image, between two transmittances and
// within 2 % of a depth, where there is one (kernels/surface/surface.h).
function add_depths(m, look, points) {
  for (const p of points) (p.left = 1), (p.sum = p.weight = 0);
  for (let k = m.n - 1; k >= 0; k--) {
    if (!flatten(m, look, m.order[k])) continue;
    const { xx, xy, yy, opacity } = flat, det = xx * yy - xy * xy;
    for (const p of points) {
      const dx = p.x - flat.x, dy = p.y - flat.y, power = (yy * dx * dx - 2 * xy * dx * dy + xx * dy * dy) / det;
      if (power > 18 || p.left <= p.to) continue;
      const alpha = Math.min(0.99, opacity * Math.exp(-0.5 * power));
      if (alpha < 1 / 255) continue;
      const depth = flat.depth + flat.dx * dx + flat.dy * dy, next = p.left * (1 - alpha);
      const weight = Math.max(0, Math.min(p.left, p.from) - Math.max(next, p.to));
      p.left = next;
      if (p.depth && Math.abs(depth - p.depth) >= 0.02 * p.depth) continue;
      (p.weight += weight), (p.sum += weight * depth);
    }
  }
}

// Depth of the surface at pixel (x, y) as subview-lab measure has it (src/splat/render.h:
// sv_render_surface), of a part in front of it and one behind, and the standard deviation of the
// 3 x 3 pixels around it. null: no surface.
function surface(m, look, x, y) {
  const near = [], parts = [{ x, y, from: 0.85, to: 0.75 }, { x, y, from: 0.6, to: 0.5 }];
  for (let j = -1; j <= 1; j++) for (let i = -1; i <= 1; i++) near.push({ x: x + i, y: y + j, from: 0.75, to: 0.6 });
  add_depths(m, look, [...near, ...parts]);
  for (const p of [...near, ...parts]) (p.depth = p.left <= p.to ? p.sum / p.weight : 0), (p.from = 1);
  if (!near[4].depth || !parts[1].depth) return null;
  add_depths(m, look, near);
  const around = near.filter((p) => p.depth).map((p) => (p.weight > 0 ? p.sum / p.weight : p.depth));
  const mean = around.reduce((a, d) => a + d, 0) / around.length, at = near[4].weight > 0 ? near[4].sum / near[4].weight : near[4].depth;
  const spread = Math.sqrt(around.reduce((a, d) => a + (d - mean) ** 2, 0) / around.length);
  return { depth: at, front: parts[0].depth, behind: parts[1].depth, spread };
}
