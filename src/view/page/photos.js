// The photos: flies to where a photo was taken, and compares it with its render.
import { shortName } from "./light.js";
import { queueOf } from "./link.js";
import { byId, check, element, row, say, select } from "./ui.js";

// The mean difference of two pictures, and a picture of it.
function differ(photo, render) {
  const [w, h] = [photo.width, photo.height], pixels = [photo, render].map((bitmap) => {
    const canvas = new OffscreenCanvas(w, h), context = canvas.getContext("2d");
    context.drawImage(bitmap, 0, 0, w, h);
    return context.getImageData(0, 0, w, h);
  });
  let sum = 0;
  const [a, b] = pixels.map((p) => p.data);
  for (let i = 0; i < a.length; i += 4)
    for (let c = 0; c < 3; c++) {
      const d = Math.abs(a[i + c] - b[i + c]);
      sum += d * d;
      a[i + c] = Math.min(3 * d, 255);
    }
  return { image: pixels[0], psnr: 10 * Math.log10(255 * 255 / (sum / (3 * w * h) || 1e-9)) };
}

const CARDS = 1000; // at most

export function setUpPhotos(app) {
  const { camera, link, picture, stage } = app, panel = byId("photos");
  const shown = element("div"), list = element("div", { className: "grid" });
  const rest = element("p", { className: "soft", id: "photos-rest", hidden: true });
  let city = null, seen = null, chosen = null;

  const small = queueOf(8); // the server refuses a page that has more than 32 questions open
  const fetchPhoto = (name, width, display) => link.ask("photo", { ...display, name, width }).then(({ jpeg }) => jpeg);
  const image = (blob) => {
    const url = URL.createObjectURL(blob);
    return element("img", { src: url, alt: "", onload: () => URL.revokeObjectURL(url) });
  };

  function flyTo(view) {
    chosen = view;
    camera.flyToPose(view);
    app.compare(null);
    for (const node of list.children) node.setAttribute("aria-pressed", node.dataset.name === view.name);
    details(view);
  }
  app.flyToPhoto = (name) => {
    const view = city.views.find((v) => v.name === name);
    if (view) flyTo(view);
  };

  // Shows the photo as the second picture, when the camera is at its pose.
  async function beside() {
    const { display_view, look, exposure_ev } = picture.look; // the photo is shown as the render beside it is
    const view = chosen; // another may be chosen meanwhile
    const bitmap = await createImageBitmap(await fetchPhoto(view.name, 1600, { display_view, look, exposure_ev, straight: true }));
    if (view !== chosen) return bitmap.close();
    const { heading, pitch, roll } = app.geometry.anglesOf(view.rotation);
    picture.beside = null;
    stage.show(1, bitmap, {
      camera: { centre: [...view.centre], heading, pitch, roll, vfov: view.vfov_deg }, aspect: bitmap.width / bitmap.height,
    });
    bitmap.close();
    app.showDivider(true, "Render", "Photo");
  }

  async function error(view, box) {
    const photo = await createImageBitmap(await fetchPhoto(view.name, 480));
    // Both as city.yaml shows them, and through the photo's lens: no setting of the page changes the figure.
    const jpeg = await picture.thumb(view, { appearance: view.name, photo: view.name }, photo.width, photo.height, true);
    const render = await createImageBitmap(jpeg), { image: data, psnr } = differ(photo, render);
    const canvas = element("canvas", { width: data.width, height: data.height, className: "error" });
    canvas.getContext("2d").putImageData(data, 0, 0);
    box.replaceChildren(element("p", {}, `PSNR ${psnr.toFixed(1)} dB in its own light. Three times the difference:`), canvas);
  }

  async function transient(view, box) {
    const { jpeg } = await link.ask("transient", { name: view.name, width: 480 });
    box.replaceChildren(element("p", {}, "What training took for standing in this photo only; grey where there is nothing:"),
      Object.assign(image(jpeg), { className: "transient", alt: `Transients of ${view.name}` }));
  }

  function details(view) {
    const box = element("div"), tell = (e) => say(e.message, true);
    const when = view.time_s === undefined ? "" : new Date(view.time_s * 1000).toISOString().slice(0, 16).replace("T", " ");
    shown.replaceChildren(
      element("h2", {}, shortName(view.name)),
      element("p", { className: "soft" }, `${view.held_out ? "Held out: never trained on. " : ""}${when}`),
      element("div", { className: "row" },
        element("button", { id: "photo-light", onclick: () => app.setLight(view.name) }, "Its light"),
        ...(city.pixels ? [
          element("button", { id: "photo-beside", onclick: () => beside().catch(tell) }, "Beside its render"),
          element("button", { id: "photo-error", onclick: () => error(view, box).catch(tell) }, "Error")] : []),
        element("button", { id: "photo-transients", onclick: () => transient(view, box).catch(tell) }, "Transients"),
        element("button", { onclick: () => app.compare(null) }, "Render alone")), box);
  }

  function card(view) {
    const node = element("button", { className: "card", title: view.name, "aria-pressed": false },
      element("span", { className: "blank" }), element("span", {}, `${shortName(view.name)}${view.held_out ? " (held out)" : ""}`));
    node.dataset.name = view.name;
    node.addEventListener("click", () => flyTo(view));
    return node;
  }

  // When there are no photos, show renders instead.
  function draw(entries) {
    for (const { target, isIntersecting } of entries) {
      if (!isIntersecting) continue;
      seen.unobserve(target);
      const view = city.views.find((v) => v.name === target.dataset.name);
      const got = city.pixels ? small(() => fetchPhoto(view.name, 160))
        : picture.thumb(view, { appearance: view.held_out ? "" : view.name }, 96, Math.max(Math.round(96 / view.aspect), 8));
      got.then((jpeg) => target.firstChild.replaceWith(image(jpeg)), () => {});
    }
  }

  function fill(held) {
    const views = city.views.filter((view) => !held || view.held_out);
    seen?.disconnect();
    seen = new IntersectionObserver(draw, { root: panel });
    list.replaceChildren(...views.slice(0, CARDS).map(card));
    rest.hidden = views.length <= CARDS;
    rest.textContent = `The first ${CARDS} of ${views.length} are shown. "Fly to" has all of them.`;
    if (!panel.hidden) for (const node of list.children) seen.observe(node);
  }

  function begin(facts) {
    city = facts;
    const jump = select([["", "choose a photo"], ...city.views.map((v) => [v.name, shortName(v.name)])], "", (name) => name && app.flyToPhoto(name));
    panel.replaceChildren(
      shown, element("h2", {}, `${city.n_views} photos`),
      ...(city.n_views ? [] : [element("p", { className: "soft" }, "This city has no posed photos.")]),
      ...(city.views.length < city.n_views
        ? [element("p", { className: "soft" }, `The page knows ${city.views.length} of them, evenly chosen.`)] : []),
      ...(city.pixels ? [] : [element("p", { className: "soft" }, "The photos themselves were not kept; these are renders of their views.")]),
      row("Fly to", jump), check("Held out only", false, fill), list, rest);
    fill(false);
  }
  return { id: "photos", begin, open: () => fill(panel.querySelector("input[type=checkbox]")?.checked) };
}
