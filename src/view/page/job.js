// What the server makes at length, a film or a light of a photo: shown over the picture, whichever panel is open.
import { byId, duration } from "./ui.js";

const FRAME_EVERY_MS = 1500; // the newest picture of a film is fetched at most this often

// Passes on reports of a film or a fit. The server repeats the last one to a page that connects: the end of a job that this
// page did not see run is not news.
export function follow(link, type, take) {
  let running = "";
  link.addEventListener(type, ({ detail }) => {
    const runs = detail.state === "running", seen = runs || running === detail.name;
    running = runs ? detail.name : "";
    if (seen) take(detail);
  });
}

export function setUpJob(app) {
  const { link } = app, box = byId("job"), told = byId("job-told"), bar = byId("job-bar"), frame = byId("job-frame");
  const stop = byId("job-stop"), away = byId("job-away"), show = byId("job-show");
  let at = 0, fetching = false, running = false;

  stop.addEventListener("click", () => link.send("film_stop"));
  away.addEventListener("click", () => (box.hidden = true));
  show.addEventListener("click", () => {
    app.openTab((tab) => tab.id === "tab-path");
    byId("film").scrollIntoView({ block: "nearest" });
  });

  // The newest picture of the film. There may be none yet, and then none is shown.
  async function showFrame(name, n) {
    if (fetching || !n || performance.now() - at < FRAME_EVERY_MS) return;
    fetching = true;
    try {
      const { tail } = await link.ask("film_show", { name, frame: n });
      const url = URL.createObjectURL(new Blob([tail], { type: "image/png" }));
      frame.onload = () => URL.revokeObjectURL(url);
      frame.src = url;
      frame.hidden = false;
      app.jobFrame = n;
    } catch {
      // The next report asks again.
    }
    at = performance.now();
    fetching = false;
  }

  function text(type, d) {
    const what = type === "film" ? `Film ${d.name}` : `Light of ${d.name}`;
    if (d.state === "running" && !d.total) return `${what}: it begins`;
    if (d.state !== "running") return `${what}: ${d.state === "done" ? "done" : d.text || d.state}`;
    const left = d.left_s >= 0 ? `, ${duration(d.left_s)} left` : "";
    return type === "film" ? `${what}: ${Math.round(d.done)} of ${Math.round(d.total)} frames${left}`
      : `${what}: ${Math.round(100 * d.done / d.total)} %${left}`;
  }

  function take(type, d) {
    const runs = running = d.state === "running";
    box.hidden = false;
    box.classList.toggle("bad", d.state === "failed");
    stop.hidden = !runs;
    away.hidden = runs;
    show.hidden = type !== "film" || !d.film;
    bar.hidden = !runs;
    told.textContent = text(type, d);
    if (d.total) bar.value = d.done / d.total;
    else bar.removeAttribute("value");
    if (type === "film" && runs) showFrame(d.name, Math.floor(d.done || 0));
    else frame.hidden = true;
  }
  for (const type of ["film", "fit"]) follow(link, type, (detail) => take(type, detail));
  // What runs is said again by a server that still makes it.
  link.addEventListener("open", () => (box.hidden ||= running));
  return { id: "job" };
}
