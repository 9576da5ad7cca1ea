// The camera, and how mouse, touch and keys move it.
import { RAD, add, anglesOf, clamp, mix, norm, rayOf, rotationOf, scale, sub, unit } from "./geometry.js";
import { calm } from "./ui.js";

const WIDEST_DEG = 170; // that the server draws
const EYE_M = 1.7, TURN_DEG = 140 /* by a drag across the picture */, FLIGHT_MS = 700, KEY_TURN_DEG = 45 /* a second */;

export class Camera extends EventTarget {
  constructor(canvas) {
    super();
    Object.assign(this, { canvas, centre: [0, 0, 0], heading: 0, pitch: 0, roll: 0, vfov: 60, mode: "orbit" });
    this.target = null; // what orbit turns around
    this.reach = 20; // metres that a second of flying covers
    this.keys = new Set(); // that are down,
    this.fresh = new Set(); // that no step has seen yet,
    this.ended = new Set(); // and of these, those that were let go: they count for one step
    this.fingers = new Map();
    this.depthAt = () => 0; // metres along the ray of a place in the picture; set by whoever knows
    this.listen();
  }

  get aspect() {
    return this.canvas.clientWidth / Math.max(this.canvas.clientHeight, 1);
  }
  state() {
    const { centre, heading, pitch, roll, vfov } = this;
    return { centre: [...centre], heading, pitch, roll, vfov };
  }
  set(state) {
    Object.assign(this, state);
    this.heading = ((this.heading % 360) + 360) % 360;
    this.pitch = clamp(this.pitch, -90, 90);
    this.vfov = Math.min(this.vfov, WIDEST_DEG);
    this.dispatchEvent(new Event("change"));
  }
  setPose({ centre, rotation, vfov_deg }) {
    this.set({ centre: [...centre], ...anglesOf(rotation), vfov: vfov_deg });
  }

  // A short flight to another state, by the shorter rotation; at once for who wants less motion.
  flyTo(state) {
    const from = this.state(), begin = performance.now();
    const turn = ((state.heading - from.heading + 540) % 360) - 180;
    this.target = null;
    cancelAnimationFrame(this.flight);
    if (calm()) return this.set(state);
    const step = (now) => {
      const t = clamp((now - begin) / FLIGHT_MS, 0, 1), e = t * t * (3 - 2 * t);
      if (t === 1) return this.set(state);
      this.set({
        centre: from.centre.map((x, i) => mix(x, state.centre[i], e)), heading: from.heading + turn * e,
        pitch: mix(from.pitch, state.pitch, e), roll: mix(from.roll, state.roll, e), vfov: mix(from.vfov, state.vfov, e),
      });
      this.flight = requestAnimationFrame(step);
    };
    this.flight = requestAnimationFrame(step);
  }
  flyToPose({ centre, rotation, vfov_deg }) {
    this.flyTo({ centre: [...centre], ...anglesOf(rotation), vfov: vfov_deg });
  }

  // Pixels of the canvas to -1 .. 1.
  inPicture(event) {
    const box = this.canvas.getBoundingClientRect();
    return [2 * (event.clientX - box.left) / box.width - 1, 2 * (event.clientY - box.top) / box.height - 1];
  }

  pickTarget() {
    const depth = this.depthAt(0, 0) || this.reach;
    this.target = add(this.centre, scale(rayOf(this, this.aspect, 0, 0), depth));
  }

  turn(dx, dy) {
    if (this.mode !== "orbit") return this.set({ heading: this.heading + dx, pitch: this.pitch + dy });
    if (!this.target) this.pickTarget();
    const distance = norm(sub(this.target, this.centre));
    const heading = this.heading + dx, pitch = clamp(this.pitch + dy, -89, 89);
    const forward = rotationOf({ heading, pitch }).slice(6, 9);
    this.set({ heading, pitch, roll: 0, centre: sub(this.target, scale(forward, distance)) });
  }

  // As fractions of the picture's height.
  pan(dx, dy) {
    const depth = this.target ? norm(sub(this.target, this.centre)) : this.depthAt(0, 0) || this.reach;
    const k = 2 * depth * Math.tan(this.vfov * RAD / 2), r = rotationOf(this);
    const move = add(scale(r.slice(0, 3), -dx * k), scale(r.slice(3, 6), -dy * k));
    if (this.target) this.target = add(this.target, move);
    this.set({ centre: add(this.centre, move) });
  }

  // Moves towards a place in the picture; amount 1 halves the distance.
  approach(amount, x = 0, y = 0) {
    const depth = clamp(this.depthAt(x, y) || this.reach, this.reach / 50, this.reach * 20);
    const step = depth * (1 - 2 ** -amount), ray = rayOf(this, this.aspect, x, y), walks = this.mode === "walk";
    this.set({ centre: add(this.centre, scale(walks ? unit([ray[0], ray[1], 0]) : ray, step)) });
    this.target = null;
    if (walks) this.dispatchEvent(new Event("step"));
  }

  // Moves by the pressed keys, for dt seconds. True while a key moves the camera.
  step(dt) {
    const down = (...names) => names.some((name) => this.keys.has(name));
    const ahead = down("w", "arrowup") - down("s", "arrowdown"), aside = down("d", "arrowright") - down("a", "arrowleft");
    const up = down("e", "pageup") - down("q", "pagedown");
    const turn = down("l") - down("j"), tilt = down("i") - down("k"), fast = down("shift") ? 4 : 1;
    this.fresh.clear();
    for (const key of this.ended) this.keys.delete(key);
    this.ended.clear();
    if (turn || tilt) this.turn(KEY_TURN_DEG * turn * dt, KEY_TURN_DEG * tilt * dt);
    if (!ahead && !aside && !up) return !!(turn || tilt);
    const speed = (this.mode === "walk" ? Math.min(1.4 * this.unitSpeed, this.reach) : this.reach) * fast;
    const r = rotationOf(this.mode === "walk" ? { heading: this.heading, pitch: 0 } : this), k = speed * dt;
    this.target = null;
    this.set({ centre: add(this.centre, [0, 1, 2].map((i) => k * (ahead * r[6 + i] + aside * r[i] + (i === 2 ? up : 0)))) });
    return true;
  }
  get unitSpeed() {
    return this.metric ? 2 : this.reach;
  }

  // Sets eye height above the ground. After the first time it rises by at most one step, so that walls are not climbed.
  stand(groundZ, first) {
    const eye = this.metric ? EYE_M : this.reach / 10, z = groundZ + eye;
    if (first || z - this.centre[2] < eye / 2) this.set({ centre: [this.centre[0], this.centre[1], z] });
  }

  listen() {
    const c = this.canvas;
    c.addEventListener("contextmenu", (e) => e.preventDefault());
    c.addEventListener("pointerdown", (e) => this.press(e));
    c.addEventListener("pointermove", (e) => this.drag(e));
    for (const name of ["pointerup", "pointercancel"]) c.addEventListener(name, (e) => this.release(e));
    c.addEventListener("wheel", (e) => {
      e.preventDefault();
      this.approach(-clamp(e.deltaY, -240, 240) / 480, ...this.inPicture(e));
    }, { passive: false });
    c.addEventListener("keydown", (e) => {
      if (e.ctrlKey || e.altKey || e.metaKey) return;
      if (["ArrowUp", "ArrowDown", "ArrowLeft", "ArrowRight", "PageUp", "PageDown", "Home"].includes(e.key)) e.preventDefault();
      this.hold(e.key.toLowerCase());
      // As a click in the middle, for those who have no pointer.
      if (e.key === "Enter" && !e.repeat) this.dispatchEvent(new CustomEvent("click", { detail: [0, 0] }));
      if (e.key === "Home") this.dispatchEvent(new Event("home"));
    });
    // The pad of buttons on touch screens: each does what its key does, as long as it is held.
    for (const button of document.querySelectorAll("#pad button")) {
      button.addEventListener("pointerdown", (e) => {
        cancelAnimationFrame(this.flight);
        button.setPointerCapture(e.pointerId);
        this.hold(button.dataset.key);
      });
      for (const name of ["pointerup", "pointercancel"])
        button.addEventListener(name, () => this.letGo(button.dataset.key));
    }
    addEventListener("keyup", (e) => this.letGo(e.key.toLowerCase()));
    addEventListener("blur", () => this.keys.clear());
  }

  hold(key) {
    if (!this.keys.has(key)) this.fresh.add(key);
    this.keys.add(key);
  }
  letGo(key) {
    if (this.fresh.has(key)) this.ended.add(key);
    else this.keys.delete(key);
  }

  press(e) {
    cancelAnimationFrame(this.flight);
    this.canvas.setPointerCapture(e.pointerId);
    this.fingers.set(e.pointerId, { x: e.clientX, y: e.clientY });
    this.moved = this.fingers.size > 1 ? Infinity : 0;
    if (this.mode === "orbit") this.pickTarget();
    this.canvas.classList.add("busy");
  }

  drag(e) {
    const finger = this.fingers.get(e.pointerId);
    if (!finger) return;
    const dx = e.clientX - finger.x, dy = e.clientY - finger.y, height = Math.max(this.canvas.clientHeight, 1);
    this.moved += Math.abs(dx) + Math.abs(dy);
    if (this.fingers.size === 2) {
      const [other] = [...this.fingers.entries()].filter(([id]) => id !== e.pointerId).map(([, at]) => at);
      const before = Math.hypot(finger.x - other.x, finger.y - other.y);
      const after = Math.hypot(e.clientX - other.x, e.clientY - other.y);
      if (before > 10 && after > 10) this.approach(Math.log2(after / before));
      this.pan(dx / 2 / height, dy / 2 / height);
    } else if (e.buttons & 6 || e.shiftKey) {
      this.pan(dx / height, dy / height);
    } else {
      const k = TURN_DEG / height * (this.mode === "orbit" ? 1 : -0.5);
      this.turn(dx * k, -dy * k);
    }
    Object.assign(finger, { x: e.clientX, y: e.clientY });
  }

  release(e) {
    if (!this.fingers.delete(e.pointerId)) return;
    if (!this.fingers.size) this.canvas.classList.remove("busy");
    if (this.moved < 5 && e.type === "pointerup")
      this.dispatchEvent(new CustomEvent("click", { detail: this.inPicture(e) }));
  }
}
