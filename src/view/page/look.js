// What the picture shows: channel, blend, exposure, view of the colour config, and the marks over it.
import { add, placeIn } from "./geometry.js";
import { cropControls } from "./crop.js";
import { byId, check, element, row, select } from "./ui.js";

export const CHANNELS = [["colour", "Colour"], ["depth", "Depth"], ["normal", "Surface direction"], ["opacity", "Opacity"],
  ["tiles", "Tile that drew it"], ["coverage", "Photos that see it"], ["occlusion", "Ambient occlusion"]];

export function frustum(view, size) {
  const t = Math.tan(view.vfov_deg * Math.PI / 360) * size, r = view.rotation;
  const corner = (x, y) => add(view.centre, [0, 1, 2].map((i) => x * t * view.aspect * r[i] + y * t * r[3 + i] + size * r[6 + i]));
  const four = [corner(-1, -1), corner(1, -1), corner(1, 1), corner(-1, 1)];
  return four.flatMap((c, i) => [view.centre, c, c, four[(i + 1) % 4]]);
}

const coloured = (places, colour) => new Float32Array(places.flatMap((place) => [...place, ...colour]));

// The photo whose camera is drawn near a place in the picture; undefined: none is.
function cameraAt({ camera, city }, [x, y]) {
  const far = (view) => {
    const at = placeIn(camera, camera.aspect, view.centre);
    return at ? Math.hypot((at[0] - x) * camera.aspect, at[1] - y) : Infinity;
  };
  return city.views.map((view) => [far(view), view]).filter(([d]) => d < 0.06).sort((a, b) => a[0] - b[0])[0]?.[1];
}

function circle(tile) {
  const n = 64, at = (i) => {
    const a = i / n * 2 * Math.PI;
    return add(tile.centre, [tile.radius_m * Math.cos(a), tile.radius_m * Math.sin(a), 0]);
  };
  return Array.from({ length: n }, (_, i) => [at(i), at(i + 1)]).flat();
}

async function showPoints(app, box) {
  if (!box.checked) return app.stage.unmark("points");
  const { head, tail } = await app.link.ask("points"), view = new DataView(tail), data = new Float32Array(6 * head.n);
  if (!box.checked) return; // turned off while they were on their way
  for (let i = 0; i < head.n; i++)
    for (let c = 0; c < 3; c++) {
      data[6 * i + c] = view.getFloat32(16 * i + 4 * c, true);
      data[6 * i + 3 + c] = view.getUint8(16 * i + 12 + c) / 255;
    }
  app.stage.mark("points", "POINTS", data, 1, 2.5);
}

function legend(head, channel, unit) {
  const node = byId("legend");
  node.hidden = !head.range;
  if (!head.range) return;
  const [low, high] = head.range;
  node.replaceChildren(element("span", { className: "ramp" }),
    channel === "coverage" ? `${high} – ${low} photos` : `${low} – ${high} ${unit} along the ray`);
}

export function setUpLook(app) {
  const { picture, stage } = app, panel = byId("look");
  picture.addEventListener("shown", (e) => e.detail.asked.slot === 0 && legend(e.detail.head, e.detail.asked.look.channel, app.city.frame.unit));

  // A control of the look, which follows when the look is changed elsewhere, such as by a saved light.
  function bound(key, control) {
    picture.addEventListener("look", () => {
      if (String(picture.look[key] ?? "") === control.value) return;
      control.value = picture.look[key] ?? "";
      control.dispatchEvent(new Event("shown"));
    });
    return control;
  }
  const choice = (key, values, value = "") => bound(key, select(values, value, (chosen) => picture.setLook({ [key]: chosen })));

  // The finest picture of the view that came, as the server sent it.
  function savePicture() {
    if (!picture.jpeg) return;
    const url = URL.createObjectURL(picture.jpeg);
    element("a", { href: url, download: `${app.city.name}.jpg` }).click();
    setTimeout(() => URL.revokeObjectURL(url), 1000);
  }

  app.camera.addEventListener("click", ({ detail }) => {
    if (!stage.marks.has("cameras") || stage.canvas.classList.contains("measuring")) return;
    const view = cameraAt(app, detail);
    if (view) app.openTab((tab) => tab.id === "tab-photos"), app.flyToPhoto(view.name);
  });

  function controls(city) {
    const exposure = bound("exposure_ev", element("input", { type: "range", min: -6, max: 6, step: 0.1, value: 0 }));
    exposure.addEventListener("input", () => picture.setLook({ exposure_ev: +exposure.value }));
    const most = select([["640", "640 px"], ["960", "960 px"], ["1600", "1600 px"], ["4096", "as large as the window"]], "1600",
      (value) => {
        picture.most = +value;
        picture.refresh();
      });
    const fov = element("input", { type: "range", min: 15, max: 110, step: 1, value: Math.round(app.camera.vfov) });
    fov.addEventListener("input", () => app.camera.set({ vfov: +fov.value }));
    app.camera.addEventListener("change", () => {
      fov.value = app.camera.vfov;
      fov.nextElementSibling.textContent = `${Math.round(app.camera.vfov)}°`;
    });
    return [
      element("h2", {}, "Picture"),
      row("Show", choice("channel", CHANNELS, "colour")),
      row("Tiles", choice("name", [["", "blended"], ...city.tiles.map(({ id }) => [id, `only ${id}`])])),
      row("Blending", choice("blend", [["", `as in city.yaml (${city.blend})`], ...city.blends.map((b) => [b, b])])),
      row("Colour view", choice("display_view", [["", "as in city.yaml"], ...city.display_views.map((v) => [v, v])])),
      ...(city.looks.length ? [row("Colour look", choice("look", [["", "as in city.yaml"], ...city.looks.map((l) => [l, l])]))] : []),
      row("Exposure", exposure, (v) => `${(+v).toFixed(1)} EV`),
      row("Field of view", fov, (v) => `${v}°`),
      row("At rest", most),
      element("button", { id: "save-picture", onclick: savePicture }, "Save this picture"),
      element("h2", {}, "Compare"),
      row("With blending", select([["", "choose one"], ...city.blends.map((b) => [b, b])], "", (blend) =>
        blend && app.compare({ ...picture.look, blend }, picture.look.blend || city.blend, blend))),
      element("div", { className: "row" },
        element("button", { id: "keep", title: "Then change something: the left picture follows, the right one stays as it is", onclick: () =>
          app.compare({ ...picture.look }, "Now", "Kept") }, "Keep this on the right"),
        element("button", { onclick: () => app.compare(null) }, "One picture")),
      ...cropControls(app, city),
      element("h2", {}, "Drawn over it"),
      check("Cameras (click one to fly there)", false, (on) => on
        ? stage.mark("cameras", "LINES", coloured(city.views.flatMap((view) => frustum(view, app.camera.reach / 8)), [1, 0.8, 0.2]), 0.9)
        : stage.unmark("cameras")),
      check(`Sparse points (${city.points})`, false, (on, box) => showPoints(app, box)),
      check("Reach of tiles", false, (on) => on
        ? stage.mark("tiles", "LINES", coloured(city.tiles.flatMap(circle), [0.3, 0.8, 1]), 1) : stage.unmark("tiles")),
      element("h2", {}, "Keys"),
      element("p", { className: "soft" }, "Drag: turn. Right drag or Shift: slide. Wheel or two fingers: nearer. W A S D or arrows: move. Q, E: down, up. J, L, I, K: turn. Shift: faster. Home: back to the first photo's view."),
    ];
  }
  return { id: "look", begin: (city) => panel.replaceChildren(...controls(city)) };
}

export { coloured };
