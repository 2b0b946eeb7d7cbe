// SPDX-License-Identifier: Apache-2.0
// The model by WebGL2: Gaussians as quads, sorted far to near (sorter.js), blended over. The order
// is the index buffer and the corner is in the vertex number. Places and shapes are one texture,
// colours another.
"use strict";
class GraphicsPainter {
  // Throws where there is no WebGL2 that is worth it (is_forced: that is there at all).
  constructor(canvas, is_forced) {
    const wishes = { alpha: true, antialias: false, depth: false, premultipliedAlpha: true, failIfMajorPerformanceCaveat: !is_forced };
    const gl = (this.gl = canvas.getContext("webgl2", wishes));
    if (!gl) throw new Error("no WebGL2 with a graphics processor");
    const info = gl.getExtension("WEBGL_debug_renderer_info"), name = String(info ? gl.getParameter(info.UNMASKED_RENDERER_WEBGL) : gl.getParameter(gl.RENDERER));
    if (!is_forced && /swiftshader|llvmpipe|softpipe|software|basic render/i.test(name)) throw new Error(name + " is drawn by the processor");
    this.canvas = canvas, this.model = 0, this.n = 0, this.drawn = 0;
    this.make_program();
    this.textures = [0, 1].map((unit) => {
      gl.activeTexture(gl.TEXTURE0 + unit);
      const t = gl.createTexture();
      gl.bindTexture(gl.TEXTURE_2D, t);
      for (const filter of ["MIN_FILTER", "MAG_FILTER"]) gl.texParameteri(gl.TEXTURE_2D, gl["TEXTURE_" + filter], gl.NEAREST);
      return t;
    });
    gl.bindVertexArray(gl.createVertexArray());
    gl.bindBuffer(gl.ELEMENT_ARRAY_BUFFER, gl.createBuffer());
    gl.enable(gl.BLEND), gl.blendFunc(gl.ONE, gl.ONE_MINUS_SRC_ALPHA), gl.disable(gl.DEPTH_TEST);
    canvas.addEventListener("webglcontextlost", (e) => e.preventDefault());
    canvas.addEventListener("webglcontextrestored", () => location.reload());
  }

  make_program() {
    const gl = this.gl, p = gl.createProgram();
    const shader = (type, text) => {
      const s = gl.createShader(type);
      gl.shaderSource(s, text), gl.compileShader(s);
      if (!gl.getShaderParameter(s, gl.COMPILE_STATUS)) throw new Error(gl.getShaderInfoLog(s));
      gl.attachShader(p, s);
    };
    shader(gl.VERTEX_SHADER, GraphicsPainter.vertex), shader(gl.FRAGMENT_SHADER, GraphicsPainter.fragment);
    gl.linkProgram(p);
    if (!gl.getProgramParameter(p, gl.LINK_STATUS)) throw new Error(gl.getProgramInfoLog(p));
    gl.useProgram(p);
    this.at = {};
    for (const name of ["rotation", "eye", "focal", "size", "is_mip", "dilation", "data", "colours"]) this.at[name] = gl.getUniformLocation(p, name);
    gl.uniform1i(this.at.data, 0), gl.uniform1i(this.at.colours, 1);
  }

  // Rows of 1024 Gaussians; the last is filled up.
  fill(unit, per, is_new, data, format) {
    const gl = this.gl, width = 1024 * per, end = data.length / 4 / per, rows = Math.max(1, Math.ceil(end / 1024));
    gl.activeTexture(gl.TEXTURE0 + unit);
    const whole = new data.constructor(4 * width * rows);
    whole.set(data);
    if (is_new) gl.texImage2D(gl.TEXTURE_2D, 0, format[0], width, rows, 0, format[1], format[2], whole);
    else {
      const full = Math.floor(end / 1024), rest = end % 1024;
      if (full) gl.texSubImage2D(gl.TEXTURE_2D, 0, 0, 0, width, full, format[1], format[2], whole);
      if (rest) gl.texSubImage2D(gl.TEXTURE_2D, 0, 0, full, rest * per, 1, format[1], format[2], whole.subarray(4 * width * full));
    }
  }

  // An answer of sorter.js.
  take(a) {
    const gl = this.gl, is_new = a.model !== this.model;
    if (Math.ceil(a.n / 1024) > gl.getParameter(gl.MAX_TEXTURE_SIZE)) return;
    if (a.texels) this.fill(0, 2, is_new, a.texels, [gl.RGBA32UI, gl.RGBA_INTEGER, gl.UNSIGNED_INT]);
    if (a.colours) this.fill(1, 1, is_new, a.colours, [gl.RGBA8, gl.RGBA, gl.UNSIGNED_BYTE]);
    gl.bufferData(gl.ELEMENT_ARRAY_BUFFER, a.list, gl.DYNAMIC_DRAW);
    this.model = a.model, this.n = a.n, this.drawn = a.list.length / 6;
  }

  draw(f, focal, w, h, model) {
    const gl = this.gl, c = this.canvas;
    if (c.width !== w || c.height !== h) (c.width = w), (c.height = h);
    gl.viewport(0, 0, w, h), gl.clearColor(0, 0, 0, 0), gl.clear(gl.COLOR_BUFFER_BIT);
    if (!f || !this.drawn) return;
    const rows = [f.right, f.down, f.forward], m = new Float32Array(9);
    for (let r = 0; r < 3; r++) for (let k = 0; k < 3; k++) m[3 * k + r] = rows[r][k];
    gl.uniformMatrix3fv(this.at.rotation, false, m), gl.uniform3fv(this.at.eye, f.eye);
    gl.uniform1f(this.at.focal, focal), gl.uniform2f(this.at.size, w, h), gl.uniform1i(this.at.is_mip, model.is_mip ? 1 : 0), gl.uniform1f(this.at.dilation, model.dilation);
    gl.drawElements(gl.TRIANGLES, 6 * this.drawn, gl.UNSIGNED_INT, 0);
  }

  // Reading one pixel waits until the graphics are done.
  finish() {
    this.gl.readPixels(0, 0, 1, 1, this.gl.RGBA, this.gl.UNSIGNED_BYTE, new Uint8Array(4));
  }
}

// EWA projection (Zwicker et al. 2001) as in 3D Gaussian Splatting: cov2d = J R S S R' J' +
// low-pass.
GraphicsPainter.vertex = `#version 300 es
precision highp float;
precision highp int;
uniform highp usampler2D data;
uniform sampler2D colours;
uniform mat3 rotation;
uniform vec3 eye;
uniform float focal;
uniform vec2 size;
uniform int is_mip;
uniform float dilation;
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
  vec4 rgba = texelFetch(colours, ivec2(index & 1023, index >> 10), 0);
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
  xx += dilation, yy += dilation;
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
GraphicsPainter.fragment = `#version 300 es
precision mediump float;
in vec2 at;
in vec4 colour;
out vec4 o;
void main() {
  float a = min(0.99, colour.a * exp(-0.5 * dot(at, at)));
  if (a < 1.0 / 255.0) discard;
  o = vec4(colour.rgb * a, a);
}`;
