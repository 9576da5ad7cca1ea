// The progress of the tiles. When a tile is trained again, the picture is requested again.
import { curve } from "./map.js";
import { byId, element } from "./ui.js";

const duration = (s) => (s < 90 ? `${Math.round(s)} s` : s < 5400 ? `${Math.round(s / 60)} min` : `${(s / 3600).toFixed(1)} h`);

function describe(r) {
  return [r.total ? `${Math.round(r.done)} of ${Math.round(r.total)}` : "", r.psnr ? `${r.psnr.toFixed(2)} dB` : "",
    r.samples_per_s ? `${(r.samples_per_s / 1e6).toFixed(2)} M samples/s` : "",
    r.state === "running" && r.left_s >= 0 ? `${duration(r.left_s)} left` : "", r.where || "", r.note || ""].filter(Boolean).join(", ");
}

export function setUpTraining(app) {
  const { link, picture } = app, panel = byId("training"), curves = new Map();
  let trained = null, state = null;

  async function draw() {
    if (panel.hidden || !state) return;
    const rows = state.rows || [];
    panel.replaceChildren(
      element("h2", {}, "Jobs"),
      ...(rows.length ? rows.map((r) => element("div", {},
        element("strong", {}, `${[r.stage, r.item].filter(Boolean).join(" ")}: ${r.state}`),
        ...(r.state === "running" && r.total ? [element("progress", { max: r.total, value: r.done, title: `${r.stage} ${r.item}` })] : []),
        element("p", { className: "soft" }, describe(r)),
        ...(curves.has(r.item) ? [curves.get(r.item)] : []))) : [element("p", { className: "soft" }, "There is no plan yet.")]));
  }

  // Curves of the tiles in training, or of the first few.
  async function refreshCurves() {
    const rows = (state?.rows || []).filter((r) => r.stage === "train");
    const some = rows.filter((r) => r.state === "running").concat(rows).slice(0, 4);
    for (const { item } of some) {
      try {
        const { head } = await link.ask("tile", { name: item });
        curves.set(item, curve(head.curve.psnr, head.curve.step));
      } catch {
        // The plan no longer has this tile.
      }
    }
    draw();
  }

  link.addEventListener("state", ({ detail }) => {
    state = detail.state;
    const now = JSON.stringify(detail.trained);
    if (trained !== null && now !== trained) picture.refresh();
    trained = now;
    app.trained = detail.trained;
    draw();
    if (!panel.hidden) refreshCurves();
  });
  return { id: "training", open: refreshCurves };
}
