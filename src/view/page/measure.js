// Measures the distance between two clicked places, with exact depths from the server.
import { add, norm, rayOf, scale, sub, anglesOf, cross, unit } from "./geometry.js";
import { coloured } from "./look.js";
import { byId, say } from "./ui.js";

// A camera that looks along a ray.
function along(camera, ray) {
  const right = unit(Math.abs(ray[2]) < 0.999 ? cross(ray, [0, 0, 1]) : cross(ray, [0, 1, 0]));
  return { centre: camera.centre, vfov: 0.1, ...anglesOf([...right, ...cross(ray, right), ...ray]) };
}

export function setUpMeasure(app) {
  const { camera, stage, picture } = app, button = byId("measure");
  let places = [], on = false;

  const place = async ([x, y]) => {
    const from = camera.state(), ray = rayOf(camera, camera.aspect, x, y); // the camera may move before the answer
    const depth = await picture.probe(along(from, ray));
    return depth ? add(from.centre, scale(ray, depth)) : null;
  };
  async function take(at) {
    const found = await place(at);
    if (!on) return;
    if (!found) return say("There is nothing to measure to; click on something solid.", true);
    places = places.length === 2 ? [found] : [...places, found];
    const cross3 = places.flatMap((p) => [0, 1, 2].flatMap((axis) => [-1, 1].map((s) =>
      add(p, [0, 1, 2].map((i) => i === axis ? s * camera.reach / 100 : 0)))));
    stage.mark("measure", "LINES", coloured([...cross3, ...(places.length === 2 ? places : [])], [1, 0.25, 0.15]));
    if (places.length < 2) return say("Click the second place.");
    const d = sub(places[1], places[0]), unitName = app.city.frame.unit;
    app.measured = { distance: norm(d), across: Math.hypot(d[0], d[1]), up: d[2] };
    byId("message").textContent = "";
    say(`${norm(d).toFixed(2)} ${unitName} (${Math.hypot(d[0], d[1]).toFixed(2)} across, ${d[2].toFixed(2)} up)`, false, true);
  }
  camera.addEventListener("click", (e) => on && take(e.detail).catch((error) => say(error.message, true)));
  button.addEventListener("click", () => {
    on = !on;
    button.setAttribute("aria-pressed", on);
    stage.canvas.classList.toggle("measuring", on);
    places = [];
    stage.unmark("measure");
    say(on ? "Click the first place, or turn to it and press Enter in the picture." : "");
  });
  return { id: "measure" };
}
