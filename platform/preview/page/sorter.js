// SPDX-License-Identifier: Apache-2.0
// What a model looks like from a place at a time, beside the page's thread: decodes the compact
// stream (platform/preview/model.c), moves what moves (src/deform/motion.h), turns SH into colours,
// orders by depth, and either hands all that to WebGL2 (paint.js) or draws it here (raster.js).
"use strict";
importScripts("/raster.js");

let m = null; // the model
const half = new Float32Array(65536);
for (let i = 0; i < 65536; i++) {
  const e = (i >> 10) & 31, f = i & 1023;
  half[i] = (i & 32768 ? -1 : 1) * (e ? 2 ** (e - 15) * (1 + f / 1024) : (2 ** -14 * f) / 1024);
}

// --- the model ---
// Rigid bodies (src/deform/bodies.h): centre of each, times of the knots, w x y z and displacement
// at each knot.
function bodies_of(buffer, at, moving, n, knots) {
  if (!n) return null;
  const take = (count) => new Float32Array(buffer, (at += 4 * count) - 4 * count, count);
  return { n, knots, centre: take(3 * n), time: take(knots), knot: take(7 * n * knots), of: take(moving), now: new Float64Array(7 * n) };
}

function decode(buffer, id) {
  const head = new DataView(buffer), u = (i) => head.getUint32(4 * i, true), n = u(1), degree = u(5);
  const n_sh = 3 * ((degree + 1) ** 2 - 1), moving = u(6), n_motion = u(7);
  const at = 128 + 34 * n, motion_at = (at + n * n_sh + 3) & ~3;
  const model = {
    id, n, degree, n_sh, moving, n_motion, kind: u(8), n_pos: u(9), n_rot: u(10), n_colour: u(11),
    is_mip: (u(4) & 1) !== 0, t0: head.getFloat32(64 + 56, true), unit: head.getFloat32(64 + 60, true), dilation: head.getFloat32(48, true), time: null,
    still: new Float32Array(buffer, 128, 3 * n), halves: new Uint16Array(buffer, 128 + 12 * n, 11 * n),
    sh: new Int8Array(buffer, at, n * n_sh), motion: new Float32Array(buffer, motion_at, moving * n_motion),
    place: new Float32Array(3 * n), scale: new Float32Array(3 * n), turn: new Float32Array(4 * n),
    colour: new Float32Array(3 * n), logit: new Float32Array(n), rgba: new Uint8Array(4 * n),
    keys: new Uint16Array(n), depth: new Float32Array(n), order: new Uint32Array(n), has_texels: false,
  };
  model.bodies = bodies_of(buffer, motion_at + 4 * moving * n_motion, moving, u(13), u(14));
  model.eyes = new Float32Array(buffer, buffer.byteLength - 28 * ((u(15) >> 8) & 255), 7 * ((u(15) >> 8) & 255));
  const signed = new Int16Array(model.halves.buffer, model.halves.byteOffset, 11 * n);
  model.place.set(model.still);
  for (let i = 0, h = 0; i < n; i++, h += 11) {
    for (let k = 0; k < 3; k++) {
      model.scale[3 * i + k] = half[model.halves[h + k]];
      model.colour[3 * i + k] = half[model.halves[h + 7 + k]];
    }
    for (let k = 0; k < 4; k++) model.turn[4 * i + k] = signed[h + 3 + k] / 32767;
    model.logit[i] = half[model.halves[h + 10]];
  }
  model.turn0 = model.turn.slice(0, 4 * moving), model.colour0 = model.colour.slice(0, 3 * moving);
  model.logit0 = model.logit.slice(0, moving);
  return model;
}

// --- motion: values at a time of the functions that all share ---
function functions(kind, n, t, t0) {
  const f = new Float64Array(n);
  if (kind === 2) for (let j = 0, p = t - t0; j < n; j++, p *= t - t0) f[j] = p;
  else for (let j = 0, x = 2 * t - 1, before = 1, now = x; j < n; j++) (f[j] = now), ([before, now] = [now, 2 * x * now - before]);
  return f;
}

// Lagrange's weights of up to three knots on either side of a time between knots i and i + 1
// (src/deform/bodies.c).
function weights(time, i, t) {
  let from = Math.max(i - 2, 0), to = Math.min(i + 3, time.length - 1), w, before = i + 1 - from;
  for (;;) {
    w = [];
    for (let k = from; k <= to; k++) {
      let p = 1;
      for (let o = from; o <= to; o++) if (o !== k) p *= (t - time[o]) / (time[k] - time[o]);
      w.push(p);
    }
    if (w.length < 3 || w.reduce((s, v) => s + Math.abs(v), 0) <= 4) return { from, w };
    const is_last = before < 2 || (before < w.length - 1 && t - time[from] < time[to] - t);
    if (is_last) to--;
    else from++, before--;
  }
}

function pose_bodies(b, t) {
  let i = 0;
  while (i < b.knots - 1 && b.time[i + 1] <= t) i++;
  const is_at = t <= b.time[i] || i === b.knots - 1, { from, w } = is_at ? { from: i, w: [1] } : weights(b.time, i, t);
  b.now.fill(0);
  for (let body = 0; body < b.n; body++) {
    const o = 7 * body, k = b.knot;
    let sign = 1; // goes along from knot to knot
    for (let j = 0, p = 7 * (body * b.knots + from); j < w.length; j++, p += 7) {
      if (j && k[p] * k[p - 7] + k[p + 1] * k[p - 6] + k[p + 2] * k[p - 5] + k[p + 3] * k[p - 4] < 0) sign = -sign;
      for (let e = 0; e < 7; e++) b.now[o + e] += (e < 4 ? sign * w[j] : w[j]) * k[p + e];
    }
    const s = 1 / (Math.hypot(b.now[o], b.now[o + 1], b.now[o + 2], b.now[o + 3]) || 1);
    for (let e = 0; e < 4; e++) b.now[o + e] *= s;
  }
}

// Place and quaternion of Gaussian i with its body.
function go_with_body(b, i) {
  const body = b.of[i], o = 7 * body, c = 3 * body, x = m.place, q = m.turn, p = 3 * i, r = 4 * i;
  const w = b.now[o], a = b.now[o + 1], e = b.now[o + 2], f = b.now[o + 3];
  const dx = x[p] - b.centre[c], dy = x[p + 1] - b.centre[c + 1], dz = x[p + 2] - b.centre[c + 2];
  const u = 2 * (e * dz - f * dy), v = 2 * (f * dx - a * dz), n = 2 * (a * dy - e * dx);
  x[p] += w * u + e * n - f * v + b.now[o + 4], x[p + 1] += w * v + f * u - a * n + b.now[o + 5], x[p + 2] += w * n + a * v - e * u + b.now[o + 6];
  const [Q, A, E, F] = q.subarray(r, r + 4);
  q[r] = w * Q - a * A - e * E - f * F, q[r + 1] = w * A + a * Q + e * F - f * E;
  q[r + 2] = w * E - a * F + e * Q + f * A, q[r + 3] = w * F + a * E - e * A + f * Q;
}

function move(t) {
  if (m.sequence) return m.sequence.move(m, t), (m.time = t);
  if (m.bodies) pose_bodies(m.bodies, t);
  const f = [m.n_pos, m.n_rot, m.n_colour].map((n) => functions(m.kind, n, t, m.t0));
  const add = (out, start, i, width, row, values) => {
    for (let k = 0; k < width; k++) {
      let v = start[width * i + k];
      for (let j = 0; j < values.length; j++) v += values[j] * m.motion[row + width * j + k];
      out[width * i + k] = v;
    }
  };
  for (let i = 0, row = 0; i < m.moving; i++, row += m.n_motion) {
    add(m.place, m.still, i, 3, row + 2, f[0]);
    add(m.turn, m.turn0, i, 4, row + 2 + 3 * m.n_pos, f[1]);
    add(m.colour, m.colour0, i, 3, row + 2 + 3 * m.n_pos + 4 * m.n_rot, f[2]);
    if (m.bodies && m.bodies.of[i]) go_with_body(m.bodies, i);
    const q = m.turn, o = 4 * i, s = 1 / (Math.hypot(q[o], q[o + 1], q[o + 2], q[o + 3]) || 1);
    (q[o] *= s), (q[o + 1] *= s), (q[o + 2] *= s), (q[o + 3] *= s);
    const d = t - m.motion[row];
    m.logit[i] = m.logit0[i] - Math.min(30, Math.exp(m.motion[row + 1]) * d * d);
  }
  m.time = t;
}

// --- colours, as 3D Gaussian Splatting (Kerbl et al. 2023) has its SH ---
const basis = new Float64Array(15);
function fill_basis(degree, x, y, z) {
  const b = basis, C1 = 0.4886025119029199;
  (b[0] = -C1 * y), (b[1] = C1 * z), (b[2] = -C1 * x);
  if (degree < 2) return;
  const xx = x * x, yy = y * y, zz = z * z;
  (b[3] = 1.0925484305920792 * x * y), (b[4] = -1.0925484305920792 * y * z), (b[5] = 0.31539156525252005 * (2 * zz - xx - yy));
  (b[6] = -1.0925484305920792 * x * z), (b[7] = 0.5462742152960396 * (xx - yy));
  if (degree < 3) return;
  (b[8] = -0.5900435899266435 * y * (3 * xx - yy)), (b[9] = 2.890611442640554 * x * y * z);
  (b[10] = -0.4570457994644658 * y * (4 * zz - xx - yy)), (b[11] = 0.3731763325901154 * z * (2 * zz - 3 * xx - 3 * yy));
  (b[12] = -0.4570457994644658 * x * (4 * zz - xx - yy)), (b[13] = 1.445305721320277 * z * (xx - yy));
  b[14] = -0.5900435899266435 * x * (xx - 3 * yy);
}

function shade(eye) {
  const sh = m.sh, n_basis = m.n_sh / 3;
  for (let i = 0, p = 0, o = 0; i < m.n; i++, p += 3, o += 4) {
    let r = 0, g = 0, b = 0;
    if (n_basis) {
      const x = m.place[p] - eye[0], y = m.place[p + 1] - eye[1], z = m.place[p + 2] - eye[2], s = 1 / (Math.sqrt(x * x + y * y + z * z) || 1);
      fill_basis(m.degree, x * s, y * s, z * s);
      for (let k = 0, c = i * m.n_sh; k < n_basis; k++, c += 3) (r += basis[k] * sh[c]), (g += basis[k] * sh[c + 1]), (b += basis[k] * sh[c + 2]);
    }
    const C0 = 0.28209479177387814, to = (v) => (v > 255 ? 255 : v > 0 ? v + 0.5 : 0);
    m.rgba[o] = to(255 * (0.5 + C0 * m.colour[p] + m.unit * r));
    m.rgba[o + 1] = to(255 * (0.5 + C0 * m.colour[p + 1] + m.unit * g));
    m.rgba[o + 2] = to(255 * (0.5 + C0 * m.colour[p + 2] + m.unit * b));
    m.rgba[o + 3] = to(255 / (1 + Math.exp(-m.logit[i])));
  }
}

// --- instead of colours ---
// Red, yellow, green, blue for 0 to 1.
const scale = [[230, 60, 50], [250, 210, 60], [70, 190, 90], [60, 120, 230]];
function paint(o, value) {
  const t = 3 * Math.min(1, Math.max(0, value)), k = Math.min(2, Math.floor(t));
  for (let c = 0; c < 3; c++) m.rgba[o + c] = scale[k][c] + (t - k) * (scale[k + 1][c] - scale[k][c]);
}

// Near is red, far is blue, between the depths of 2 and 98 of 100 Gaussians.
function paint_depth(look) {
  const depth = new Float32Array(m.n);
  for (let i = 0, p = 0; i < m.n; i++, p += 3) {
    depth[i] = 0;
    for (let k = 0; k < 3; k++) depth[i] += look.forward[k] * (m.place[p + k] - look.eye[k]);
  }
  const sorted = depth.slice().sort(), near = sorted[Math.floor(0.02 * m.n)], far = sorted[Math.floor(0.98 * (m.n - 1))];
  for (let i = 0; i < m.n; i++) paint(4 * i, (depth[i] - near) / (far - near || 1));
}

// How well the images cover each Gaussian: the largest angle between two cameras that see it. Red:
// seen from one direction alone or not at all; green: 20 degrees; blue: 30 and more. A camera sees
// what is in its image and not behind others: a coarse depth image of each camera tells, of the
// nearest opaque Gaussians.
const COVERED_DEG = 30, CELLS = 40;
function depths_of(e, k) {
  const f = [e[k + 3], e[k + 4], e[k + 5]], across = Math.abs(f[2]) < 0.9 ? [f[1], -f[0], 0] : [0, f[2], -f[1]], n = Math.hypot(...across);
  const r = across.map((v) => v / n), d = [f[1] * r[2] - f[2] * r[1], f[2] * r[0] - f[0] * r[2], f[0] * r[1] - f[1] * r[0]];
  const near = new Float32Array(CELLS * CELLS).fill(Infinity), cell = new Int32Array(m.n).fill(-1), depth = new Float32Array(m.n);
  for (let i = 0, p = 0; i < m.n; i++, p += 3) {
    const x = m.place[p] - e[k], y = m.place[p + 1] - e[k + 1], z = m.place[p + 2] - e[k + 2], along = x * f[0] + y * f[1] + z * f[2];
    if (along <= 0) continue;
    const u = (x * r[0] + y * r[1] + z * r[2]) / along / e[k + 6], v = (x * d[0] + y * d[1] + z * d[2]) / along / e[k + 6];
    if (u * u + v * v >= 1) continue;
    cell[i] = Math.floor((0.5 + 0.5 * v) * CELLS) * CELLS + Math.floor((0.5 + 0.5 * u) * CELLS), (depth[i] = along);
    if (m.logit[i] > -0.4 && along < near[cell[i]]) near[cell[i]] = along;
  }
  return { near, cell, depth };
}
function coverage() {
  const e = m.eyes, seen = Array.from({ length: m.n }, () => []), out = new Float32Array(m.n);
  for (let k = 0; k < e.length; k += 7) {
    const { near, cell, depth } = depths_of(e, k);
    for (let i = 0; i < m.n; i++) {
      const reach = Math.max(m.scale[3 * i], m.scale[3 * i + 1], m.scale[3 * i + 2]);
      if (cell[i] >= 0 && depth[i] <= 1.03 * near[cell[i]] + reach) seen[i].push(k);
    }
  }
  for (let i = 0; i < m.n; i++) {
    let least = 1;
    const ways = seen[i].map((k) => {
      const w = [0, 1, 2].map((c) => m.place[3 * i + c] - e[k + c]), d = Math.hypot(...w) || 1;
      return w.map((v) => v / d);
    });
    for (let a = 0; a < ways.length; a++) for (let b = 0; b < a; b++) least = Math.min(least, ways[a][0] * ways[b][0] + ways[a][1] * ways[b][1] + ways[a][2] * ways[b][2]);
    out[i] = Math.acos(Math.max(-1, least)) / ((COVERED_DEG * Math.PI) / 180);
  }
  return out;
}
function paint_coverage() {
  if (!m.covered || m.moving) m.covered = coverage();
  for (let i = 0; i < m.n; i++) paint(4 * i, m.covered[i]);
}

// What lies outside a box is not drawn. axes: 3 x 3, one a row; low, high: along them.
function is_inside(box, i) {
  return box.axes.every((a, k) => {
    const v = a[0] * m.place[3 * i] + a[1] * m.place[3 * i + 1] + a[2] * m.place[3 * i + 2];
    return v >= box.low[k] && v <= box.high[k];
  });
}
function crop(box) {
  for (let i = 0; i < m.n; i++) if (!is_inside(box, i)) m.rgba[4 * i + 3] = 0;
}
// Along each axis, the range in which all but 2 of 100 of the opaque Gaussians lie.
function extent(axes) {
  const low = [], high = [];
  for (const a of axes) {
    const v = [];
    for (let i = 0; i < m.n; i++) if (m.logit[i] > -0.4 || m.n < 100) v.push(a[0] * m.place[3 * i] + a[1] * m.place[3 * i + 1] + a[2] * m.place[3 * i + 2]);
    v.sort((x, y) => x - y);
    low.push(v[Math.floor(0.01 * v.length)] || 0), high.push(v[Math.floor(0.99 * (v.length - 1))] || 1);
  }
  return { low, high };
}

// --- order: a counting sort by depth in 16 bits, far to near ---
const counts = new Uint32Array(65537);
function sort(f) { // f: forward direction
  let lo = Infinity, hi = -Infinity;
  for (let i = 0, p = 0; i < m.n; i++, p += 3) {
    const d = f[0] * m.place[p] + f[1] * m.place[p + 1] + f[2] * m.place[p + 2];
    m.depth[i] = d;
    if (d < lo) lo = d;
    if (d > hi) hi = d;
  }
  const scale = hi > lo ? 65535 / (hi - lo) : 0;
  counts.fill(0);
  for (let i = 0; i < m.n; i++) counts[(m.keys[i] = 65535 - (((m.depth[i] - lo) * scale) | 0)) + 1]++;
  for (let k = 0; k < 65536; k++) counts[k + 1] += counts[k];
  for (let i = 0; i < m.n; i++) m.order[counts[m.keys[i]]++] = i;
}

// Two triangles each: vertex 4 i + corner.
function triangles() {
  const out = new Uint32Array(6 * m.n);
  for (let k = 0, o = 0; k < m.n; k++, o += 6) {
    const v = 4 * m.order[k];
    (out[o] = v), (out[o + 1] = out[o + 4] = v + 1), (out[o + 2] = out[o + 3] = v + 2), (out[o + 5] = v + 3);
  }
  return out;
}

// Two RGBA32UI texels a Gaussian of [0, end): f32 place | f16 scale x y, z and i16 w, x and y, z of
// the quaternion.
function texels(end) {
  const out = new Uint32Array(8 * end), floats = new Float32Array(out.buffer), q = (v) => Math.round(v * 32767) & 65535;
  for (let i = 0, o = 0, h = 0, t = 0; i < end; i++, o += 8, h += 11, t += 4) {
    for (let k = 0; k < 3; k++) floats[o + k] = m.place[3 * i + k];
    out[o + 4] = m.halves[h] | (m.halves[h + 1] << 16);
    out[o + 5] = m.halves[h + 2] | (q(m.turn[t]) << 16);
    out[o + 6] = q(m.turn[t + 1]) | (q(m.turn[t + 2]) << 16);
    out[o + 7] = q(m.turn[t + 3]);
  }
  return out;
}

// look: forward, right, down, eye, time, show ("", "depth", "coverage"), box (null: all); of a
// picture that is drawn here also width, height, focal.
function see(look) {
  const begin = performance.now(), is_moved = m.moving > 0 && look.time !== m.time, is_new = !m.is_shaded;
  if (is_moved) move(look.time);
  const wish = JSON.stringify([look.show || "", look.box || 0]), is_other = wish !== (m.wish || '["",0]');
  const is_shaded = is_new || is_moved || is_other || m.n_sh > 0 || look.show === "depth";
  if (is_shaded) {
    shade(look.eye);
    if (look.show === "depth") paint_depth(look);
    if (look.show === "coverage") paint_coverage();
    if (look.box) crop(look.box);
  }
  (m.is_shaded = true), (m.wish = wish);
  sort(look.forward);
  const answer = { model: m.id, n: m.n };
  if (look.width) {
    answer.picture = raster(m, look), (answer.width = look.width), (answer.height = look.height);
    answer.ms = performance.now() - begin;
    return postMessage(answer, [answer.picture.buffer]);
  }
  answer.list = triangles();
  const parts = [answer.list.buffer];
  if (!m.has_texels || is_moved) (answer.texels = texels(m.has_texels ? m.moving : m.n)), parts.push(answer.texels.buffer);
  if (is_shaded) (answer.colours = m.rgba.slice()), parts.push(answer.colours.buffer);
  m.has_texels = true;
  postMessage(answer, parts);
}

// Frames of a moving model that stand in a file; those of a time are there before it is seen.
async function open_sequence(url) {
  if (typeof Sequence === "undefined") importScripts("/sequence.js");
  const sequence = new Sequence(url), model = m;
  try {
    await sequence.open();
    if (m !== model || sequence.n !== m.n) return;
    (m.sequence = sequence), (m.moving = sequence.moving), (m.time = null);
    // The base model's higher degrees are those of other Gaussians.
    if (sequence.sh < m.degree) (m.degree = sequence.sh), (m.n_sh = 3 * ((m.degree + 1) ** 2 - 1));
    postMessage({ sequence: { model: m.id, seconds: sequence.seconds || (sequence.frames - 1) / 12 } });
  } catch (e) {
    postMessage({ sequence: { model: model.id, error: e.message } });
  }
}
async function see_frames(look) {
  const model = m;
  try {
    await model.sequence.load(look.time);
  } catch (e) {
    (model.sequence = null), (model.moving = 0); // the base model stays
  }
  if (m === model) see(look);
}

onmessage = (e) => {
  if (e.data.buffer) m = decode(e.data.buffer, e.data.model);
  if (e.data.sequence && m) open_sequence(e.data.sequence);
  if (e.data.look && m) m.sequence && !m.sequence.has(e.data.look.time) ? see_frames(e.data.look) : see(e.data.look);
  const ask = m && e.data.ask; // of the surface at a pixel, or of the extent
  if (!ask) return;
  if (ask.look) sort(ask.look.forward);
  postMessage({ asked: ask.id, answer: ask.axes ? extent(ask.axes) : surface(m, ask.look, ask.x, ask.y) });
};
