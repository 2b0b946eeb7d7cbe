// SPDX-License-Identifier: Apache-2.0
// The frames of a moving model, beside the page's thread: read by ranges of a file (the layout is
// in docs/formats.md, Sequence), a group of frames from one keyframe to the next at a time.
"use strict";
const SEQUENCE_ROWS = 14, SEQUENCE_GROUPS = 4; // that frames change; that are kept

// Blocks of 64 values at a byte of data: calls take(i, residual, is_linear) for the first n_taken
// of a row's n values; returns where the next row begins.
function read_row(data, at, n, n_taken, take) {
  for (let i0 = 0; i0 < n; i0 += 64) {
    const bits = data[at] & 31, is_linear = data[at] > 31;
    if (i0 < n_taken)
      for (let k = 0, held = 0, n_held = 0, p = at + 1; k < 64 && i0 + k < n_taken; k++) {
        while (n_held < bits) (held += data[p++] * 2 ** n_held), (n_held += 8); // beyond 32 bits
        const low = 2 ** bits, f = held % low;
        (held = (held - f) / low), (n_held -= bits);
        take(i0 + k, f % 2 ? -(f + 1) / 2 : f / 2, is_linear);
      }
    at += 1 + 8 * bits;
  }
  return at;
}

const one_float = new Float32Array(1), its_bits = new Uint32Array(one_float.buffer);
function half_of(v) { // above 0
  one_float[0] = v;
  const e = ((its_bits[0] >>> 23) & 255) - 112;
  return e <= 0 ? Math.round(v * 2 ** 24) : e > 30 ? 0x7bff : (e << 10) | ((its_bits[0] >>> 13) & 1023);
}

class Sequence {
  constructor(url) {
    this.url = url, this.groups = new Map(), this.loading = new Map();
  }

  async bytes(range, n) {
    const r = await fetch(this.url, { headers: { Range: "bytes=" + range } });
    const data = r.status === 206 ? new Uint8Array(await r.arrayBuffer()) : null;
    if (!data || data.length !== n) throw new Error("the frames of this model cannot be read");
    return data;
  }

  async open() {
    const head = new DataView((await this.bytes("48-351", 304)).buffer), u = (i) => head.getUint32(4 * i, true);
    this.n = u(0), this.moving = u(1), this.frames = u(2), this.group = u(3), this.sh = u(4), this.seconds = head.getFloat32(36, true);
    this.step = Array.from({ length: SEQUENCE_ROWS }, (_, i) => head.getFloat32(64 + 4 * i, true));
    const tail = 16 * this.frames, base = u(6);
    const [index, data] = await Promise.all([this.bytes("-" + (tail + 40), tail + 40), this.bytes("384-" + (383 + base), base)]);
    const view = new DataView(index.buffer);
    this.place = Array.from({ length: this.frames }, (_, i) => Number(view.getBigUint64(16 * i, true)));
    this.length = Array.from({ length: this.frames }, (_, i) => view.getUint32(16 * i + 8, true));
    this.base = new Int32Array(SEQUENCE_ROWS * this.moving);
    for (let row = 0, at = 0; row < SEQUENCE_ROWS; row++)
      at = read_row(data, at, this.n, this.moving, (i, r) => (this.base[row * this.moving + i] = r));
  }

  // Groups that a time needs: of the frames before and behind it.
  needed(t) {
    const at = Math.min(1, Math.max(0, t)) * (this.frames - 1), k = Math.min(Math.floor(at), this.frames - 2);
    return { k, u: at - k, groups: [Math.floor(k / this.group), Math.floor((k + 1) / this.group)] };
  }
  has(t) {
    return this.needed(t).groups.every((g) => this.groups.has(g));
  }
  async load(t) {
    const { groups } = this.needed(t), next = groups[1] + 1;
    await Promise.all(groups.map((g) => this.load_group(g)));
    if (next * this.group < this.frames) this.load_group(next).catch(() => {}); // ahead of playing
  }
  load_group(g) {
    if (this.groups.has(g)) return Promise.resolve();
    if (!this.loading.has(g)) this.loading.set(g, this.read_group(g).finally(() => this.loading.delete(g)));
    return this.loading.get(g);
  }
  async read_group(g) {
    const first = g * this.group, last = Math.min(first + this.group, this.frames) - 1, from = this.place[first];
    const end = this.place[last] + this.length[last], data = await this.bytes(from + "-" + (end - 1), end - from);
    const frames = [];
    for (let k = first; k <= last; k++) {
      const before = k === first ? this.base : frames[k - first - 1], earlier = frames[k - first - 2];
      const values = new Int32Array(SEQUENCE_ROWS * this.moving);
      for (let row = 0, at = this.place[k] - from; row < SEQUENCE_ROWS; row++) {
        const o = row * this.moving;
        at = read_row(data, at, this.moving, this.moving, (i, r, is_linear) => (values[o + i] = r + (is_linear ? 2 * before[o + i] - earlier[o + i] : before[o + i])));
      }
      frames.push(values);
    }
    this.groups.set(g, frames);
    if (this.groups.size > SEQUENCE_GROUPS) this.groups.delete(this.groups.keys().next().value);
  }

  // The model's arrays (sorter.js) at a time that is loaded; between two frames linearly.
  move(m, t) {
    const { k, u, groups } = this.needed(t), n = this.moving;
    const a = this.groups.get(groups[0])[k % this.group], b = this.groups.get(groups[1])[(k + 1) % this.group];
    const value = (row, i) => (a[row * n + i] + u * (b[row * n + i] - a[row * n + i])) * this.step[row];
    for (let i = 0; i < n; i++) {
      for (let c = 0; c < 3; c++) {
        (m.place[3 * i + c] = value(c, i)), (m.colour[3 * i + c] = value(11 + c, i));
        const scale = Math.exp(value(7 + c, i));
        (m.scale[3 * i + c] = scale), (m.halves[11 * i + c] = half_of(scale));
      }
      let norm = 0;
      for (let c = 0; c < 4; c++) (m.turn[4 * i + c] = value(3 + c, i)), (norm += m.turn[4 * i + c] ** 2);
      for (let c = 0; c < 4; c++) m.turn[4 * i + c] /= Math.sqrt(norm) || 1;
      m.logit[i] = value(10, i);
    }
  }
}
