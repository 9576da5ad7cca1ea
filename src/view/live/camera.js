// The camera, and how mouse, touch and keys move it. heading: clockwise from north; pitch: up.
"use strict";

const TURN_DEG = 120 /* by a drag across the picture */, KEY_TURN_DEG = 50 /* a second */;

class Camera extends EventTarget {
  // size: metres that are far in this city. eye_height: above the ground, for walking.
  constructor(canvas, size, eyeHeight) {
    super();
    Object.assign(this, { canvas, size, eyeHeight, eye: [0, 0, 0], heading: 0, pitch: 0, vfov: 55, mode: "orbit" });
    this.distance = size / 4; // to what orbit turns around
    this.keys = new Set();
    this.fingers = new Map();
    this.ground = null; // heights; set by whoever knows
    canvas.addEventListener("pointerdown", (e) => this.down(e));
    canvas.addEventListener("pointermove", (e) => this.move(e));
    for (const kind of ["pointerup", "pointercancel"]) canvas.addEventListener(kind, (e) => this.up(e));
    canvas.addEventListener("wheel", (e) => this.wheel(e), { passive: false });
    canvas.addEventListener("contextmenu", (e) => e.preventDefault());
    canvas.addEventListener("keydown", (e) => this.key(e, true));
    canvas.addEventListener("keyup", (e) => this.key(e, false));
    canvas.addEventListener("blur", () => this.keys.clear());
  }

  get axes() { return axesOf(this.heading, this.pitch); }
  get state() { return { eye: this.eye, vfov: this.vfov, ...this.axes }; }
  get target() { return add3(this.eye, this.axes.forward, this.distance); }

  changed() {
    this.heading = ((this.heading % 360) + 360) % 360;
    this.pitch = clamp(this.pitch, -89.9, 89.9);
    if (this.mode === "walk") this.stand();
    this.dispatchEvent(new Event("change"));
  }

  // A view: eye, forward, vertical field of view, distance of what it shows.
  show({ eye, forward, vfov, distance }) {
    Object.assign(this, anglesOf(forward), { eye: [...eye], vfov: clamp(vfov, 30, 80), distance });
    this.changed();
  }

  setMode(mode) {
    this.mode = mode;
    this.changed();
  }

  // Eye height above the ground below; where nothing is known, the height stays.
  stand() {
    const z = this.ground?.(this.eye[0], this.eye[1]);
    if (Number.isFinite(z)) this.eye[2] = z + this.eyeHeight;
  }

  turn(heading, pitch) {
    if (this.mode === "orbit") {
      const target = this.target;
      this.heading += heading;
      this.pitch = clamp(this.pitch + pitch, -89.9, 60);
      this.eye = add3(target, this.axes.forward, -this.distance);
    } else {
      this.heading -= heading;
      this.pitch -= pitch;
    }
    this.changed();
  }

  // Metres to the right, up and forward.
  shift(right, up, forward) {
    const axes = this.axes, ahead = this.mode === "walk" ? unit3([axes.forward[0], axes.forward[1], 0]) : axes.forward;
    const above = this.mode === "orbit" ? axes.up : [0, 0, 1];
    this.eye = add3(add3(add3(this.eye, axes.right, right), above, up), ahead, forward);
    this.changed();
  }

  // Nearer to the middle of the picture: below 1.
  dolly(factor) {
    if (this.mode === "orbit") {
      const target = this.target;
      this.distance = clamp(this.distance * factor, this.size / 2000, this.size * 20);
      this.eye = add3(target, this.axes.forward, -this.distance);
      this.changed();
    } else this.shift(0, 0, (1 - factor) * this.size / 12);
  }

  down(e) {
    this.canvas.setPointerCapture(e.pointerId);
    this.canvas.focus({ preventScroll: true });
    this.fingers.set(e.pointerId, { x: e.clientX, y: e.clientY, button: e.button, moved: 0 });
  }

  move(e) {
    const finger = this.fingers.get(e.pointerId);
    if (!finger) return;
    const before = [...this.fingers.values()].map((f) => ({ ...f }));
    finger.moved += Math.abs(e.clientX - finger.x) + Math.abs(e.clientY - finger.y);
    Object.assign(finger, { x: e.clientX, y: e.clientY });
    const after = [...this.fingers.values()], span = this.canvas.clientHeight || 1;
    const mean = (list, k) => list.reduce((sum, f) => sum + f[k], 0) / list.length;
    const dx = (mean(after, "x") - mean(before, "x")) / span, dy = (mean(after, "y") - mean(before, "y")) / span;
    if (after.length === 1 && finger.button !== 2 && !e.shiftKey) return this.turn(dx * TURN_DEG, -dy * TURN_DEG);
    const metres = 2 * this.distance * Math.tan(0.5 * radians(this.vfov));
    this.shift(-dx * metres, dy * metres, 0);
    if (after.length !== 2) return;
    const apart = ([a, b]) => Math.hypot(a.x - b.x, a.y - b.y) || 1;
    this.dolly(apart(before) / apart(after));
  }

  up(e) {
    const finger = this.fingers.get(e.pointerId);
    this.fingers.delete(e.pointerId);
    if (finger && finger.moved < 4 && e.type === "pointerup" && !this.fingers.size)
      this.dispatchEvent(new CustomEvent("point", { detail: { x: e.clientX, y: e.clientY } }));
  }

  wheel(e) {
    e.preventDefault();
    this.dolly(Math.exp(clamp(e.deltaY * (e.deltaMode ? 20 : 1), -200, 200) * 0.0015));
  }

  key(e, down) {
    const code = e.code || e.key;
    if (!/^(Key[WASDQEIJKL]|Arrow(Up|Down|Left|Right)|Page(Up|Down)|Equal|Minus|NumpadAdd|NumpadSubtract)$/.test(code) ||
      e.ctrlKey || e.metaKey || e.altKey) return;
    e.preventDefault();
    if (down) this.keys.add(code);
    else this.keys.delete(code);
    this.dispatchEvent(new Event("keys"));
  }

  // What the keys that are held do in `seconds`; false: none is held.
  step(seconds) {
    if (!this.keys.size) return false;
    const held = (...codes) => (codes.some((c) => this.keys.has(c)) ? 1 : 0), by = KEY_TURN_DEG * seconds;
    const turn = (held("ArrowRight", "KeyL") - held("ArrowLeft", "KeyJ")) * by;
    const nod = (held("ArrowUp", "KeyI") - held("ArrowDown", "KeyK")) * by;
    const speed = seconds * (this.mode === "walk" ? this.eyeHeight * 1.5 : this.size / 8);
    const side = held("KeyD") - held("KeyA"), ahead = held("KeyW") - held("KeyS");
    const rise = held("KeyE", "PageUp") - held("KeyQ", "PageDown");
    const nearer = held("Equal", "NumpadAdd") - held("Minus", "NumpadSubtract");
    if (turn || nod) this.turn(this.mode === "orbit" ? turn : -turn, this.mode === "orbit" ? -nod : -nod);
    if (side || ahead || rise) this.shift(side * speed, rise * speed, ahead * speed);
    if (nearer) this.dolly(Math.exp(-nearer * seconds));
    return true;
  }
}
