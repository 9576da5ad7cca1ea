// The capture runs on a time line: a slider through the photos as they were taken, and a button for each run.
import { element, row } from "./ui.js";

const text = (s) => new Date(s * 1000).toISOString().slice(0, 16).replace("T", " ");

// setLight(a, b, t): the light of photo a, on its way to that of b.
export function timeControls(city, setLight) {
  const timed = city.views.filter((view) => view.time_s !== undefined && !view.held_out).sort((x, y) => x.time_s - y.time_s);
  if (timed.length < 2) return [];
  const line = element("input", { type: "range", min: 0, max: timed.length - 1, step: 0.05, value: 0 });
  const runs = [];
  timed.forEach((view, i) => {
    const last = runs.at(-1);
    if (last && (last.run ?? 0) === (view.run ?? 0)) last.to = i;
    else runs.push({ run: view.run, from: i, to: i });
  });
  // Between two photos of a run both lights are mixed. From run to run the light changes at once.
  function apply() {
    const i = Math.min(Math.floor(+line.value), timed.length - 1), next = timed[i + 1], t = +line.value - i;
    const on = next && (next.run ?? 0) === (timed[i].run ?? 0) && t > 0;
    setLight(timed[i].name, on ? next.name : "", on ? +t.toFixed(2) : 0);
    for (const node of bar.children) node.setAttribute("aria-pressed", i >= +node.dataset.from && i <= +node.dataset.to);
  }
  line.addEventListener("input", apply);
  const bar = element("div", { className: "runs", id: "runs" }, ...runs.map(({ from, to }, k) => {
    const node = element("button", { "aria-pressed": false, title: `${text(timed[from].time_s)} to ${text(timed[to].time_s)}, ${to - from + 1} photos` }, `Run ${k + 1}`);
    Object.assign(node.dataset, { from, to });
    node.style.flexGrow = to - from + 1;
    node.addEventListener("click", () => {
      line.value = (from + to) / 2 | 0;
      line.dispatchEvent(new Event("input"));
    });
    return node;
  }));
  const when = (v) => text(timed[Math.min(Math.floor(+v), timed.length - 1)].time_s);
  return [element("h2", {}, "By time of capture"), bar, Object.assign(row("Taken at", line, when), { className: "row wide-output" })];
}
