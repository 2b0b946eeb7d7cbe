// SPDX-License-Identifier: Apache-2.0
// The model in WebGL2: Gaussians as quads, sorted far to near (sorter.js), blended over. The order is the index buffer
// and the corner is in the vertex number: instances of four vertices cost far more where graphics are done in software. The compact stream
// (platform/preview/model.c) goes into a texture as it comes. Axes are the camera's: x right, y down, z forward.
"use strict";
class SplatView {
  constructor(canvas) {
    this.canvas = canvas;
    this.gl = canvas.getContext("webgl2", { alpha: true, antialias: false, depth: false, premultipliedAlpha: true });
    if (!this.gl) throw new Error("this browser has no WebGL2");
    this.n = 0, this.model = 0, this.drawn = 0, this.fps = 0, this.frame_ms = 0;
    this.quality = 1, this.is_dirty = false, this.is_sorting = false, this.wants_sort = false, this.moved_at = 0;
    this.home = null, this.camera = null;
    this.make_program();
    this.sorter = new Worker("/sorter.js");
    this.sorter.onmessage = (e) => this.take_order(e.data);
    canvas.addEventListener("webglcontextlost", (e) => e.preventDefault());
    canvas.addEventListener("webglcontextrestored", () => location.reload());
    new ResizeObserver(() => this.touch()).observe(canvas);
    this.listen();
    this.loop = this.loop.bind(this);
    requestAnimationFrame(this.loop);
  }

  make_program() {
    const gl = this.gl;
    const shader = (type, text) => {
      const s = gl.createShader(type);
      gl.shaderSource(s, text), gl.compileShader(s);
      if (!gl.getShaderParameter(s, gl.COMPILE_STATUS)) throw new Error(gl.getShaderInfoLog(s));
      return s;
    };
    const p = (this.program = gl.createProgram());
    gl.attachShader(p, shader(gl.VERTEX_SHADER, SplatView.vertex));
    gl.attachShader(p, shader(gl.FRAGMENT_SHADER, SplatView.fragment));
    gl.linkProgram(p);
    if (!gl.getProgramParameter(p, gl.LINK_STATUS)) throw new Error(gl.getProgramInfoLog(p));
    gl.useProgram(p);
    this.at = {};
    for (const name of ["rotation", "eye", "focal", "size", "is_mip"]) this.at[name] = gl.getUniformLocation(p, name);
    gl.bindVertexArray(gl.createVertexArray());
    gl.bindBuffer(gl.ELEMENT_ARRAY_BUFFER, gl.createBuffer());
    gl.bindTexture(gl.TEXTURE_2D, gl.createTexture());
    for (const name of ["MIN_FILTER", "MAG_FILTER"]) gl.texParameteri(gl.TEXTURE_2D, gl["TEXTURE_" + name], gl.NEAREST);
    gl.enable(gl.BLEND), gl.blendFunc(gl.ONE, gl.ONE_MINUS_SRC_ALPHA), gl.disable(gl.DEPTH_TEST);
  }

  // An answer of /model. False when it is not one.
  load(buffer) {
    const head = new DataView(buffer);
    if (buffer.byteLength < 96 || head.getUint32(0, true) !== 0x31475653 || head.getUint32(8, true) !== 32) return false;
    const n = head.getUint32(4, true), f = (i) => head.getFloat32(32 + 4 * i, true), gl = this.gl;
    if (buffer.byteLength < 96 + 32 * n) return false;
    const rows = Math.max(1, Math.ceil(n / 1024));
    if (rows > gl.getParameter(gl.MAX_TEXTURE_SIZE)) return false;
    const texels = new Uint32Array(rows * 1024 * 8);
    texels.set(new Uint32Array(buffer, 96, 8 * n));
    gl.texImage2D(gl.TEXTURE_2D, 0, gl.RGBA32UI, 2048, rows, 0, gl.RGBA_INTEGER, gl.UNSIGNED_INT, texels);
    const floats = new Float32Array(texels.buffer), positions = new Float32Array(3 * n);
    for (let i = 0; i < n; i++)
      (positions[3 * i] = floats[8 * i]), (positions[3 * i + 1] = floats[8 * i + 1]), (positions[3 * i + 2] = floats[8 * i + 2]);
    this.is_mip = head.getUint32(20, true);
    this.step = head.getUint32(12, true);
    if (n !== this.n) this.drawn = 0;
    this.n = n, this.model++;
    this.sorter.postMessage({ positions, model: this.model }, [positions.buffer]);
    const home = { target: [f(0), f(1), f(2)], radius: f(3), eye: [f(4), f(5), f(6)], up: [f(7), f(8), f(9)], fov: f(10) };
    const is_other = !this.home || home.target.some((v, i) => Math.abs(v - this.home.target[i]) > 1e-3 * home.radius);
    this.home = home;
    if (!this.camera || is_other) this.reset();
    this.sort(), this.touch();
    return true;
  }

  clear() {
    this.n = this.drawn = 0, this.home = null, this.camera = null;
    this.touch();
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
    this.sort(), this.touch();
  }

  frame() {
    const c = this.camera, cp = Math.cos(c.pitch), sp = Math.sin(c.pitch), cy = Math.cos(c.yaw), sy = Math.sin(c.yaw);
    const back = [0, 1, 2].map((i) => cp * (cy * c.x[i] + sy * c.y[i]) + sp * c.up[i]);
    const forward = back.map((v) => -v), right = SplatView.unit(SplatView.cross(forward, c.up));
    const down = SplatView.cross(forward, right);
    return { right, down, forward, eye: c.target.map((v, i) => v + c.distance * back[i]) };
  }

  turn(dx, dy) {
    if (!this.camera) return;
    this.camera.yaw -= dx, this.camera.pitch = Math.max(-1.54, Math.min(1.54, this.camera.pitch + dy));
    this.moved();
  }
  zoom(factor) {
    if (!this.camera) return;
    this.camera.distance = Math.max(1e-3 * (this.home.radius || 1), Math.min(1e3 * (this.home.radius || 1), this.camera.distance * factor));
    this.moved();
  }
  pan(dx, dy) { // of the canvas' height
    if (!this.camera) return;
    const f = this.frame(), s = 2 * Math.tan(this.home.fov / 2) * this.camera.distance;
    for (let i = 0; i < 3; i++) this.camera.target[i] -= s * (dx * f.right[i] + dy * f.down[i]);
    this.moved();
  }
  moved() {
    this.moved_at = performance.now();
    this.sort(), this.touch();
  }

  listen() {
    const c = this.canvas, pointers = new Map();
    let spread = 0, mid = null;
    const two = () => {
      const [a, b] = [...pointers.values()];
      return { spread: Math.hypot(a.x - b.x, a.y - b.y), mid: { x: (a.x + b.x) / 2, y: (a.y + b.y) / 2 } };
    };
    c.addEventListener("pointerdown", (e) => {
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
    for (const name of ["pointerup", "pointercancel"]) c.addEventListener(name, (e) => pointers.delete(e.pointerId));
    c.addEventListener("contextmenu", (e) => e.preventDefault());
    c.addEventListener("dblclick", () => this.reset());
    c.addEventListener("wheel", (e) => (e.preventDefault(), this.zoom(Math.exp(e.deltaY * (e.deltaMode ? 0.04 : 0.0013)))), { passive: false });
    const keys = { ArrowLeft: [-0.1, 0], ArrowRight: [0.1, 0], ArrowUp: [0, -0.1], ArrowDown: [0, 0.1] };
    c.addEventListener("keydown", (e) => {
      if (keys[e.key]) e.preventDefault(), this.turn(...keys[e.key]);
      else if (e.key === "+" || e.key === "=") this.zoom(0.9);
      else if (e.key === "-") this.zoom(1.1);
      else if (e.key === "Home") this.reset();
    });
  }

  // --- order and drawing ---
  sort() {
    if (!this.n || !this.camera) return;
    if (this.is_sorting) {
      this.wants_sort = true;
      return;
    }
    this.is_sorting = true, this.wants_sort = false;
    this.sorter.postMessage({ forward: this.frame().forward });
  }

  take_order(m) {
    const gl = this.gl;
    this.is_sorting = false;
    if (m.list.length <= 6 * this.n) { // of this model, or of one of the same size just before it
      gl.bufferData(gl.ELEMENT_ARRAY_BUFFER, m.list, gl.DYNAMIC_DRAW);
      this.drawn = m.list.length / 6;
    }
    if (this.wants_sort || m.model !== this.model) this.sort();
    this.touch();
  }

  touch() {
    this.is_dirty = true;
  }

  loop(now) {
    requestAnimationFrame(this.loop);
    const is_moving = now - this.moved_at < 250;
    // Slow machines get fewer pixels while the model turns, and all of them when it rests.
    const wanted = is_moving ? this.quality : 1;
    if (wanted !== this.scale) (this.scale = wanted), (this.is_dirty = true);
    if (!this.is_dirty || document.hidden) return;
    this.is_dirty = false;
    const is_measured = is_moving && ((this.n_moving = (this.n_moving || 0) + 1) % 3 === 0 || this.frame_ms > 60), begin = performance.now();
    this.draw();
    if (is_measured) this.adapt(begin);
  }

  // How long a picture takes, the graphics' work included: reading one pixel waits for it.
  adapt(begin) {
    this.gl.readPixels(0, 0, 1, 1, this.gl.RGBA, this.gl.UNSIGNED_BYTE, new Uint8Array(4));
    const ms = performance.now() - begin;
    this.frame_ms = this.frame_ms ? 0.6 * this.frame_ms + 0.4 * ms : ms;
    this.fps = Math.min(60, 1000 / this.frame_ms);
    if (ms > 40 || ms < 12) this.quality = Math.max(0.25, Math.min(1, this.quality * Math.max(0.35, Math.min(1.15, Math.sqrt(25 / ms)))));
  }

  draw() {
    const gl = this.gl, c = this.canvas, ratio = Math.min(devicePixelRatio || 1, 2) * (this.scale || 1);
    const w = Math.max(1, Math.round(c.clientWidth * ratio)), h = Math.max(1, Math.round(c.clientHeight * ratio));
    if (c.width !== w || c.height !== h) (c.width = w), (c.height = h);
    gl.viewport(0, 0, w, h), gl.clearColor(0, 0, 0, 0), gl.clear(gl.COLOR_BUFFER_BIT);
    if (!this.n || !this.drawn || !this.camera) return;
    const f = this.frame(), focal = (0.5 * Math.min(h, 0.8 * w)) / Math.tan(this.home.fov / 2);
    const rows = [f.right, f.down, f.forward], m = new Float32Array(9);
    for (let r = 0; r < 3; r++) for (let k = 0; k < 3; k++) m[3 * k + r] = rows[r][k];
    gl.uniformMatrix3fv(this.at.rotation, false, m), gl.uniform3fv(this.at.eye, f.eye);
    gl.uniform1f(this.at.focal, focal), gl.uniform2f(this.at.size, w, h), gl.uniform1i(this.at.is_mip, this.is_mip ? 1 : 0);
    gl.drawElements(gl.TRIANGLES, 6 * this.drawn, gl.UNSIGNED_INT, 0);
    this.frames = (this.frames || 0) + 1;
  }

  static unit(v) {
    const n = Math.hypot(...v) || 1;
    return v.map((x) => x / n);
  }
  static cross(a, b) {
    return [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
  }
}

// EWA projection (Zwicker et al. 2001) as in 3D Gaussian Splatting: cov2d = J R S S R' J' + 0.3.
SplatView.vertex = `#version 300 es
precision highp float;
precision highp int;
uniform highp usampler2D data;
uniform mat3 rotation;
uniform vec3 eye;
uniform float focal;
uniform vec2 size;
uniform int is_mip;
out vec2 at;
out vec4 colour;
void main() {
  int index = gl_VertexID >> 2;
  vec2 corner = vec2(float(2 * (gl_VertexID & 1) - 1), float((gl_VertexID & 2) - 1));
  ivec2 t = ivec2((index & 1023) * 2, index >> 10);
  uvec4 a = texelFetch(data, t, 0), b = texelFetch(data, t + ivec2(1, 0), 0);
  vec3 p = rotation * (uintBitsToFloat(a.xyz) - eye);
  gl_Position = vec4(0.0, 0.0, 2.0, 1.0);
  if (p.z < 0.05) return;
  vec2 limit = 1.3 * 0.5 * size / focal, q = clamp(p.xy / p.z, -limit, limit);
  vec4 rgba = vec4(a.w & 255u, (a.w >> 8) & 255u, (a.w >> 16) & 255u, a.w >> 24) / 255.0;
  vec2 sxy = unpackHalf2x16(b.x), szq = unpackHalf2x16(b.y & 65535u);
  vec3 s = vec3(sxy, szq.x);
  int w = int(b.y) >> 16, x = int(b.z << 16) >> 16, y = int(b.z) >> 16, z = int(b.w << 16) >> 16;
  vec4 r = normalize(vec4(x, y, z, w));
  mat3 m = mat3(1.0 - 2.0 * (r.y * r.y + r.z * r.z), 2.0 * (r.x * r.y + r.w * r.z), 2.0 * (r.x * r.z - r.w * r.y),
                2.0 * (r.x * r.y - r.w * r.z), 1.0 - 2.0 * (r.x * r.x + r.z * r.z), 2.0 * (r.y * r.z + r.w * r.x),
                2.0 * (r.x * r.z + r.w * r.y), 2.0 * (r.y * r.z - r.w * r.x), 1.0 - 2.0 * (r.x * r.x + r.y * r.y));
  mat3 v = rotation * m * mat3(s.x, 0, 0, 0, s.y, 0, 0, 0, s.z);
  vec3 jx = vec3(1.0, 0.0, -q.x) * (focal / p.z), jy = vec3(0.0, 1.0, -q.y) * (focal / p.z);
  vec3 ux = jx * v, uy = jy * v;
  float xx = dot(ux, ux), xy = dot(ux, uy), yy = dot(uy, uy);
  float before = max(0.0, xx * yy - xy * xy);
  xx += 0.3, yy += 0.3;
  if (is_mip != 0) rgba.a *= sqrt(before / (xx * yy - xy * xy));
  if (rgba.a < 1.0 / 255.0) return;
  float mid = 0.5 * (xx + yy), d = length(vec2(0.5 * (xx - yy), xy));
  float l1 = mid + d, l2 = max(mid - d, 0.05);
  vec2 axis = abs(xy) > 1e-6 * mid ? normalize(vec2(xy, l1 - xx)) : xx >= yy ? vec2(1.0, 0.0) : vec2(0.0, 1.0);
  float reach = sqrt(2.0 * log(255.0 * rgba.a));
  vec2 offset = corner.x * reach * sqrt(l1) * axis + corner.y * reach * sqrt(l2) * vec2(-axis.y, axis.x);
  vec2 px = focal * p.xy / p.z + offset;
  at = corner * reach;
  colour = rgba;
  gl_Position = vec4(2.0 * px.x / size.x, -2.0 * px.y / size.y, 0.0, 1.0);
}`;
SplatView.fragment = `#version 300 es
precision mediump float;
in vec2 at;
in vec4 colour;
out vec4 o;
void main() {
  float a = min(0.99, colour.a * exp(-0.5 * dot(at, at)));
  if (a < 1.0 / 255.0) discard;
  o = vec4(colour.rgb * a, a);
}`;
