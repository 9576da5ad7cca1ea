// The map: tiles, photos, the camera and its path; and the facts about a tile.
import { RAD, clamp } from "./geometry.js";
import { byId, element, svg } from "./ui.js";
import { shortName } from "./light.js";

export function curve(values, steps) {
  const good = values.map((v, i) => [steps[i], v]).filter(([, v]) => typeof v === "number" && Number.isFinite(v));
  if (good.length < 2) return element("p", { className: "soft" }, "No training log.");
  const xs = good.map(([x]) => x), ys = good.map(([, y]) => y), low = Math.min(...ys), high = Math.max(...ys), last = Math.max(...xs);
  const at = ([x, y]) => `${(30 + 265 * x / last).toFixed(1)},${(95 - 85 * (y - low) / (high - low || 1)).toFixed(1)}`;
  return svg("svg", { viewBox: "0 0 300 112", class: "curve", role: "img", "aria-label": `PSNR from ${low.toFixed(1)} to ${high.toFixed(1)} dB over ${last} steps` },
    svg("polyline", { points: good.map(at).join(" ") }),
    svg("text", { x: 2, y: 14 }, high.toFixed(1)), svg("text", { x: 2, y: 95 }, low.toFixed(1)),
    svg("text", { x: 295, y: 109, "text-anchor": "end" }, `step ${last}`), svg("text", { x: 30, y: 109 }, "PSNR of training, dB"));
}

const figure = (x) => (x === null ? "–" : Math.abs(x) >= 0.01 ? x.toFixed(3) : x.toExponential(1));

function effects(list) {
  const head = element("tr", {}, ...["Effect", "Evidence", "Threshold"].map((text, i) => element("th", i ? { className: "n" } : {}, text)));
  return element("table", {}, head, ...list.map((e) => element("tr", {},
    element("td", {}, e.name.replaceAll("_", " "), element("span", { className: "soft" }, ` ${e.on ? "on" : "off"} (${e.reason})`)),
    element("td", { className: "n" }, figure(e.evidence)), element("td", { className: "n" }, figure(e.threshold)))));
}

export function setUpMap(app) {
  const { camera, link } = app, panel = byId("map"), details = element("div"), me = svg("path", { class: "me" });
  const route = svg("polyline", { class: "route" });
  const wide = element("span", { id: "map-width" });
  let plan = null, size = 1, city = null, whole = null, box = null;

  async function tile(id) {
    for (const node of plan.querySelectorAll(".tile")) node.classList.toggle("chosen", node.dataset.id === id);
    const { head } = await link.ask("tile", { name: id });
    const psnr = head.metrics?.train_psnr;
    details.replaceChildren(
      element("h2", {}, `Tile ${id}`),
      element("p", {}, `${head.photos.length} photos to train on, ${head.held_out.length} held out${psnr ? `; ${psnr.toFixed(2)} dB on the photos trained on` : ""}.`),
      effects(head.effects), element("h2", {}, "Training"), curve(head.curve.psnr, head.curve.step),
      element("h2", {}, "Its photos"),
      element("div", { className: "row" }, ...head.photos.slice(0, 40).map((name) =>
        element("button", { title: name, onclick: () => app.flyToPhoto(name) }, shortName(name)))));
    app.tileShown = id;
  }

  function shapes() {
    const tiles = city.tiles.map((t) => {
      const node = svg("circle", { class: "tile", cx: t.centre[0], cy: -t.centre[1], r: t.radius_m, tabindex: 0, role: "button", "aria-label": `Tile ${t.id}` });
      node.dataset.id = t.id;
      node.addEventListener("click", () => tile(t.id));
      node.addEventListener("keydown", (e) => (e.key === "Enter" || e.key === " ") && tile(t.id));
      return node;
    });
    const photos = city.views.map((v) => {
      const node = svg("circle", { class: v.held_out ? "photo held" : "photo", cx: v.centre[0], cy: -v.centre[1], r: size / 110 });
      node.append(svg("title", {}, v.name));
      node.addEventListener("click", () => app.flyToPhoto(v.name));
      return node;
    });
    return [...tiles, ...photos, route, me];
  }

  // The part of the map that is shown, [west, -north, width, height]: k times as large, about a place in it from 0 to 1.
  function zoom(k, x = 0.5, y = 0.5) {
    const w = clamp(box[2] * k, whole[2] / 500, whole[2]), h = w * whole[3] / whole[2];
    look([box[0] + (box[2] - w) * x, box[1] + (box[3] - h) * y, w, h]);
  }
  function look([x, y, w, h]) {
    box = [clamp(x, whole[0], whole[0] + whole[2] - w), clamp(y, whole[1], whole[1] + whole[3] - h), w, h];
    plan.setAttribute("viewBox", box.join(" "));
    plan.classList.toggle("near", w < whole[2]); // then a finger moves the map, and does not scroll the panel
    for (const node of plan.querySelectorAll(".photo")) node.setAttribute("r", w / 110);
    wide.textContent = `${w < 10 ? w.toFixed(1) : Math.round(w)} ${city.frame.unit} wide`;
    size = w;
    move();
  }
  // The wheel zooms; a drag moves the map, and is then no click on what lies below.
  function listen() {
    const at = (e) => {
      const b = plan.getBoundingClientRect();
      return [(e.clientX - b.left) / b.width, (e.clientY - b.top) / b.height];
    };
    let from = null, moved = false;
    plan.addEventListener("wheel", (e) => (e.preventDefault(), zoom(2 ** (clamp(e.deltaY, -240, 240) / 240), ...at(e))), { passive: false });
    plan.addEventListener("pointerdown", (e) => ((from = at(e)), (moved = false)));
    plan.addEventListener("pointermove", (e) => {
      if (!from || !e.buttons) return;
      const [x, y] = at(e), by = [x - from[0], y - from[1]];
      if (!moved && Math.hypot(...by) < 0.015) return;
      moved = true;
      from = [x, y];
      look([box[0] - by[0] * box[2], box[1] - by[1] * box[3], box[2], box[3]]);
    });
    addEventListener("pointerup", () => (from = null));
    plan.addEventListener("click", (e) => moved && e.stopPropagation(), true);
  }

  function move() {
    if (panel.hidden || !plan) return;
    const [x, y] = camera.centre, h = camera.heading * RAD, s = size / 22, at = (turn, k) =>
      `${x + k * s * Math.sin(h + turn)},${-(y + k * s * Math.cos(h + turn))}`;
    me.setAttribute("d", `M${at(0, 1.4)}L${at(2.4, 1)}L${at(Math.PI, 0.4)}L${at(-2.4, 1)}Z`);
    route.setAttribute("points", (app.route?.() || []).map((p) => `${p[0]},${-p[1]}`).join(" "));
  }
  camera.addEventListener("change", move);

  // Tiles that are not trained have dashed outlines.
  link.addEventListener("state", ({ detail }) => {
    for (const node of plan?.querySelectorAll(".tile") || []) node.classList.toggle("waiting", !(node.dataset.id in detail.trained));
  });

  function begin(facts) {
    city = facts;
    const places = [...city.tiles.flatMap((t) => [-1, 1].map((s) => [t.centre[0] + s * t.radius_m, t.centre[1] + s * t.radius_m])),
      ...city.views.map((v) => v.centre)];
    const low = [0, 1].map((i) => Math.min(...places.map((p) => p[i]))), high = [0, 1].map((i) => Math.max(...places.map((p) => p[i])));
    size = Math.max(high[0] - low[0], high[1] - low[1], 1e-6);
    for (const i of [0, 1]) low[i] -= size / 50, high[i] += size / 50; // dots at the edge are whole
    whole = box = [low[0], -high[1], high[0] - low[0], high[1] - low[1]];
    plan = svg("svg", { class: "plan", "aria-label": "Plan of the city, north up" }, ...shapes());
    panel.replaceChildren(plan, element("div", { className: "row" },
      element("button", { title: "Nearer", "aria-label": "Nearer", onclick: () => zoom(0.5) }, "+"),
      element("button", { title: "Farther", "aria-label": "Farther", onclick: () => zoom(2) }, "−"),
      element("button", { onclick: () => look(whole) }, "All"), wide),
    element("p", { className: "soft" }, "North is up. Choose a tile, or fly to a photo (dots; held out ones in red)."), details);
    listen();
    look(whole);
  }
  return { id: "map", begin, open: move };
}
