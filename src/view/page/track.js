// The keyframes of a path on its time line: drag them, or move them by arrow keys.
import { element } from "./ui.js";

const STEP_S = 0.5; // of an arrow key

// keys(): the keyframes in order of time; moved(): a time changed; chosen(key): go there.
export function makeTrack({ keys, moved, chosen }) {
  const node = element("div", { className: "track", role: "group", "aria-label": "Keyframes on the time line" });
  const length = () => keys().at(-1)?.time || 1;
  let scale = 1, dragged = null;

  function place() {
    for (const [i, button] of [...node.children].entries()) {
      const { time } = button.key;
      button.style.left = `${Math.min(100 * time / scale, 100)}%`;
      button.setAttribute("aria-label", `Keyframe ${i + 1} at ${time.toFixed(1)} seconds: arrows move it, Enter goes there`);
      button.title = `${time.toFixed(1)} s`;
    }
  }

  function button(key, i) {
    const it = element("button", {}, `${i + 1}`);
    it.key = key;
    it.addEventListener("click", () => dragged || chosen(key));
    it.addEventListener("keydown", (e) => {
      const by = { ArrowLeft: -STEP_S, ArrowRight: STEP_S }[e.key];
      if (!by) return;
      e.preventDefault();
      key.time = Math.max(key.time + by, 0);
      moved();
      [...node.children].find((one) => one.key === key).focus();
    });
    it.addEventListener("pointerdown", (e) => {
      it.setPointerCapture(e.pointerId);
      it.from = e.clientX;
      dragged = null;
    });
    it.addEventListener("pointermove", (e) => {
      if (it.from === undefined || (!dragged && Math.abs(e.clientX - it.from) < 4)) return;
      const box = node.getBoundingClientRect();
      dragged = key;
      // Beyond the end the path becomes longer.
      key.time = Math.max(Math.round(10 * scale * (e.clientX - box.left) / box.width) / 10, 0);
      place();
    });
    for (const name of ["pointerup", "pointercancel"])
      it.addEventListener(name, () => {
        it.from = undefined;
        if (!dragged) return;
        moved();
        setTimeout(() => (dragged = null)); // after the click that follows
      });
    return it;
  }

  function draw() {
    scale = length();
    node.replaceChildren(...keys().map(button));
    node.hidden = !keys().length;
    place();
  }
  // The keyframe that was met last.
  function at(time) {
    const last = keys().findLast((key) => key.time <= time + 1e-6);
    for (const one of node.children) one.classList.toggle("now", one.key === last);
  }
  return { node, draw, at };
}
