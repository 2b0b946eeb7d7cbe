// SPDX-License-Identifier: Apache-2.0
// The model on the page: camera, fingers, time. sorter.js sees it from there, paint.js draws it
// where there is a graphics processor; where graphics are done in software sorter.js draws it
// itself, which is faster. ?draw=gl and ?draw=flat choose. Axes are the camera's: x right, y down,
// z forward.
"use strict";
class SplatView {
  constructor(canvas) {
    this.canvas = canvas;
    this.n = 0, this.model = 0, this.drawn = 0, this.fps = 0, this.frame_ms = 0, this.frames = 0;
    this.quality = 1, this.most = 1, this.is_dirty = false, this.is_busy = false, this.wants_more = false, this.moved_at = 0;
    this.home = null, this.camera = null, this.time = 1, this.is_playing = false;
    this.show_as = "", this.box = null, this.is_turning = false, this.is_flying = false, this.n_asked = 0, this.asked = new Map();
    const wanted = new URLSearchParams(location.search).get("draw");
    try {
      this.graphics = wanted === "flat" ? null : new GraphicsPainter(canvas, wanted === "gl");
    } catch (e) {
      // A context that was refused late stays
      if (canvas.getContext("2d") === null) canvas = this.replace_canvas();
      this.graphics = null;
    }
    this.plane = this.graphics ? null : this.canvas.getContext("2d");
    this.sorter = new Worker(SplatView.worker || "/sorter.js");
    this.sorter.onmessage = (e) => (e.data.asked ? this.answer(e.data) : e.data.sequence ? this.take_sequence(e.data.sequence) : this.take(e.data));
    new ResizeObserver(() => this.touch()).observe(this.canvas);
    this.listen();
    this.loop = this.loop.bind(this);
    requestAnimationFrame(this.loop);
  }

  replace_canvas() {
    const c = this.canvas.cloneNode();
    this.canvas.replaceWith(c);
    return (this.canvas = c);
  }

  // An answer of /model. False when it is not one.
  load(buffer) {
    const head = new DataView(buffer), f = (i) => head.getFloat32(64 + 4 * i, true), u = (i) => head.getUint32(4 * i, true);
    if (buffer.byteLength < 128 || u(0) !== 0x32475653) return false;
    const n = u(1), sh = (3 * ((u(5) + 1) ** 2 - 1) * n + 3) & ~3;
    if (u(5) > 3 || buffer.byteLength < 128 + 34 * n + sh + 4 * u(6) * u(7)) return false;
    this.n = n, this.step = u(2), this.is_mip = u(4) & 1, this.dilation = head.getFloat32(48, true), this.model++;
    this.canvas.style.background = u(4) >>> 8 ? "#" + (u(4) >>> 8).toString(16).padStart(6, "0") : "";
    this.is_metric = u(15) & 1, this.n_eyes = (u(15) >> 8) & 255, this.scale_sigma = (u(15) >>> 16) / 1e6;
    this.clip = u(8) ? { first: f(11), last: f(12), seconds: f(13) } : null;
    const home = { target: [f(0), f(1), f(2)], radius: f(3), eye: [f(4), f(5), f(6)], up: [f(7), f(8), f(9)], fov: f(10) };
    // Which takes it away from here
    this.sorter.postMessage({ buffer, model: this.model }, [buffer]);
    const is_other = !this.home || home.target.some((v, i) => Math.abs(v - this.home.target[i]) > 1e-3 * home.radius);
    this.home = home;
    if (!this.camera || is_other) this.reset();
    this.see(), this.touch();
    return true;
  }

  // The frames of the loaded model, from a file that is read by ranges.
  load_sequence(url) {
    this.sorter.postMessage({ sequence: url });
  }
  take_sequence(s) {
    if (s.model !== this.model || s.error) return;
    this.clip = { first: 0, last: 1, seconds: s.seconds };
    this.see(), this.touch();
    if (this.on_time) this.on_time();
  }

  clear() {
    this.canvas.style.background = "";
    this.n = this.drawn = 0, this.home = this.camera = this.clip = null, this.is_playing = false;
    if (this.graphics) this.graphics.drawn = 0;
    else this.plane.clearRect(0, 0, this.canvas.width, this.canvas.height);
    this.touch();
  }

  // --- time: 0..1 from the first to the last exposure ---
  set_time(t) {
    this.time = Math.min(1, Math.max(0, t));
    if (this.clip) this.see(), this.touch();
  }
  play(is) {
    this.is_playing = is && !!this.clip, this.played_at = performance.now();
  }

  // --- camera: a target, a distance, and two angles about the world's up ---
  reset() {
    const h = this.home;
    if (!h) return;
    const up = SplatView.unit(h.up);
    let x = SplatView.cross(up, Math.abs(up[0]) < 0.8 ? [1, 0, 0] : [0, 1, 0]);
    x = SplatView.unit(x);
    const y = SplatView.cross(up, x), d = h.eye.map((v, i) => v - h.target[i]);
    const along = (a) => d[0] * a[0] + d[1] * a[1] + d[2] * a[2];
    const distance = Math.hypot(...d) || 3 * h.radius || 1;
    this.camera = { target: h.target.slice(), distance, yaw: Math.atan2(along(y), along(x)), pitch: Math.asin(Math.max(-1, Math.min(1, along(up) / distance))), up, x, y };
    this.see(), this.touch();
  }

  frame() {
    const c = this.camera, cp = Math.cos(c.pitch), sp = Math.sin(c.pitch), cy = Math.cos(c.yaw), sy = Math.sin(c.yaw);
    const back = [0, 1, 2].map((i) => cp * (cy * c.x[i] + sy * c.y[i]) + sp * c.up[i]);
    const forward = back.map((v) => -v), right = SplatView.unit(SplatView.cross(forward, c.up));
    const down = SplatView.cross(forward, right);
    return { right, down, forward, eye: c.target.map((v, i) => v + c.distance * back[i]) };
  }

  // Orbiting turns the eye about the target, flying the target about the eye.
  turn(dx, dy) {
    if (!this.camera) return;
    const eye = this.frame().eye;
    this.camera.yaw -= dx, this.camera.pitch = Math.max(-1.54, Math.min(1.54, this.camera.pitch + dy));
    if (this.is_flying) {
      const forward = this.frame().forward;
      this.camera.target = eye.map((v, i) => v + this.camera.distance * forward[i]);
    }
    this.moved();
  }
  // Right, down and forward, of the distance to the target.
  fly(x, y, z) {
    if (!this.camera) return;
    const f = this.frame(), d = this.camera.distance;
    for (let i = 0; i < 3; i++) this.camera.target[i] += d * (x * f.right[i] + y * f.down[i] + z * f.forward[i]);
    this.moved();
  }
  zoom(factor) {
    if (!this.camera) return;
    if (this.is_flying) return this.fly(0, 0, 1 - factor);
    this.camera.distance = Math.max(1e-3 * (this.home.radius || 1), Math.min(1e3 * (this.home.radius || 1), this.camera.distance * factor));
    this.moved();
  }
  pan(dx, dy) { // of the canvas' height
    if (!this.camera) return;
    const f = this.frame(), s = 2 * Math.tan(this.home.fov / 2) * this.camera.distance;
    for (let i = 0; i < 3; i++) this.camera.target[i] -= s * (dx * f.right[i] + dy * f.down[i]);
    this.moved();
  }
  // The camera as text for a link, and back. False: it is none.
  place() {
    const c = this.camera;
    return c ? [...c.target, c.distance, c.yaw, c.pitch, this.time].map((v) => +v.toPrecision(5)).join(",") : "";
  }
  go_to(text) {
    const v = String(text).split(",").map(Number);
    if (!this.camera || v.length !== 7 || !v.every(Number.isFinite) || !(v[3] > 0)) return false;
    Object.assign(this.camera, { target: v.slice(0, 3), distance: v[3], yaw: v[4], pitch: Math.max(-1.54, Math.min(1.54, v[5])) });
    this.set_time(v[6]), this.moved();
    return true;
  }
  moved() {
    this.moved_at = performance.now();
    this.see(), this.touch();
  }

  listen() {
    const c = this.canvas, pointers = new Map();
    let spread = 0, mid = null;
    const two = () => {
      const [a, b] = [...pointers.values()];
      return { spread: Math.hypot(a.x - b.x, a.y - b.y), mid: { x: (a.x + b.x) / 2, y: (a.y + b.y) / 2 } };
    };
    let down = null;
    c.addEventListener("pointerdown", (e) => {
      down = pointers.size ? null : { x: e.clientX, y: e.clientY };
      c.setPointerCapture(e.pointerId);
      pointers.set(e.pointerId, { x: e.clientX, y: e.clientY });
      if (pointers.size === 2) ({ spread, mid } = two());
    });
    c.addEventListener("pointermove", (e) => {
      const p = pointers.get(e.pointerId);
      if (!p) return;
      const dx = e.clientX - p.x, dy = e.clientY - p.y, h = c.clientHeight || 1;
      (p.x = e.clientX), (p.y = e.clientY);
      if (pointers.size >= 2) {
        const now = two();
        if (spread > 0 && now.spread > 0) this.zoom(spread / now.spread);
        this.pan((now.mid.x - mid.x) / h, (now.mid.y - mid.y) / h);
        ({ spread, mid } = now);
      } else if (e.shiftKey || e.buttons & 2) this.pan(dx / h, dy / h);
      else this.turn((dx / h) * 3.2, (dy / h) * 3.2);
    });
    c.addEventListener("pointerup", (e) => {
      const at = c.getBoundingClientRect();
      if (down && Math.hypot(e.clientX - down.x, e.clientY - down.y) < 6 && this.on_tap) this.on_tap(e.clientX - at.left, e.clientY - at.top);
    });
    for (const name of ["pointerup", "pointercancel"]) c.addEventListener(name, (e) => pointers.delete(e.pointerId));
    c.addEventListener("contextmenu", (e) => e.preventDefault());
    c.addEventListener("dblclick", () => this.reset());
    c.addEventListener("wheel", (e) => (e.preventDefault(), this.zoom(Math.exp(e.deltaY * (e.deltaMode ? 0.04 : 0.0013)))), { passive: false });
    const keys = { ArrowLeft: [-0.1, 0], ArrowRight: [0.1, 0], ArrowUp: [0, -0.1], ArrowDown: [0, 0.1] };
    const flights = { w: [0, 0, 0.06], s: [0, 0, -0.06], a: [-0.06, 0, 0], d: [0.06, 0, 0], q: [0, 0.06, 0], e: [0, -0.06, 0] };
    c.addEventListener("keydown", (e) => {
      if (e.ctrlKey || e.altKey || e.metaKey) return;
      if (keys[e.key]) e.preventDefault(), this.turn(...keys[e.key]);
      else if (e.key === "+" || e.key === "=") this.zoom(0.9);
      else if (e.key === "-") this.zoom(1.1);
      else if (e.key === "Home") this.reset();
      else if (flights[e.key]) this.fly(...flights[e.key]);
      else if (e.key === "Enter" && this.on_tap) this.on_tap(c.clientWidth / 2, c.clientHeight / 2);
    });
  }

  // --- seeing and drawing ---
  size() {
    const c = this.canvas, ratio = Math.min(devicePixelRatio || 1, this.graphics ? 2 : 1) * (this.scale || 1);
    const width = Math.max(1, Math.round(c.clientWidth * ratio)), height = Math.max(1, Math.round(c.clientHeight * ratio));
    return { width, height, focal: this.home ? (0.5 * Math.min(height, 0.8 * width)) / Math.tan(this.home.fov / 2) : 0 };
  }

  see() {
    if (!this.n || !this.camera) return;
    if (this.is_busy) {
      this.wants_more = true;
      return;
    }
    const time = this.clip ? this.clip.first + this.time * (this.clip.last - this.clip.first) : 0;
    this.is_busy = true, this.wants_more = false, this.asked_at = performance.now();
    this.sorter.postMessage({ look: { ...this.frame(), time, show: this.show_as, box: this.box, ...(this.graphics ? {} : this.size()) } });
  }

  // --- questions: of the surface under a place of the canvas, of the model's extent ---
  ask(what) {
    const id = ++this.n_asked;
    return new Promise((done) => {
      this.asked.set(id, done);
      this.sorter.postMessage({ ask: { id, ...what } });
    });
  }
  answer(a) {
    this.asked.get(a.asked)(a.answer);
    this.asked.delete(a.asked);
  }
  // Of places in pixels of the page, from the upper left of the canvas.
  lens() {
    const width = Math.max(1, this.canvas.clientWidth), height = Math.max(1, this.canvas.clientHeight);
    return { ...this.frame(), width, height, focal: (0.5 * Math.min(height, 0.8 * width)) / Math.tan(this.home.fov / 2) };
  }
  // A point of the world with its uncertainty, null: no surface is seen there.
  async pick(x, y) {
    if (!this.n || !this.camera) return null;
    const look = this.lens(), d = await this.ask({ look, x, y });
    if (!d) return null;
    const u = (x - 0.5 * look.width) / look.focal, v = (y - 0.5 * look.height) / look.focal;
    const ray = [0, 1, 2].map((i) => u * look.right[i] + v * look.down[i] + look.forward[i]);
    return { at: ray.map((r, i) => look.eye[i] + d.depth * r), ray, focal: look.focal, ...d };
  }
  // A point of the world on the canvas, null: it lies behind.
  project(point) {
    const f = this.lens(), d = point.map((v, i) => v - f.eye[i]), along = (a) => d[0] * a[0] + d[1] * a[1] + d[2] * a[2], z = along(f.forward);
    return z > 0 ? { x: 0.5 * f.width + (f.focal * along(f.right)) / z, y: 0.5 * f.height + (f.focal * along(f.down)) / z } : null;
  }
  axes() {
    const c = this.camera;
    return [c.x, c.y, c.up];
  }
  // The largest share of the screen's pixels a side that is drawn.
  set_quality(most) {
    this.most = most, this.touch();
  }
  set_show(how) {
    this.show_as = how, this.see(), this.touch();
  }
  set_box(box) {
    this.box = box, this.see(), this.touch();
  }

  take(a) {
    this.is_busy = false;
    if (!this.n) return; // New was pressed meanwhile
    this.drawn = a.n;
    if (a.picture) this.show(a);
    else this.graphics.take(a);
    if (this.wants_more || a.model !== this.model) this.see();
    if (this.graphics) this.touch();
  }

  show(a) {
    const c = this.canvas;
    if (c.width !== a.width || c.height !== a.height) (c.width = a.width), (c.height = a.height);
    this.plane.putImageData(new ImageData(a.picture, a.width, a.height), 0, 0);
    this.frames++;
    if (this.is_moving()) this.adapt(a.ms, performance.now() - this.asked_at);
  }

  touch() {
    this.is_dirty = true;
  }
  is_moving() {
    return this.is_playing || performance.now() - this.moved_at < 250;
  }

  loop(now) {
    requestAnimationFrame(this.loop);
    if (this.is_playing && !this.is_busy) {
      this.time = (this.time + (performance.now() - this.played_at) / 1000 / Math.max(0.2, this.clip ? this.clip.seconds : 1)) % 1;
      this.played_at = performance.now();
      this.see(), this.touch();
      if (this.on_time) this.on_time();
    }
    if (this.is_turning && !this.is_busy && this.camera) {
      this.camera.yaw -= 0.0004 * Math.min(100, now - (this.turned_at || now)), this.turned_at = now;
      this.moved();
    }
    if (this.on_frame) this.on_frame();
    // Slow machines get fewer pixels while the model turns, and all of them when it rests.
    const wanted = Math.min(this.most, this.is_moving() ? this.quality : 1);
    if (wanted !== this.scale) (this.scale = wanted), (this.is_dirty = true);
    if (!this.is_dirty || document.hidden) return;
    this.is_dirty = false;
    if (!this.graphics) return this.see();
    const is_measured = this.is_moving() && (this.frames % 3 === 0 || this.frame_ms > 60), begin = performance.now();
    this.draw();
    if (!is_measured) return;
    this.graphics.finish();
    const ms = performance.now() - begin;
    this.adapt(ms, ms);
  }

  // ms: what a picture costs; whole_ms: how far two of them are apart.
  adapt(ms, whole_ms) {
    this.frame_ms = this.frame_ms ? 0.6 * this.frame_ms + 0.4 * whole_ms : whole_ms;
    this.fps = Math.min(60, 1000 / this.frame_ms);
    if (ms > 40 || ms < 20) this.quality = Math.max(0.25, Math.min(1, this.quality * Math.max(0.5, Math.min(1.15, Math.sqrt(30 / ms)))));
  }

  draw() {
    const s = this.size();
    this.graphics.draw(this.n && this.camera ? this.frame() : null, s.focal, s.width, s.height, this);
    this.frames++;
  }

  // The drawn pixels: RGBA, rows from either end.
  pixels() {
    const c = this.canvas;
    if (this.plane) return this.plane.getImageData(0, 0, c.width, c.height).data;
    const out = new Uint8Array(4 * c.width * c.height);
    this.draw();
    this.graphics.gl.readPixels(0, 0, c.width, c.height, 6408, 5121, out);
    return out;
  }

  // The picture as it stands, over black.
  picture() {
    const c = document.createElement("canvas"), g = c.getContext("2d");
    if (this.graphics) this.draw();
    (c.width = this.canvas.width), (c.height = this.canvas.height);
    g.fillRect(0, 0, c.width, c.height), g.drawImage(this.canvas, 0, 0);
    return new Promise((done) => c.toBlob(done, "image/png"));
  }

  static unit(v) {
    const n = Math.hypot(...v) || 1;
    return v.map((x) => x / n);
  }
  static cross(a, b) {
    return [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
  }
}
