// The page: loads the chunks one after another, sorts, draws, and keeps the pace.
"use strict";

const WANTED_MS = 1000 / 30, REST_MS = 250, MOST_REST_MS = 500, MOST_GROWTH = 2.2;

class Live {
  constructor(city) {
    this.city = city;
    this.canvas = document.getElementById("view");
    this.picture = new Picture(this.canvas, city);
    this.camera = new Camera(this.canvas, city.size, city.eye_height);
    this.light = 0;
    this.chunks = 0; // that have come
    this.quality = { scale: 1, share: 1 }; // of the pixels along a side, and of the splats
    this.pace = WANTED_MS / 2; // mean time of a frame that moves, ms
    this.sorting = this.stale = this.resting = false;
    this.number = 0;
    this.waiting = new Map();
    this.worker = new Worker(URL.createObjectURL(new Blob([`"use strict";(${splatWorker})()`],
      { type: "text/javascript" })));
    this.worker.onmessage = ({ data }) => this[`on_${data.kind}`](data);
    this.worker.onerror = (e) => this.say(`The page cannot sort splats: ${e.message}`);
    this.camera.addEventListener("change", () => this.move());
    this.camera.addEventListener("keys", () => this.ask());
    this.camera.addEventListener("point", (e) => this.point(e.detail));
    new ResizeObserver(() => this.move()).observe(this.canvas);
    this.canvas.addEventListener("webglcontextlost", () => this.say("The graphics card gave up. Load the page again."));
    this.build();
    this.camera.show(city.views[0]);
    this.load(0);
  }

  say(text) {
    const box = document.getElementById("message");
    box.textContent = text;
    box.hidden = !text;
  }

  // ---- controls ----

  build() {
    const { city } = this, views = document.getElementById("views"), get = (id) => document.getElementById(id);
    document.title = get("name").textContent = city.name;
    city.views.forEach((view, i) => views.add(new Option(view.name, i)));
    views.onchange = () => this.camera.show(city.views[views.value]);
    const modes = [...get("modes").children];
    modes.forEach((button, i) => {
      button.onclick = () => {
        modes.forEach((b) => b.setAttribute("aria-checked", b === button));
        this.camera.setMode(button.dataset.mode);
      };
      button.onkeydown = (e) => {
        const by = { ArrowRight: 1, ArrowLeft: modes.length - 1 }[e.key];
        if (by) modes[(i + by) % modes.length].focus(), modes[(i + by) % modes.length].click();
      };
    });
    get("lighting").hidden = city.lights.length < 2;
    Object.assign(get("light"), { max: city.lights.length - 1, oninput: (e) => this.setLight(Number(e.target.value)) });
    city.lights.forEach((name, i) => {
      const button = document.createElement("button");
      Object.assign(button, { type: "button", textContent: name, title: name, onclick: () => this.setLight(i) });
      get("lights").append(button);
    });
    this.setLight(0);
  }

  // 0 to the number of lights - 1; between two, a mix of both.
  setLight(light) {
    const { lights } = this.city, first = Math.min(Math.floor(light), lights.length - 1), part = light - first;
    const range = document.getElementById("light");
    this.light = light;
    range.value = light;
    range.setAttribute("aria-valuetext", part ? `${Math.round(100 - 100 * part)} % ${lights[first]}, ` +
      `${Math.round(100 * part)} % ${lights[first + 1]}` : lights[first]);
    [...document.getElementById("lights").children].forEach((b, i) => b.setAttribute("aria-pressed", i === light));
    this.ask();
  }

  // ---- loading ----

  load(i) {
    const script = document.createElement("script");
    script.src = `chunk-${i}.js`;
    script.onerror = () => this.say(`chunk-${i}.js is missing or damaged: copy the whole folder again.`);
    script.onload = () => script.remove();
    document.head.append(script);
  }

  // Called by chunk-I.js.
  take(i, text) {
    this.worker.postMessage({ kind: "add", text, unit: this.city.unit });
    this.chunks = i + 1;
    if (this.chunks < this.city.chunks) this.load(this.chunks);
  }

  on_chunk(chunk) {
    this.picture.add(chunk);
    const { loaded } = this.picture, done = loaded >= Math.min(this.city.splats, this.picture.room);
    document.getElementById("loading").value = loaded / this.city.splats;
    document.getElementById("loading").hidden = done;
    this.done = done;
    if (!done) return this.move(false);
    const cells = clamp(Math.floor(Math.sqrt(loaded) / 3), 8, 192);
    this.worker.postMessage({ kind: "ground", cells, middle: this.city.middle, reach: this.city.size });
    this.move(false);
  }

  on_error({ text }) { this.say(`A chunk cannot be read: ${text}`); }

  // ---- drawing ----

  get count() { return Math.ceil(this.picture.loaded * (this.resting ? 1 : this.quality.share)); }

  move(moved = true) {
    this.stale = true;
    if (moved) {
      this.resting = false;
      clearTimeout(this.rest);
      this.rest = setTimeout(() => this.settle(), REST_MS);
    }
    this.ask();
  }

  // One more picture; one at a time is with the graphics card, so that none wait in a queue.
  ask() {
    this.wanted = true;
    if (this.frame === undefined && !this.fence) this.frame = requestAnimationFrame((now) => this.paint(now));
  }

  // The view from the camera for the worker: clip x, y and w of a place.
  get rows() {
    const { eye, right, up, forward, vfov } = this.camera.state, { canvas } = this;
    const high = 1 / Math.tan(0.5 * radians(vfov)), wide = high * canvas.clientHeight / Math.max(canvas.clientWidth, 1);
    const row = (axis, by) => [...axis.map((v) => v * by), -by * dot3(axis, eye)];
    return [...row(right, wide), ...row(up, high), ...row(forward, 1)];
  }

  sort() {
    if (this.sorting || !this.stale || !this.picture.loaded) return;
    this.sorting = true;
    this.stale = false;
    this.worker.postMessage({ kind: "sort", view: this.rows, count: this.count, number: ++this.number });
  }

  on_order({ order, count, number, ms }) {
    this.picture.setOrder(order);
    this.drawn = { count, ms };
    this.sorting = false;
    this.waiting.get(number)?.();
    this.waiting.delete(number);
    this.ask();
  }

  // Splats grow when there are fewer of them, so that they still cover the surfaces.
  get growth() {
    const share = (this.drawn?.count ?? 1) / this.city.splats;
    return clamp(1 / Math.sqrt(Math.max(share, 1e-3)), 1, MOST_GROWTH);
  }

  paint(now) {
    const { gl } = this.picture, ms = now - (this.last ?? 0), full = this.resting;
    this.wanted = false;
    this.last = now;
    const held = this.camera.step(ms < 500 ? ms / 1000 : 0.03);
    this.sort();
    this.picture.resize(full ? this.restScale : this.quality.scale);
    this.picture.draw(this.camera.state, this.light, this.growth);
    this.fence = gl.fenceSync(gl.SYNC_GPU_COMMANDS_COMPLETE, 0);
    gl.flush();
    this.frame = undefined;
    const n = this.picture.order;
    document.getElementById("figures").textContent =
      `${n.toLocaleString("en")} of ${this.city.splats.toLocaleString("en")} splats`;
    this.await(performance.now(), full);
    if (held) this.ask();
  }

  // Until the graphics card has drawn.
  await(begin, full) {
    const { gl } = this.picture;
    if (gl.clientWaitSync(this.fence, 0, 0) === gl.TIMEOUT_EXPIRED) {
      setTimeout(() => this.await(begin, full), 2);
      return;
    }
    gl.deleteSync(this.fence);
    this.fence = undefined;
    if (!full) this.keepPace(performance.now() - begin);
    if (this.wanted) this.ask();
  }

  // Fewer pixels, then fewer splats, until a frame takes what it may; back when there is time again.
  keepPace(ms) {
    const q = this.quality, now = performance.now();
    this.pace += 0.25 * (ms - this.pace);
    if (ms > 4 * WANTED_MS) {
      q.scale = Math.max(0.5, 0.7 * q.scale);
      q.share = Math.max(0.1, 0.6 * q.share);
    } else if (now - (this.changed ?? 0) < 300) return;
    else if (this.pace > WANTED_MS) {
      if (q.scale > 0.6) q.scale = Math.max(0.6, 0.8 * q.scale);
      else if (q.share > 0.15) q.share = Math.max(0.15, 0.75 * q.share);
      else q.scale = Math.max(0.35, 0.85 * q.scale);
    } else if (this.pace < 0.6 * WANTED_MS && (q.share < 1 || q.scale < 1)) {
      if (q.share < 1) q.share = Math.min(1, 1.15 * q.share);
      else q.scale = Math.min(1, 1.1 * q.scale);
    } else return;
    this.changed = now;
    this.stale = true;
  }

  // When nothing moves, one picture with all splats; its pixels so that it takes about half a second at most.
  settle() {
    const { scale, share } = this.quality, full = this.pace / (scale * scale * share);
    this.restScale = full <= MOST_REST_MS ? 1 : Math.max(Math.min(scale, 0.5), Math.sqrt(MOST_REST_MS / full));
    this.resting = true;
    this.stale = true;
    this.ask();
  }

  // Nothing moves, and the picture is done.
  get settled() {
    return this.resting && !this.stale && !this.sorting && !this.fence && this.frame === undefined;
  }

  // ---- places ----

  // Where a pixel's ray meets the city; null: nowhere.
  pick(x, y) {
    const { eye, right, up, forward, vfov } = this.camera.state, box = this.canvas.getBoundingClientRect();
    const half = Math.tan(0.5 * radians(vfov)), side = half * box.width / box.height;
    const u = 2 * (x - box.left) / box.width - 1, v = 1 - 2 * (y - box.top) / box.height;
    const ray = unit3(add3(add3(forward, right, u * side), up, v * half)), number = `pick${++this.number}`;
    this.worker.postMessage({ kind: "pick", origin: eye, ray, number });
    return new Promise((answer) => this.waiting.set(number, answer));
  }

  on_picked({ place, number }) {
    this.waiting.get(number)?.(place);
    this.waiting.delete(number);
  }

  async point({ x, y }) {
    const place = await this.pick(x, y), { frame } = this.city;
    if (!place || Math.hypot(...add3(place, this.city.middle, -1)) > 4 * this.city.size) return; // nothing, or the sky
    this.camera.distance = Math.max(dot3(add3(place, this.camera.eye, -1), this.camera.axes.forward), 1e-3);
    const local = place.map((v) => v.toFixed(2)).join(", ");
    let text = `x, y, z: ${local}${frame ? " m" : ""}`;
    if (frame) {
      const [latitude, longitude, height] = geodeticOf(frame, place);
      text = `${latitude.toFixed(7)}°, ${longitude.toFixed(7)}°, ${height.toFixed(1)} m. ${text}`;
    }
    document.getElementById("place").textContent = text;
  }

  on_ground({ low, side, cells, heights }) {
    this.camera.ground = (x, y) => {
      const i = Math.floor((x - low[0]) / side), k = Math.floor((y - low[1]) / side);
      let sum = 0, weight = 0;
      for (let reach = 1; reach < 12 && !weight; reach++)
        for (let b = k - reach; b <= k + reach; b++)
          for (let a = i - reach; a <= i + reach; a++) {
            const z = a >= 0 && b >= 0 && a < cells && b < cells ? heights[b * cells + a] : NaN;
            if (!Number.isFinite(z)) continue;
            const far = Math.hypot((a + 0.5) * side + low[0] - x, (b + 0.5) * side + low[1] - y) / side + 0.2;
            sum += z / far;
            weight += 1 / far;
          }
      return weight ? sum / weight : NaN;
    };
    if (this.camera.mode === "walk") this.camera.changed();
  }

  // Seconds for each of `frames` frames of a full turn, with `count` splats at most, all work done.
  async measure(frames, count) {
    const { gl } = this.picture, pixel = new Uint8Array(4), begin = performance.now(), { heading } = this.camera;
    for (let i = 0; i < frames; i++) {
      const state = { ...this.camera.state, ...axesOf(heading + 360 * i / frames, this.camera.pitch) };
      this.picture.draw(state, this.light, 1, count);
      gl.readPixels(0, 0, 1, 1, gl.RGBA, gl.UNSIGNED_BYTE, pixel);
    }
    this.ask();
    return (performance.now() - begin) / 1000 / frames;
  }
}

// Latitude, longitude and height of a place of the local frame, on the WGS84 ellipsoid: by way of Earth-centred
// coordinates (Bowring 1976, one step, which is exact to a micrometre near the ground).
function geodeticOf(frame, place) {
  const m = frame.ecef_from_local, at = (k) => m[k] * place[0] + m[4 + k] * place[1] + m[8 + k] * place[2] + m[12 + k];
  const x = at(0), y = at(1), z = at(2), a = 6378137, f = 1 / 298.257223563, e2 = f * (2 - f), b = a * (1 - f);
  const p = Math.hypot(x, y), t = Math.atan2(z * a, p * b);
  const latitude = Math.atan2(z + e2 / (1 - e2) * b * Math.sin(t) ** 3, p - e2 * a * Math.cos(t) ** 3);
  const n = a / Math.sqrt(1 - e2 * Math.sin(latitude) ** 2);
  const height = p * Math.cos(latitude) + z * Math.sin(latitude) - a * a / n;
  return [latitude * 180 / Math.PI, Math.atan2(y, x) * 180 / Math.PI, height];
}

let live = null;
function splatChunk(i, text) { live.take(i, text); }

try {
  live = new Live(splatCity);
} catch (error) {
  const box = document.getElementById("message");
  box.textContent = `This page cannot draw the city: ${error.message}`;
  box.hidden = false;
}
