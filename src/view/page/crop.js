// A box: what is outside of it is not shown.
import { add, rayOf, scale } from "./geometry.js";
import { coloured } from "./look.js";
import { element, row } from "./ui.js";

const AXES = ["East", "North", "Up"];

function edges(box) {
  const corner = (bits) => [0, 1, 2].map((axis) => box[axis + (bits >> axis & 1 ? 3 : 0)]), lines = [];
  for (let a = 0; a < 8; a++)
    for (let axis = 0; axis < 3; axis++) if (!(a >> axis & 1)) lines.push(corner(a), corner(a | 1 << axis));
  return lines;
}

export function cropControls(app, city) {
  const low = [0, 1, 2].map((axis) => Math.min(...city.tiles.map((tile) => tile.low[axis])));
  const high = [0, 1, 2].map((axis) => Math.max(...city.tiles.map((tile) => tile.high[axis])));
  let box = null;
  const sliders = element("div", { hidden: true });

  function apply() {
    app.picture.setLook({ crop: box && [...box] });
    if (box) app.stage.mark("crop", "LINES", coloured(edges(box), [1, 1, 1]), 0.7);
    else app.stage.unmark("crop");
    sliders.hidden = !box;
  }
  // The lower face stays below the upper one.
  function slider(axis, upper) {
    const node = element("input", { type: "range", min: low[axis], max: high[axis], step: (high[axis] - low[axis]) / 500 || 1, value: box[axis + (upper ? 3 : 0)] });
    node.addEventListener("input", () => {
      box[axis + (upper ? 3 : 0)] = upper ? Math.max(+node.value, box[axis]) : Math.min(+node.value, box[axis + 3]);
      node.value = box[axis + (upper ? 3 : 0)];
      apply();
    });
    return row(`${AXES[axis]} ${upper ? "to" : "from"}`, node, (v) => `${(+v).toFixed(1)} ${city.frame.unit}`);
  }
  function showSliders() {
    sliders.replaceChildren(...[0, 1, 2].flatMap((axis) => [slider(axis, false), slider(axis, true)]));
  }
  app.setCrop = (given) => {
    if (!given && !box) return;
    box = given;
    if (box) showSliders();
    apply();
  };
  // At first the box is about what is in the middle of the picture.
  function begin() {
    const { camera } = app, depth = camera.depthAt(0, 0) || camera.reach;
    const middle = add(camera.centre, scale(rayOf(camera, camera.aspect, 0, 0), depth));
    box = [-1, 1].flatMap((side) => middle.map((x) => x + side * depth / 3));
    for (let i = 0; i < 6; i++) box[i] = Math.min(Math.max(box[i], low[i % 3]), high[i % 3]);
    showSliders();
    apply();
  }
  return [element("h2", {}, "Crop"), element("div", { className: "row" },
    element("button", { id: "crop", onclick: begin }, "About what is in the middle"),
    element("button", { id: "crop-off", onclick: () => (box = null, apply()) }, "Everything")), sliders];
}
