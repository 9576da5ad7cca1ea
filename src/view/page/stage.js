// Draws the pictures from the server. When the camera has moved since, the last picture is warped to the present view
// by its depths: a grid of triangles, each corner at its depth. Plain WebGL.
import { RAD, add, clamp, norm, placeIn, rayOf, rotationOf, scale, sub } from "./geometry.js";

const FAR = 1e4; // times the reach: where what has no depth is drawn
const BEYOND = 0.4; // of the picture, on each side
const NEAREST = 1e-3; // times the reach: a depth, at least
const DEPTH_STEPS = 4; // to a place whose depth is looked for
const EDGE = 1.35; // a ratio of depths between neighbours that is an edge

const WARP_VERTEX = `
attribute vec2 place; attribute float depth;
uniform mat3 from_rotation, to_rotation; uniform vec3 offset; uniform vec2 from_tan, to_tan; uniform float far, near;
varying vec2 at;
void main() {
  at = place;
  vec3 ray = normalize(vec3((2.0 * place.x - 1.0) * from_tan.x, (2.0 * place.y - 1.0) * from_tan.y, 1.0));
  vec3 world = ray * (near > 0.5 && depth > 0.0 ? depth : far) * from_rotation + offset;
  vec3 seen = to_rotation * world;
  gl_Position = vec4(seen.x / to_tan.x, -seen.y / to_tan.y, seen.z * 0.999 - 0.001, seen.z);
}`;
const WARP_FRAGMENT = `
precision mediump float;
uniform sampler2D picture; varying vec2 at;
void main() { gl_FragColor = vec4(texture2D(picture, at).rgb, 1.0); }`;
const MARK_VERTEX = `
attribute vec3 place; attribute vec3 colour;
uniform mat3 to_rotation; uniform vec3 offset; uniform vec2 to_tan; uniform float size;
varying vec3 tint;
void main() {
  tint = colour;
  vec3 seen = to_rotation * (place + offset);
  gl_Position = vec4(seen.x / to_tan.x, -seen.y / to_tan.y, 0.0, seen.z);
  gl_PointSize = size;
}`;
const MARK_FRAGMENT = `
precision mediump float;
varying vec3 tint; uniform float alpha;
void main() { gl_FragColor = vec4(tint * alpha, alpha); }`;

// Rows of a rotation as WebGL's columns, so that in shaders "m * v" turns the world to the camera.
const columns = (r) => [r[0], r[3], r[6], r[1], r[4], r[7], r[2], r[5], r[8]];
const tans = (camera, aspect) => {
  const t = Math.tan(camera.vfov * RAD / 2);
  return [t * aspect, t];
};
const same = (a, b) => a.heading === b.heading && a.pitch === b.pitch && a.roll === b.roll && a.vfov === b.vfov &&
  a.centre.every((x, i) => x === b.centre[i]);

// Whether a triangle lies on one surface. One across a depth edge must not be drawn.
function whole(depth, three) {
  if (!depth) return true;
  const d = three.map((i) => depth[i]), low = Math.min(...d);
  return low > 0 && Math.max(...d) < EDGE * low;
}

export class Stage {
  constructor(canvas) {
    this.canvas = canvas;
    this.frames = [null, null]; // the view, and the one beside it
    this.marks = new Map(); // by name: {kind, data, alpha, size, buffer}
    this.split = null; // of the width, where the second picture begins
    this.warp = true;
    canvas.addEventListener("webglcontextlost", (e) => e.preventDefault());
    this.gl = null; // until setUp(), which takes a while: the first picture is asked for before
    this.dirty = true;
  }

  // Once more after the browser has lost what was in the graphics processor: the marks are there again, pictures are not.
  setUp() {
    const gl = this.gl = this.canvas.getContext("webgl", { antialias: true, alpha: false, preserveDrawingBuffer: true });
    if (!gl) throw new Error("this browser has no WebGL; turn it on to see the city");
    this.warpProgram = this.program(WARP_VERTEX, WARP_FRAGMENT);
    this.markProgram = this.program(MARK_VERTEX, MARK_FRAGMENT);
    this.frames = [null, null];
    this.quad = null;
    for (const mark of this.marks.values()) mark.buffer = this.fill(gl.createBuffer(), mark.data);
    this.dirty = true;
  }

  program(vertex, fragment) {
    const gl = this.gl, program = gl.createProgram();
    for (const [kind, text] of [[gl.VERTEX_SHADER, vertex], [gl.FRAGMENT_SHADER, fragment]]) {
      const shader = gl.createShader(kind);
      gl.shaderSource(shader, text);
      gl.compileShader(shader);
      gl.attachShader(program, shader);
    }
    gl.linkProgram(program);
    if (!gl.getProgramParameter(program, gl.LINK_STATUS)) throw new Error(gl.getProgramInfoLog(program) || "WebGL");
    const at = (name) => gl.getUniformLocation(program, name);
    return { program, at, attribute: (name) => gl.getAttribLocation(program, name) };
  }

  // A picture (ImageBitmap) as seen by a camera, with its coarse depths: {camera, aspect, grid, depth}.
  show(slot, bitmap, view) {
    const gl = this.gl, old = this.frames[slot];
    const texture = old ? old.texture : gl.createTexture();
    gl.bindTexture(gl.TEXTURE_2D, texture);
    gl.pixelStorei(gl.UNPACK_FLIP_Y_WEBGL, false);
    gl.texImage2D(gl.TEXTURE_2D, 0, gl.RGB, gl.RGB, gl.UNSIGNED_BYTE, bitmap);
    for (const [key, value] of [[gl.TEXTURE_WRAP_S, gl.CLAMP_TO_EDGE], [gl.TEXTURE_WRAP_T, gl.CLAMP_TO_EDGE],
      [gl.TEXTURE_MIN_FILTER, gl.LINEAR], [gl.TEXTURE_MAG_FILTER, gl.LINEAR]]) gl.texParameteri(gl.TEXTURE_2D, key, value);
    this.frames[slot] = { ...view, texture, ...this.mesh(view, old), width: bitmap.width, height: bitmap.height };
    this.dirty = true;
  }
  hide(slot) {
    if (this.frames[slot]) this.gl.deleteTexture(this.frames[slot].texture);
    this.frames[slot] = null;
    this.dirty = true;
  }

  // Corners are at the centres of the grid's cells; those at the border reach to the border.
  mesh({ grid, depth, beyond = 0 }, old) {
    const gl = this.gl, [w, h] = grid || [2, 2], vertices = new Float32Array(3 * w * h), order = [];
    for (let y = 0; y < h; y++)
      for (let x = 0; x < w; x++) {
        const u = x === 0 ? 0 : x === w - 1 ? 1 : (x + 0.5) / w, v = y === 0 ? 0 : y === h - 1 ? 1 : (y + 0.5) / h;
        const out = (t) => t + beyond * (2 * t - 1);
        vertices.set([out(u), out(v), depth ? depth[y * w + x] : 0], 3 * (y * w + x));
        const i = y * w + x;
        if (x + 1 < w && y + 1 < h)
          for (const three of [[i, i + 1, i + w], [i + 1, i + w + 1, i + w]]) if (whole(depth, three)) order.push(...three);
      }
    const buffer = old ? old.buffer : gl.createBuffer(), indices = old ? old.indices : gl.createBuffer();
    gl.bindBuffer(gl.ARRAY_BUFFER, buffer);
    gl.bufferData(gl.ARRAY_BUFFER, vertices, gl.DYNAMIC_DRAW);
    gl.bindBuffer(gl.ELEMENT_ARRAY_BUFFER, indices);
    gl.bufferData(gl.ELEMENT_ARRAY_BUFFER, new Uint16Array(order), gl.DYNAMIC_DRAW);
    return { buffer, indices, n: order.length };
  }

  // Lines ("LINES") or points ("POINTS") in the world: 3 floats per vertex, and 3 for its colour.
  mark(name, kind, data, alpha = 1, size = 2) {
    const gl = this.gl, old = this.marks.get(name), buffer = this.fill(old ? old.buffer : gl.createBuffer(), data);
    this.marks.set(name, { kind: gl[kind], data, buffer, alpha, size });
    this.dirty = true;
  }
  fill(buffer, data) {
    this.gl.bindBuffer(this.gl.ARRAY_BUFFER, buffer);
    this.gl.bufferData(this.gl.ARRAY_BUFFER, data, this.gl.STATIC_DRAW);
    return buffer;
  }
  unmark(name) {
    const mark = this.marks.get(name);
    if (mark) this.gl.deleteBuffer(mark.buffer);
    this.marks.delete(name);
    this.dirty = true;
  }

  // How far away is what lies at a place in the picture, from where the camera is now; 0: nothing is there. The depths are
  // those of the last picture, whose camera may have been elsewhere: the place that they mean is looked for along the ray.
  depthAt(camera, aspect, x, y) {
    const frame = this.frames[0];
    if (!frame || !frame.depth) return 0;
    const [w, h] = frame.grid, ray = rayOf(camera, aspect, x, y), least = NEAREST * camera.reach;
    const cell = (t, n) => clamp(Math.floor((t + 1) / 2 * n), 0, n - 1);
    const seen = (at) => frame.depth[cell(at[1], h) * w + cell(at[0], w)];
    let depth = seen([x, y]) || camera.reach;
    for (let i = 0; i < DEPTH_STEPS; i++) {
      const place = add(camera.centre, scale(ray, depth)), at = placeIn(frame.camera, frame.aspect, place);
      if (!at) return depth; // the last picture looked away from there
      if (!seen(at)) return 0;
      depth = Math.max(depth + seen(at) - norm(sub(place, frame.camera.centre)), least);
    }
    return depth;
  }

  resize() {
    const c = this.canvas, ratio = Math.min(devicePixelRatio || 1, 2);
    const w = Math.max(Math.round(c.clientWidth * ratio), 1), h = Math.max(Math.round(c.clientHeight * ratio), 1);
    if (c.width === w && c.height === h) return false;
    Object.assign(c, { width: w, height: h });
    return this.dirty = true;
  }

  draw(camera, aspect, reach) {
    const gl = this.gl, c = this.canvas;
    gl.viewport(0, 0, c.width, c.height);
    gl.disable(gl.SCISSOR_TEST);
    gl.clearColor(0, 0, 0, 1);
    gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
    if (this.frames[0]) this.drawFrame(this.frames[0], camera, aspect, reach);
    if (this.frames[1] && this.split !== null) {
      const from = Math.round(this.split * c.width);
      gl.enable(gl.SCISSOR_TEST);
      gl.scissor(from, 0, c.width - from, c.height);
      gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
      this.drawFrame(this.frames[1], camera, aspect, reach);
      gl.disable(gl.SCISSOR_TEST);
    }
    this.drawMarks(camera, aspect);
    this.dirty = false;
  }

  drawFrame(frame, camera, aspect, reach) {
    const gl = this.gl, p = this.warpProgram, now = this.warp ? camera : frame.camera;
    const still = same(now, frame.camera);
    gl.useProgram(p.program);
    gl.enable(gl.DEPTH_TEST);
    gl.disable(gl.BLEND);
    gl.bindTexture(gl.TEXTURE_2D, frame.texture);
    gl.uniformMatrix3fv(p.at("from_rotation"), false, columns(rotationOf(frame.camera)));
    gl.uniformMatrix3fv(p.at("to_rotation"), false, columns(rotationOf(now)));
    gl.uniform3fv(p.at("offset"), sub(frame.camera.centre, now.centre));
    gl.uniform2fv(p.at("from_tan"), tans(frame.camera, frame.aspect));
    gl.uniform2fv(p.at("to_tan"), tans(now, aspect));
    gl.uniform1f(p.at("far"), FAR * reach);
    // First draw everything as if far away, for the sky and for gaps at edges; then the surfaces in front.
    gl.uniform1f(p.at("near"), 0);
    gl.depthMask(false);
    this.drawQuad(frame, p);
    gl.depthMask(true);
    if (still) return;
    gl.uniform1f(p.at("near"), 1);
    this.bindMesh(frame, p);
    gl.drawElements(gl.TRIANGLES, frame.n, gl.UNSIGNED_SHORT, 0);
  }

  // Fine enough to bend well. It reaches beyond the picture, where the colours of the edge go on: better than black while
  // the camera turns.
  drawQuad(frame, p) {
    const gl = this.gl;
    this.quad ||= this.mesh({ grid: [29, 29], depth: null, beyond: BEYOND }, null);
    this.bindMesh(this.quad, p);
    gl.drawElements(gl.TRIANGLES, this.quad.n, gl.UNSIGNED_SHORT, 0);
  }

  bindMesh(mesh, p) {
    const gl = this.gl, place = p.attribute("place"), depth = p.attribute("depth");
    gl.bindBuffer(gl.ARRAY_BUFFER, mesh.buffer);
    gl.bindBuffer(gl.ELEMENT_ARRAY_BUFFER, mesh.indices);
    gl.enableVertexAttribArray(place);
    gl.enableVertexAttribArray(depth);
    gl.vertexAttribPointer(place, 2, gl.FLOAT, false, 12, 0);
    gl.vertexAttribPointer(depth, 1, gl.FLOAT, false, 12, 8);
  }

  drawMarks(camera, aspect) {
    const gl = this.gl, p = this.markProgram;
    if (!this.marks.size) return;
    gl.useProgram(p.program);
    gl.disable(gl.DEPTH_TEST);
    gl.enable(gl.BLEND);
    gl.blendFunc(gl.ONE, gl.ONE_MINUS_SRC_ALPHA);
    gl.uniformMatrix3fv(p.at("to_rotation"), false, columns(rotationOf(camera)));
    gl.uniform3fv(p.at("offset"), camera.centre.map((x) => -x));
    gl.uniform2fv(p.at("to_tan"), tans(camera, aspect));
    const place = p.attribute("place"), colour = p.attribute("colour");
    for (const mark of this.marks.values()) {
      gl.bindBuffer(gl.ARRAY_BUFFER, mark.buffer);
      gl.enableVertexAttribArray(place);
      gl.enableVertexAttribArray(colour);
      gl.vertexAttribPointer(place, 3, gl.FLOAT, false, 24, 0);
      gl.vertexAttribPointer(colour, 3, gl.FLOAT, false, 24, 12);
      gl.uniform1f(p.at("alpha"), mark.alpha);
      gl.uniform1f(p.at("size"), mark.size * Math.min(devicePixelRatio || 1, 2));
      gl.drawArrays(mark.kind, 0, mark.data.length / 6);
    }
  }
}
