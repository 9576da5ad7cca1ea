// Draws splats with WebGL 2: a square each, as large on the screen as its Gaussian (elliptical weighted average; Zwicker
// et al. 2001, Kerbl et al. 2023), blended from the farthest to the nearest. An instance is a group of squares: single
// ones leave most of a graphics card idle, and software renderers take many times longer for them.
"use strict";

const TEXTURE_SIDE = 1024; // splats in a row of the textures
const GROUP = 256; // squares of an instance

const SPLAT_VERTEX = `#version 300 es
precision highp float;
precision highp int;
precision highp usampler2D;
precision highp sampler2DArray;
uniform usampler2D splats, harmonics, order;
uniform int count;
uniform sampler2DArray colours;
uniform mat3 axes;       // rows: right, up, back
uniform vec3 eye;
uniform vec2 focal, size; // pixels
uniform vec4 light;      // two lights, how much of the second, whether there are harmonics
uniform float unit, grow, strength, near;
out vec2 offset;
out vec4 colour;

vec3 linear(vec3 c) { return mix(c / 12.92, pow((c + 0.055) / 1.055, vec3(2.4)), greaterThan(c, vec3(0.04045))); }
vec3 encoded(vec3 c) { return mix(c * 12.92, 1.055 * pow(c, vec3(1.0 / 2.4)) - 0.055, greaterThan(c, vec3(0.0031308))); }
vec4 bytes(uint v) { return vec4(v & 255u, (v >> 8) & 255u, (v >> 16) & 255u, v >> 24) - 128.0; }

vec3 shade(ivec2 at, vec3 ray) {
  vec3 first = texelFetch(colours, ivec3(at, int(light.x)), 0).rgb, c = first;
  if (light.z > 0.0) {
    vec3 second = texelFetch(colours, ivec3(at, int(light.y)), 0).rgb;
    c = encoded(mix(linear(first), linear(second), light.z));
  }
  if (light.w < 0.5) return c;
  uvec4 packed = texelFetch(harmonics, at, 0);
  vec4 a = bytes(packed.x), b = bytes(packed.y), d = bytes(packed.z);
  vec3 change = 0.4886025 * strength / 127.0 *
    (-ray.y * a.xyz + ray.z * vec3(a.w, b.xy) - ray.x * vec3(b.zw, d.x));
  // Harmonics belong to the first light: as a factor, they suit the others too.
  vec3 base = texelFetch(colours, ivec3(at, 0), 0).rgb;
  return clamp(c * clamp((base + change) / max(base, 0.02), 0.4, 2.5), 0.0, 1.0);
}

void main() {
  gl_Position = vec4(0.0, 0.0, 2.0, 1.0);
  int place = gl_InstanceID * ${GROUP} + (gl_VertexID >> 2);
  if (place >= count) return;
  int number = int(texelFetch(order, ivec2(place % ${TEXTURE_SIDE}, place / ${TEXTURE_SIDE}), 0).x);
  ivec2 at = ivec2(number % ${TEXTURE_SIDE}, number / ${TEXTURE_SIDE});
  vec2 corner = vec2(gl_VertexID & 1, gl_VertexID >> 1 & 1) * 2.0 - 1.0;
  uvec4 first = texelFetch(splats, ivec2(2 * at.x, at.y), 0), second = texelFetch(splats, ivec2(2 * at.x + 1, at.y), 0);
  vec3 away = uintBitsToFloat(first.xyz) - eye, p = axes * away;
  float depth = -p.z;
  if (depth <= near) return;
  float opacity = float(first.w & 255u) / 255.0;
  vec2 xx = unpackHalf2x16(second.x), xz = unpackHalf2x16(second.y), zz = unpackHalf2x16(second.z);
  mat3 sigma = mat3(xx.x, xx.y, xz.x, xx.y, xz.y, zz.x, xz.x, zz.x, zz.y) * (unit * unit * grow * grow);
  // The projection's slope, not beyond the picture's border, where it is far from linear.
  vec2 lean = clamp(p.xy / depth, -0.65 * size / focal, 0.65 * size / focal);
  vec3 jx = transpose(axes) * vec3(focal.x, 0.0, focal.x * lean.x) / depth;
  vec3 jy = transpose(axes) * vec3(0.0, focal.y, focal.y * lean.y) / depth;
  float a = dot(jx, sigma * jx) + 0.3, b = dot(jx, sigma * jy), c = dot(jy, sigma * jy) + 0.3;
  float mean = 0.5 * (a + c), spread = length(vec2(0.5 * (a - c), b));
  float large = min(mean + spread, 1e6), small = max(mean - spread, 0.1);
  vec2 axis = spread > 1e-9 ? normalize(abs(b) > 1e-9 ? vec2(b, mean + spread - a) : a >= c ? vec2(1, 0) : vec2(0, 1))
    : vec2(1.0, 0.0);
  float reach = sqrt(max(2.0 * log(255.0 * opacity), 0.0)); // where it falls below what a screen shows
  if (reach <= 0.0) return;
  offset = corner * reach;
  vec2 pixels = offset.x * sqrt(large) * axis + offset.y * sqrt(small) * vec2(-axis.y, axis.x);
  vec2 centre = focal * p.xy / depth;
  if (any(greaterThan(abs(centre) - reach * sqrt(large), 0.5 * size))) return;
  gl_Position = vec4(2.0 * (centre + pixels) / size, 0.0, 1.0);
  colour = vec4(shade(at, normalize(away)), opacity);
}`;

const SPLAT_FRAGMENT = `#version 300 es
precision mediump float;
in vec2 offset;
in vec4 colour;
out vec4 pixel;
void main() {
  float alpha = colour.a * exp(-0.5 * dot(offset, offset));
  if (alpha < 1.0 / 255.0) discard;
  alpha = min(alpha, 0.99);
  pixel = vec4(colour.rgb * alpha, alpha);
}`;

const SKY_VERTEX = `#version 300 es
out vec2 place;
void main() { place = vec2(gl_VertexID & 1, gl_VertexID >> 1) * 2.0 - 1.0; gl_Position = vec4(place, 0.0, 1.0); }`;

const SKY_FRAGMENT = `#version 300 es
precision highp float;
precision mediump sampler2DArray;
uniform sampler2DArray sky;
uniform mat3 axes;
uniform vec2 half_view; // tangents
uniform vec4 light;
in vec2 place;
out vec4 pixel;
vec3 linear(vec3 c) { return mix(c / 12.92, pow((c + 0.055) / 1.055, vec3(2.4)), greaterThan(c, vec3(0.04045))); }
vec3 encoded(vec3 c) { return mix(c * 12.92, 1.055 * pow(c, vec3(1.0 / 2.4)) - 0.055, greaterThan(c, vec3(0.0031308))); }
void main() {
  vec3 ray = normalize(transpose(axes) * vec3(place * half_view, -1.0));
  vec2 at = vec2(atan(ray.x, ray.y) / 6.2831853, 0.5 - asin(clamp(ray.z, -1.0, 1.0)) / 3.1415927);
  // From the second level, the seam of the angle would show as a line.
  vec3 a = textureLod(sky, vec3(at, light.x), 0.0).rgb, b = textureLod(sky, vec3(at, light.y), 0.0).rgb;
  pixel = vec4(encoded(mix(linear(a), linear(b), light.z)), 1.0);
}`;

class Picture {
  constructor(canvas, city) {
    const gl = canvas.getContext("webgl2", { antialias: false, depth: false, stencil: false, alpha: false,
      powerPreference: "high-performance", preserveDrawingBuffer: true });
    if (!gl) throw new Error("this browser has no WebGL 2");
    Object.assign(this, { canvas, gl, city, loaded: 0, order: 0, room: 0, strength: 0 });
    this.splatProgram = this.program(SPLAT_VERTEX, SPLAT_FRAGMENT);
    this.skyProgram = this.program(SKY_VERTEX, SKY_FRAGMENT);
    this.makeArrays();
    this.makeTextures();
    this.makeSky();
    gl.disable(gl.DEPTH_TEST);
    gl.blendFunc(gl.ONE, gl.ONE_MINUS_SRC_ALPHA);
  }

  program(vertex, fragment) {
    const { gl } = this, program = gl.createProgram();
    for (const [kind, text] of [[gl.VERTEX_SHADER, vertex], [gl.FRAGMENT_SHADER, fragment]]) {
      const shader = gl.createShader(kind);
      gl.shaderSource(shader, text);
      gl.compileShader(shader);
      if (!gl.getShaderParameter(shader, gl.COMPILE_STATUS)) throw new Error(gl.getShaderInfoLog(shader));
      gl.attachShader(program, shader);
    }
    gl.linkProgram(program);
    if (!gl.getProgramParameter(program, gl.LINK_STATUS)) throw new Error(gl.getProgramInfoLog(program));
    const at = {};
    for (let i = 0; i < gl.getProgramParameter(program, gl.ACTIVE_UNIFORMS); i++) {
      const { name } = gl.getActiveUniform(program, i);
      at[name] = gl.getUniformLocation(program, name);
    }
    return { program, at };
  }

  // Corner i of square k is vertex 4 k + i.
  makeArrays() {
    const { gl } = this, corners = new Uint16Array(6 * GROUP);
    for (let k = 0; k < GROUP; k++) corners.set([0, 1, 2, 2, 1, 3].map((i) => 4 * k + i), 6 * k);
    gl.bindVertexArray(gl.createVertexArray());
    gl.bindBuffer(gl.ELEMENT_ARRAY_BUFFER, gl.createBuffer());
    gl.bufferData(gl.ELEMENT_ARRAY_BUFFER, corners, gl.STATIC_DRAW);
  }

  texture(unit, kind) {
    const { gl } = this, texture = gl.createTexture();
    gl.activeTexture(gl.TEXTURE0 + unit);
    gl.bindTexture(kind, texture);
    for (const name of ["MIN", "MAG"]) gl.texParameteri(kind, gl[`TEXTURE_${name}_FILTER`], gl.NEAREST);
    return texture;
  }

  // Room for all splats, so that chunks are rows.
  makeTextures() {
    const { gl, city } = this;
    const rows = Math.min(Math.max(1, Math.ceil(city.splats / TEXTURE_SIDE)), gl.getParameter(gl.MAX_TEXTURE_SIZE));
    this.room = rows * TEXTURE_SIDE;
    this.texture(0, gl.TEXTURE_2D);
    gl.texStorage2D(gl.TEXTURE_2D, 1, gl.RGBA32UI, 2 * TEXTURE_SIDE, rows);
    this.texture(1, gl.TEXTURE_2D);
    gl.texStorage2D(gl.TEXTURE_2D, 1, gl.RGBA32UI, TEXTURE_SIDE, city.degree ? rows : 1);
    this.texture(2, gl.TEXTURE_2D_ARRAY);
    gl.texStorage3D(gl.TEXTURE_2D_ARRAY, 1, gl.RGBA8, TEXTURE_SIDE, rows, city.lights.length);
    this.texture(4, gl.TEXTURE_2D);
    gl.texStorage2D(gl.TEXTURE_2D, 1, gl.R32UI, TEXTURE_SIDE, rows);
  }

  makeSky() {
    const { gl, city } = this, { width, height, pictures } = city.sky;
    this.texture(3, gl.TEXTURE_2D_ARRAY);
    for (const name of ["MIN", "MAG"]) gl.texParameteri(gl.TEXTURE_2D_ARRAY, gl[`TEXTURE_${name}_FILTER`], gl.LINEAR);
    gl.texParameteri(gl.TEXTURE_2D_ARRAY, gl.TEXTURE_WRAP_S, gl.REPEAT);
    gl.texParameteri(gl.TEXTURE_2D_ARRAY, gl.TEXTURE_WRAP_T, gl.CLAMP_TO_EDGE);
    gl.texStorage3D(gl.TEXTURE_2D_ARRAY, 1, gl.RGBA8, width, height, pictures.length);
    pictures.forEach((text, light) => {
      const raw = atob(text), rgba = new Uint8Array(4 * width * height).fill(255);
      for (let i = 0; i < width * height; i++)
        for (let k = 0; k < 3; k++) rgba[4 * i + k] = raw.charCodeAt(3 * i + k);
      gl.texSubImage3D(gl.TEXTURE_2D_ARRAY, 0, 0, 0, light, width, height, 1, gl.RGBA, gl.UNSIGNED_BYTE, rgba);
    });
  }

  // Calls put(row, column, width, height, first) for the rectangles that splats from..from + n fill.
  rectangles(from, n, put) {
    for (let done = 0; done < n;) {
      const row = Math.floor((from + done) / TEXTURE_SIDE), column = (from + done) % TEXTURE_SIDE, left = n - done;
      const width = Math.min(TEXTURE_SIDE - column, left), whole = Math.floor(left / TEXTURE_SIDE);
      const height = column === 0 && whole ? whole : 1;
      put(row, column, width, height, done);
      done += width * height;
    }
  }

  add({ from, n: all, texels, colours, harmonics, strength }) {
    const { gl } = this, n = Math.min(all, this.room - from);
    if (n <= 0) return;
    this.rectangles(from, n, (row, column, width, height, first) => {
      const end = first + width * height;
      gl.activeTexture(gl.TEXTURE0);
      gl.texSubImage2D(gl.TEXTURE_2D, 0, 2 * column, row, 2 * width, height, gl.RGBA_INTEGER, gl.UNSIGNED_INT,
        texels.subarray(8 * first, 8 * end));
      gl.activeTexture(gl.TEXTURE2);
      colours.forEach((rgba, light) => gl.texSubImage3D(gl.TEXTURE_2D_ARRAY, 0, column, row, light, width, height, 1,
        gl.RGBA, gl.UNSIGNED_BYTE, rgba.subarray(4 * first, 4 * end)));
      if (!harmonics) return;
      gl.activeTexture(gl.TEXTURE1);
      gl.texSubImage2D(gl.TEXTURE_2D, 0, column, row, width, height, gl.RGBA_INTEGER, gl.UNSIGNED_INT,
        new Uint32Array(harmonics.buffer, 16 * first, 4 * width * height));
    });
    this.strength = harmonics ? strength : 0;
    this.loaded = from + n;
  }

  setOrder(order) {
    const { gl } = this;
    gl.activeTexture(gl.TEXTURE4);
    this.rectangles(0, order.length, (row, column, width, height, first) => gl.texSubImage2D(gl.TEXTURE_2D, 0, column,
      row, width, height, gl.RED_INTEGER, gl.UNSIGNED_INT, order.subarray(first, first + width * height)));
    this.order = order.length;
  }

  resize(scale) {
    const { canvas } = this, pixels = scale * Math.min(devicePixelRatio || 1, 2);
    const width = Math.max(2, Math.round(canvas.clientWidth * pixels));
    const height = Math.max(2, Math.round(canvas.clientHeight * pixels));
    if (canvas.width !== width || canvas.height !== height) Object.assign(canvas, { width, height });
  }

  // camera: eye, right, up, forward, vfov in degrees. light: 0 to the number of lights - 1. grow: how much larger
  // splats are, because others are missing. limit: splats at most.
  draw(camera, light, grow, limit = Infinity) {
    const { gl, canvas } = this, { width, height } = canvas;
    const focal = 0.5 * height / Math.tan(0.5 * radians(camera.vfov));
    const { right, up, forward } = camera, axes = [];
    for (let k = 0; k < 3; k++) axes.push(right[k], up[k], -forward[k]);
    const first = Math.min(Math.floor(light), this.city.lights.length - 1);
    const lights = [first, Math.min(first + 1, this.city.lights.length - 1), light - first, this.strength > 0 ? 1 : 0];
    gl.viewport(0, 0, width, height);
    gl.disable(gl.BLEND);
    gl.useProgram(this.skyProgram.program);
    gl.uniform1i(this.skyProgram.at.sky, 3);
    gl.uniformMatrix3fv(this.skyProgram.at.axes, false, axes);
    gl.uniform2f(this.skyProgram.at.half_view, 0.5 * width / focal, 0.5 * height / focal);
    gl.uniform4fv(this.skyProgram.at.light, lights);
    gl.drawArrays(gl.TRIANGLE_STRIP, 0, 4);
    const n = Math.min(this.order, limit);
    if (!n) return;
    const { at, program } = this.splatProgram;
    gl.enable(gl.BLEND);
    gl.useProgram(program);
    gl.uniform1i(at.splats, 0);
    gl.uniform1i(at.harmonics, 1);
    gl.uniform1i(at.colours, 2);
    gl.uniform1i(at.order, 4);
    gl.uniform1i(at.count, n);
    gl.uniformMatrix3fv(at.axes, false, axes);
    gl.uniform3fv(at.eye, camera.eye);
    gl.uniform2f(at.focal, focal, focal);
    gl.uniform2f(at.size, width, height);
    gl.uniform4fv(at.light, lights);
    gl.uniform1f(at.unit, this.city.unit);
    gl.uniform1f(at.grow, grow);
    gl.uniform1f(at.near, this.city.size / 1000);
    gl.uniform1f(at.strength, this.strength);
    gl.drawElementsInstanced(gl.TRIANGLES, 6 * GROUP, gl.UNSIGNED_SHORT, 0, Math.ceil(n / GROUP));
  }
}
