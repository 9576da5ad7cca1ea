// Requests pictures: small ones while the camera moves, one after another; then one that is refined pass by pass.
import { rotationOf } from "./geometry.js";
import { queueOf } from "./link.js";

const REST_MS = 160 /* without motion: the camera rests */, GOAL_MS = 100 /* from asking to having, while it moves */;
const LEAST_PX = 96, MOST_SIDE = 4096, MOST_PIXELS = 4e6;

export class Picture extends EventTarget {
  constructor(link, camera, stage) {
    super();
    Object.assign(this, { link, camera, stage });
    this.look = { channel: "colour", blend: "", display_view: "", look: "", exposure_ev: 0, appearance: "", name: "" };
    this.beside = null; // {look: ...}: the same view in another light or another way
    this.width = 320; // of pictures while the camera moves
    this.most = 1600; // of pictures at rest
    this.turn = 0; // of pictures, as they came
    this.shown = [0, 0]; // by slot: the turn of what is shown
    this.asked = new Map(); // number: {slot, camera, aspect, moving, at}
    this.moving = 0; // number of the quick picture on its way
    this.movedAt = 0;
    this.settling = false; // the camera rests; the picture at rest follows the quick one
    this.wanted = false; // the camera moved and nothing was asked for since
    this.timings = [];
    // One after another: a slot holds one picture, and the server does not answer for one that another replaced.
    this.thumbs = queueOf(1);
    this.probes = queueOf(1);
    link.addEventListener("frame", (e) => this.take(e.detail));
    link.addEventListener("failed", (e) => this.fail(e.detail));
    link.addEventListener("open", () => this.reset());
    camera.addEventListener("change", () => this.move());
  }

  reset() {
    this.asked.clear();
    this.moving = 0;
    this.refresh();
  }

  move() {
    this.movedAt = performance.now();
    this.wanted = true;
    this.stage.dirty = true;
    if (!this.moving) this.ask(true);
    this.settling = false;
    clearTimeout(this.rest);
    this.rest = setTimeout(() => this.settle(), REST_MS);
  }

  // The camera rests. A quick picture that is on its way is waited for: on a slow machine, where motions with pauses
  // would cancel one after another, none would come.
  settle() {
    this.settling = this.moving > 0;
    if (!this.settling) this.refresh();
  }

  // The picture at rest, such as after a setting has changed.
  refresh() {
    clearTimeout(this.rest);
    this.moving = 0;
    this.settling = false;
    this.ask(false);
  }

  size(moving) {
    const aspect = this.camera.aspect, ratio = Math.min(devicePixelRatio || 1, 2);
    const full = Math.min(this.stage.canvas.clientWidth * ratio, this.most, MOST_SIDE, MOST_SIDE * aspect, Math.sqrt(MOST_PIXELS * aspect));
    const width = Math.max(Math.round(moving ? Math.min(this.width, full) : full), 8);
    return { width, height: Math.max(Math.round(width / aspect), 8) };
  }

  fields(slot, moving, look) {
    const state = this.camera.state();
    return {
      ...look, slot, moving, ...this.size(moving), vfov_deg: state.vfov, centre: state.centre,
      rotation: rotationOf(state),
    };
  }

  ask(moving) {
    if (!this.camera.aspect || !this.ready) return;
    this.wanted = false;
    this.asked.forEach((value, key) => performance.now() - value.at > 60000 && this.asked.delete(key));
    for (const [slot, look] of [[0, this.look], [1, this.beside]]) {
      if (!look || (slot && moving)) continue;
      const id = this.link.send("view", this.fields(slot, moving, look));
      if (!id) return;
      this.asked.set(id, { slot, moving, look, camera: this.camera.state(), aspect: this.camera.aspect, at: performance.now() });
      if (!slot) this.latest = id;
      if (moving) this.moving = id;
    }
  }

  async take({ head, jpeg }) {
    const asked = this.asked.get(head.id);
    if (!asked) return;
    const now = performance.now();
    if (head.last) this.asked.delete(head.id);
    if (asked.moving && head.id === this.moving) {
      this.moving = 0;
      const took = now - asked.at;
      this.width = Math.min(Math.max(this.width * Math.min(Math.max(Math.sqrt(GOAL_MS / took), 0.75), 1.25), LEAST_PX), 960);
      this.timings.push({ at: now, took });
      if (this.timings.length > 240) this.timings.shift();
      if (this.wanted) this.ask(true);
      else if (this.settling) this.refresh();
    }
    if (!this.stage.gl) return; // there is nothing to draw with
    if (!asked.slot && this.coarser(head, asked)) return;
    const turn = ++this.turn, bitmap = await createImageBitmap(jpeg);
    // A newer picture arrived while this one was decoded, or something else is to be beside it.
    if (turn < this.shown[asked.slot] || (asked.slot === 1 && asked.look !== this.beside)) return bitmap.close();
    this.shown[asked.slot] = turn;
    if (asked.slot === 0) [this.lookShown, this.jpeg] = [asked.look, jpeg];
    this.stage.show(asked.slot, bitmap, { camera: asked.camera, aspect: asked.aspect, grid: head.grid, depth: head.depth });
    bitmap.close();
    this.dispatchEvent(new CustomEvent("shown", { detail: { head, asked, took: performance.now() - asked.at } }));
  }

  // Skip a first pass when a finer picture of the view is shown: it would flicker.
  coarser(head, asked) {
    const there = this.stage.frames[0];
    return !head.last && !asked.moving && there && head.width < there.width && asked.look === this.lookShown &&
      JSON.stringify(there.camera) === JSON.stringify(asked.camera);
  }

  fail({ id, text }) {
    const asked = this.asked.get(id);
    this.asked.delete(id);
    if (asked && id === this.moving) {
      this.moving = 0;
      if (this.settling) this.refresh();
    }
    this.dispatchEvent(new CustomEvent("failed", { detail: text }));
  }

  // Pictures per second over the last two seconds of motion.
  rate() {
    const now = performance.now(), recent = this.timings.filter(({ at }) => now - at < 2000);
    return recent.length > 1 ? (recent.length - 1) * 1000 / (recent[recent.length - 1].at - recent[0].at) : 0;
  }

  setLook(fields) {
    this.look = { ...this.look, ...fields };
    this.dispatchEvent(new Event("look"));
    this.refresh();
  }
  setBeside(look) {
    this.beside = look;
    this.stage.hide(1);
    this.refresh();
  }

  // One small picture that is not drawn on the stage: resolves with its JPEG. An urgent one overtakes those that wait.
  thumb(pose, look, width = 160, height = 120, urgent = false) {
    return this.thumbs(() => this.link.ask("view", {
      ...look, slot: 2, moving: true, width, height, vfov_deg: pose.vfov_deg, centre: pose.centre, rotation: pose.rotation,
    }).then(({ jpeg }) => jpeg), urgent);
  }

  // Depth in metres along the ray through a place in the picture; 0: nothing there.
  probe(state) {
    return this.probes(() => this.link.ask("view", {
      slot: 3, moving: true, width: 3, height: 3, vfov_deg: state.vfov ?? 0.2, centre: state.centre,
      rotation: state.rotation ?? rotationOf(state), blend: this.look.blend, name: this.look.name, crop: this.look.crop,
    }).then(({ head }) => head.metres));
  }
}
