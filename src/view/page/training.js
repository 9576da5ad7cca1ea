// The progress of the tiles. When a tile is trained again, the picture is requested again.
import { curve } from "./map.js";
import { byId, duration, element } from "./ui.js";

const CURVES = 200; // tiles whose curve is shown, at most

function describe(r) {
  return [r.total ? `${Math.round(r.done)} of ${Math.round(r.total)}` : "", r.psnr ? `${r.psnr.toFixed(2)} dB` : "",
    r.samples_per_s ? `${(r.samples_per_s / 1e6).toFixed(2)} M samples/s` : "",
    r.state === "running" && r.left_s >= 0 ? `${duration(r.left_s)} left` : "", r.where || "", r.note || ""].filter(Boolean).join(", ");
}

const digest = (tiles) => JSON.stringify(Object.entries(tiles).sort());

// How far all tiles are. Those that run at the same time end one after another; the last one counts.
function summary(rows) {
  const tiles = rows.filter((r) => r.stage === "train"), done = tiles.filter((r) => r.state === "done").length;
  const runs = tiles.filter((r) => r.state === "running"), left = Math.max(...runs.map((r) => r.left_s ?? -1), -1);
  if (!tiles.length) return [];
  const told = `${done} of ${tiles.length} tiles are trained${runs.length ? `, ${runs.length} in training` : ""}` +
    `${left >= 0 ? `, ${duration(left)} until ${runs.length > 1 ? "all of these are" : "this one is"} done` : ""}.`;
  return [element("p", { id: "trained" }, told)];
}

export function setUpTraining(app) {
  const { link, picture } = app, panel = byId("training"), curves = new Map(), drawn = new Map();
  let trained = null, state = null, asking = false;

  async function draw() {
    if (panel.hidden || !state) return;
    const rows = state.rows || [];
    panel.replaceChildren(
      element("h2", {}, "Jobs"), ...summary(rows),
      ...(rows.length ? rows.map((r) => element("div", {},
        element("strong", {}, `${[r.stage, r.item].filter(Boolean).join(" ")}: ${r.state}`),
        ...(r.state === "running" && r.total ? [element("progress", { max: r.total, value: r.done, title: `${r.stage} ${r.item}` })] : []),
        element("p", { className: "soft" }, describe(r)),
        ...(curves.has(r.item) ? [curves.get(r.item)] : []))) : [element("p", { className: "soft" }, "There is no plan yet.")]));
  }

  // Curves of the tiles: those in training each time, others once.
  async function refreshCurves() {
    if (asking) return;
    asking = true;
    const rows = (state?.rows || []).filter((r) => r.stage === "train" && r.state !== "waiting").slice(0, CURVES);
    for (const { item, state: now } of rows.sort((a, b) => (b.state === "running") - (a.state === "running"))) {
      if (now !== "running" && drawn.get(item) === now) continue;
      try {
        const { head } = await link.ask("tile", { name: item });
        curves.set(item, curve(head.curve.psnr, head.curve.step));
        drawn.set(item, now);
      } catch {
        // The plan no longer has this tile.
      }
    }
    asking = false;
    draw();
  }

  link.addEventListener("state", ({ detail }) => {
    state = detail.state;
    const now = digest(detail.trained);
    if (trained !== null && now !== trained) picture.refresh();
    trained = now;
    app.trained = detail.trained;
    draw();
    if (!panel.hidden) refreshCurves();
  });
  // The tiles as they were before the first picture was asked for: any that come later are drawn.
  return { id: "training", begin: (city) => (trained = digest(city.trained)), open: refreshCurves };
}
