// Decodes chunks and sorts splats, away from the page's own thread. The function below is the worker's whole program:
// the page starts it from its text, because a page that is opened from disk may not load a worker's file.
"use strict";

function splatWorker() {
  const DEPTHS = 65536;
  const state = { places: new Float32Array(0), sizes: new Float32Array(0), opacity: new Uint8Array(0), loaded: 0 };
  const float = new Float32Array(1), bits = new Uint32Array(float.buffer);

  // To a half float, rounded; too large becomes the largest.
  function half(value) {
    float[0] = value;
    const x = bits[0], sign = (x >>> 16) & 0x8000;
    const e = ((x >>> 23) & 255) - 112, m = x & 0x7fffff;
    if (e >= 31) return sign | 0x7bff;
    if (e <= 0) return e < -10 ? sign : sign | (((m | 0x800000) >> (1 - e)) + 0x1000) >> 13;
    return sign | (((e << 10) | (m >> 13)) + ((m >> 12) & 1));
  }

  function bytesOf(text) {
    const raw = atob(text), bytes = new Uint8Array(raw.length);
    for (let i = 0; i < raw.length; i++) bytes[i] = raw.charCodeAt(i);
    return bytes;
  }

  // A chunk as src/splat/packed.h describes it: places in metres, standard deviations, rotations w x y z, and bytes.
  function unpack(bytes) {
    const view = new DataView(bytes.buffer);
    if (view.getUint32(0) !== 0x434e5350 || view.getUint16(4, true) !== 1) throw new Error("not a chunk of splats");
    const degree = bytes[6], lights = bytes[7], n = view.getUint32(8, true), block = view.getUint32(24, true);
    const low = view.getFloat32(12, true), step = view.getFloat32(16, true), harmonics = view.getFloat32(20, true);
    const nBlocks = Math.ceil(n / block);
    let at = 32;
    const boxes = new Float32Array(bytes.buffer, at, 6 * nBlocks);
    const turns = new Uint32Array(bytes.buffer, at += 24 * nBlocks, n);
    const steps = new Uint16Array(bytes.buffer, at += 4 * n, 3 * n);
    const sizes = bytes.subarray(at += 6 * n, at += 3 * n), opacity = bytes.subarray(at, at += n);
    const colours = Array.from({ length: lights }, () => bytes.subarray(at, at += 3 * n));
    const sh = degree ? new Int8Array(bytes.buffer, at, 9 * n) : null;
    const places = new Float32Array(3 * n), scales = new Float32Array(3 * n), rotations = new Float32Array(4 * n);
    for (let i = 0; i < n; i++) {
      const box = 6 * Math.floor(i / block), largest = turns[i] >>> 30;
      for (let k = 0; k < 3; k++) {
        places[3 * i + k] = boxes[box + k] + boxes[box + 3 + k] * steps[3 * i + k];
        scales[3 * i + k] = Math.exp(low + step * sizes[3 * i + k]);
      }
      let rest = 1;
      for (let k = 0, shift = 0; k < 4; k++) {
        if (k === largest) continue;
        const q = (((turns[i] >>> shift) & 1023) / 1023 - 0.5) * Math.SQRT2;
        rotations[4 * i + k] = q;
        rest -= q * q;
        shift += 10;
      }
      rotations[4 * i + largest] = Math.sqrt(Math.max(rest, 0));
    }
    return { n, degree, lights, harmonics, places, scales, rotations, opacity, colours, sh };
  }

  // Two texels of four numbers for each splat: place, opacity; covariance as half floats in units of unit squared.
  function texelsOf(chunk, unit) {
    const out = new Uint32Array(8 * chunk.n), floats = new Float32Array(out.buffer);
    const { scales, rotations } = chunk;
    for (let i = 0; i < chunk.n; i++) {
      const w = rotations[4 * i], x = rotations[4 * i + 1], y = rotations[4 * i + 2], z = rotations[4 * i + 3];
      const a = scales[3 * i] / unit, b = scales[3 * i + 1] / unit, c = scales[3 * i + 2] / unit;
      const m = [(1 - 2 * (y * y + z * z)) * a, 2 * (x * y - w * z) * b, 2 * (x * z + w * y) * c,
        2 * (x * y + w * z) * a, (1 - 2 * (x * x + z * z)) * b, 2 * (y * z - w * x) * c,
        2 * (x * z - w * y) * a, 2 * (y * z + w * x) * b, (1 - 2 * (x * x + y * y)) * c];
      const dot = (p, q) => m[3 * p] * m[3 * q] + m[3 * p + 1] * m[3 * q + 1] + m[3 * p + 2] * m[3 * q + 2];
      floats.set(chunk.places.subarray(3 * i, 3 * i + 3), 8 * i);
      out[8 * i + 3] = chunk.opacity[i];
      out[8 * i + 4] = half(dot(0, 0)) | (half(dot(0, 1)) << 16);
      out[8 * i + 5] = half(dot(0, 2)) | (half(dot(1, 1)) << 16);
      out[8 * i + 6] = half(dot(1, 2)) | (half(dot(2, 2)) << 16);
    }
    return out;
  }

  function grown(old, kind, length) {
    if (old.length >= length) return old;
    const more = new kind(Math.max(length, 2 * old.length));
    more.set(old);
    return more;
  }

  function add(message) {
    const chunk = unpack(bytesOf(message.text)), n = chunk.n, from = state.loaded;
    state.places = grown(state.places, Float32Array, 3 * (from + n));
    state.sizes = grown(state.sizes, Float32Array, from + n);
    state.opacity = grown(state.opacity, Uint8Array, from + n);
    state.places.set(chunk.places, 3 * from);
    state.opacity.set(chunk.opacity, from);
    for (let i = 0; i < n; i++) {
      const [a, b, c] = chunk.scales.subarray(3 * i, 3 * i + 3);
      state.sizes[from + i] = Math.max(a, b, c);
    }
    state.loaded += n;
    const texels = texelsOf(chunk, message.unit);
    const colours = chunk.colours.map((rgb) => {
      const rgba = new Uint8Array(4 * n).fill(255);
      for (let i = 0; i < n; i++) rgba.set(rgb.subarray(3 * i, 3 * i + 3), 4 * i);
      return rgba;
    });
    let harmonics = null;
    if (chunk.sh) {
      harmonics = new Uint8Array(16 * n);
      for (let i = 0; i < n; i++)
        for (let k = 0; k < 9; k++) harmonics[16 * i + k] = chunk.sh[9 * i + k] + 128;
    }
    postMessage({ kind: "chunk", from, n, texels, colours, harmonics, strength: chunk.harmonics });
  }

  // The first `count` splats in the picture, from the farthest to the nearest: a counting sort of 16-bit depths.
  // view: the rows of a matrix from places to clip space, x y w.
  function sort({ view, count, number }) {
    const begin = performance.now(), n = Math.min(count, state.loaded), { places, sizes } = state;
    const depths = new Float32Array(n), seen = new Uint32Array(n);
    let near = Infinity, far = 0, kept = 0;
    for (let i = 0; i < n; i++) {
      const x = places[3 * i], y = places[3 * i + 1], z = places[3 * i + 2];
      const w = view[8] * x + view[9] * y + view[10] * z + view[11], margin = 1.35 * w + 8 * sizes[i];
      if (w <= 0 || Math.abs(view[0] * x + view[1] * y + view[2] * z + view[3]) > margin ||
        Math.abs(view[4] * x + view[5] * y + view[6] * z + view[7]) > margin) continue;
      depths[kept] = w;
      seen[kept++] = i;
      near = Math.min(near, w);
      far = Math.max(far, w);
    }
    // By the logarithm, so that what is near has the finer steps.
    const base = Math.log2(Math.max(near, 1e-6)), step = (DEPTHS - 1) / Math.max(Math.log2(far) - base, 1e-6);
    const starts = new Uint32Array(DEPTHS + 1), keys = new Uint16Array(kept), order = new Uint32Array(kept);
    for (let i = 0; i < kept; i++) {
      keys[i] = DEPTHS - 1 - Math.max(0, Math.floor((Math.log2(depths[i]) - base) * step));
      starts[keys[i] + 1]++;
    }
    for (let i = 0; i < DEPTHS; i++) starts[i + 1] += starts[i];
    for (let i = 0; i < kept; i++) order[starts[keys[i]]++] = seen[i];
    postMessage({ kind: "order", order, number, count: n, ms: performance.now() - begin }, [order.buffer]);
  }

  // The first splat that a ray meets: within one and a half standard deviations of its largest axis.
  function pick({ origin, ray, number }) {
    let best = Infinity, place = null;
    for (let i = 0; i < state.loaded; i++) {
      if (state.opacity[i] < 90) continue;
      const x = state.places[3 * i] - origin[0], y = state.places[3 * i + 1] - origin[1];
      const z = state.places[3 * i + 2] - origin[2], t = x * ray[0] + y * ray[1] + z * ray[2];
      const reach = 1.5 * state.sizes[i];
      if (t <= 0 || t >= best || x * x + y * y + z * z - t * t > reach * reach) continue;
      best = t;
      place = [...state.places.subarray(3 * i, 3 * i + 3)];
    }
    postMessage({ kind: "picked", place, distance: best, number });
  }

  // Heights of the ground on a grid of 2 * reach a side: in each cell the height that a tenth of its splats lie below.
  function ground({ cells, middle, reach }) {
    const n = state.loaded, { places } = state, low = [middle[0] - reach, middle[1] - reach], side = 2 * reach / cells;
    const cell = new Int32Array(n).fill(-1), all = new Uint32Array(cells * cells), seen = new Uint32Array(cells * cells);
    const heights = new Float32Array(cells * cells).fill(NaN);
    for (let i = 0; i < n; i++) {
      const x = Math.floor((places[3 * i] - low[0]) / side), y = Math.floor((places[3 * i + 1] - low[1]) / side);
      if (x < 0 || y < 0 || x >= cells || y >= cells || Math.abs(places[3 * i + 2] - middle[2]) > 2 * reach) continue;
      cell[i] = y * cells + x;
      all[cell[i]]++;
    }
    const order = Uint32Array.from({ length: n }, (_, i) => i).sort((a, b) => places[3 * a + 2] - places[3 * b + 2]);
    for (const i of order) {
      const at = cell[i];
      if (at >= 0 && all[at] >= 4 && seen[at]++ === Math.floor(all[at] / 10)) heights[at] = places[3 * i + 2];
    }
    postMessage({ kind: "ground", low, side, cells, heights });
  }

  const actions = { add, sort, pick, ground };
  onmessage = ({ data }) => {
    try {
      actions[data.kind](data);
    } catch (error) {
      postMessage({ kind: "error", text: String(error) });
    }
  };
}
