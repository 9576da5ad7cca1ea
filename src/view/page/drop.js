// A photo that is dropped on the page: the server finds its pose and fits a light to it, which then has a name.
import { follow } from "./job.js";
import { element, say } from "./ui.js";

const MOST_BYTES = 32e6, TYPES = ["image/jpeg", "image/png"];
const nameOf = (file) => file.name.replace(/\.[^.]*$/, "").replace(/[^A-Za-z0-9_-]+/g, " ").trim().slice(0, 64) || "photo";

export function dropControls(app, city, onfitted) {
  const { link } = app, told = element("p", { role: "status", id: "fit-told" }), shown = element("div");
  const name = element("input", { type: "text", placeholder: "name", maxLength: 64, "aria-label": "Name of the photo's light" });
  const choose = element("input", { type: "file", accept: TYPES.join(","), id: "photo-file", "aria-label": "Photo to fit a light to" });
  const fit = element("button", { id: "fit-photo", disabled: true, onclick: () => send() }, "Fit its light");
  const stop = element("button", { hidden: true, onclick: () => link.send("film_stop") }, "Stop it");
  const about = city.pixels ? "Drop a photo of this place on the page, or choose one. COLMAP finds where it was taken; that can take minutes."
    : "The photos of this city are not here, so the place of another photo cannot be found.";
  let file = null, mine = null, latest = null;

  function take(dropped) {
    if (!dropped) return;
    if (!city.pixels) return say(about, true);
    if (!TYPES.includes(dropped.type)) return say("Give a JPEG or PNG file.", true);
    if (dropped.size > MOST_BYTES) return say("The photo has more than 32 MB; make it smaller.", true);
    say("");
    const url = URL.createObjectURL(dropped), photo = element("img", { src: url, alt: dropped.name });
    latest = dropped;
    fit.disabled = true;
    app.openTab((tab) => tab.id === "tab-light");
    // Shown and offered only when its size is known: a photo that appears moves the button below it.
    photo.decode().then(() => {
      if (latest !== dropped) return; // another was dropped meanwhile
      file = dropped;
      name.value = nameOf(file);
      shown.replaceChildren(photo);
      shown.scrollIntoView({ block: "nearest" });
      fit.disabled = false;
    }, () => {
      if (latest !== dropped) return;
      fit.disabled = !file;
      say(`${dropped.name} cannot be read as a picture; give a JPEG or PNG file.`, true);
    })
      .finally(() => URL.revokeObjectURL(url));
  }
  async function send() {
    mine = name.value.trim();
    told.textContent = "Sending the photo …";
    link.upload("fit", { name: mine }, await file.arrayBuffer()).catch((e) => {
      told.textContent = "";
      say(e.message, true);
    });
  }
  choose.addEventListener("change", () => take(choose.files[0]));
  follow(link, "fit", (detail) => {
    app.fit = detail;
    stop.hidden = detail.state !== "running";
    told.textContent = detail.state === "running" ? `Finding where ${detail.name} was taken, and its light …`
      : detail.state === "done" ? `${detail.name} is a light of this city now.` : `${detail.name}: ${detail.text || detail.state}`;
    if (detail.state === "done") onfitted(detail.name, detail.name === mine);
  });

  // An answer without a number: the message was thrown away before its head was read.
  link.addEventListener("failed", ({ detail }) => {
    if (!detail.id) told.textContent = "";
  });

  // The whole page takes a file, so that none is opened in place of the page.
  const files = (e) => [...(e.dataTransfer?.types || [])].includes("Files");
  for (const kind of ["dragover", "dragleave", "drop"])
    addEventListener(kind, (e) => {
      if (!files(e)) return;
      e.preventDefault();
      document.body.classList.toggle("dropping", kind === "dragover");
      if (kind === "drop") take(e.dataTransfer.files[0]);
    });
  const head = [element("h2", {}, "Light of another photo"), element("p", { className: "soft" }, about)];
  return city.pixels ? [...head, choose, shown, element("div", { className: "row" }, name, fit, stop), told] : head;
}
