// SPDX-License-Identifier: Apache-2.0
// Depth order of the Gaussians, far to near, by a counting sort over 2^16 depths, away from the thread that draws.
"use strict";
let positions = new Float32Array(0), n = 0, model = 0;
let keys = new Uint16Array(0);
const counts = new Uint32Array(65537);

function order(f) { // f: forward direction
  let lo = Infinity, hi = -Infinity;
  const depth = new Float32Array(n);
  for (let i = 0, p = 0; i < n; i++, p += 3) {
    const d = f[0] * positions[p] + f[1] * positions[p + 1] + f[2] * positions[p + 2];
    depth[i] = d;
    if (d < lo) lo = d;
    if (d > hi) hi = d;
  }
  const scale = hi > lo ? 65535 / (hi - lo) : 0;
  counts.fill(0);
  for (let i = 0; i < n; i++) {
    const k = 65535 - ((depth[i] - lo) * scale | 0);
    keys[i] = k;
    counts[k + 1]++;
  }
  for (let k = 0; k < 65536; k++) counts[k + 1] += counts[k];
  const out = new Uint32Array(6 * n); // two triangles each: vertex 4 i + corner
  for (let i = 0, v = 0; i < n; i++, v += 4) {
    const o = 6 * counts[keys[i]]++;
    out[o] = v, out[o + 1] = v + 1, out[o + 2] = v + 2;
    out[o + 3] = v + 2, out[o + 4] = v + 1, out[o + 5] = v + 3;
  }
  return out;
}

onmessage = (e) => {
  const m = e.data;
  if (m.positions) {
    positions = m.positions;
    n = positions.length / 3;
    model = m.model;
    if (keys.length < n) keys = new Uint16Array(n);
  }
  if (m.forward) {
    const list = order(m.forward);
    postMessage({ list, model }, [list.buffer]);
  }
};
