// Lights: of a photo, mixed, along the time of capture, compared side by side, and saved by name.
import { dropControls } from "./drop.js";
import { saver } from "./link.js";
import { timeControls } from "./times.js";
import { byId, element, row, say, select } from "./ui.js";

export const shortName = (name) => name.split("/").pop().replace(/\.[a-z0-9]+$/i, "");

const CARDS = 300; // at most

export function setUpLight(app) {
  const { link, picture } = app, panel = byId("light"), divider = byId("divider"), names = byId("divider-names");
  const saved = element("div", { className: "row" }), grid = element("div", { className: "grid lights" });
  let a = "", b = "", t = 0, more = [], lights = [], city = null, seen = null;

  // The light in the server's format: A, or A:B:t, and then the others with their shares.
  const mixed = () => [t > 0 && b && b !== a ? `${a || "mean"}:${b}:${t}` : a || "mean",
    ...more.filter(({ share }) => share > 0).map(({ light, share }) => `${light}:${share}`)].join(":");
  const text = (light) => (light === "" || light === "mean" ? "Mean" : shortName(light));

  function apply() {
    picture.setLook({ appearance: mixed() });
    for (const card of grid.children) card.setAttribute("aria-pressed", card.dataset.light === a);
    app.light = { a, b, t, more };
  }

  // The second picture: the same view with other settings. The divider is between the two.
  app.compare = (look, left, right) => {
    picture.setBeside(look);
    app.showDivider(!!look, left, right);
  };
  app.showDivider = (on, left = "", right = "") => {
    divider.hidden = names.hidden = !on;
    app.stage.split = on ? divider.value / 100 : null;
    names.children[0].textContent = left;
    names.children[1].textContent = right;
    app.stage.dirty = true;
  };
  divider.addEventListener("input", () => {
    app.stage.split = divider.value / 100;
    app.stage.dirty = true;
  });

  function card(light) {
    const node = element("button", { className: "card", title: light || "mean", "aria-pressed": light === a },
      element("span", { className: "blank" }), element("span", {}, text(light)));
    node.dataset.light = light;
    node.addEventListener("click", () => {
      a = light;
      selects[0].value = light;
      apply();
    });
    return node;
  }

  // Thumbnails of the current view in each light, one after another, only for visible list entries.
  function draw(entries) {
    for (const { target, isIntersecting } of entries) {
      if (!isIntersecting) continue;
      seen.unobserve(target);
      const pose = { ...app.camera.state(), rotation: app.geometry.rotationOf(app.camera.state()), vfov_deg: app.camera.vfov };
      picture.thumb(pose, { appearance: target.dataset.light }, 96, 72).then((jpeg) => {
        const url = URL.createObjectURL(jpeg);
        target.firstChild.replaceWith(element("img", { src: url, alt: "", onload: () => URL.revokeObjectURL(url) }));
      }, () => {});
    }
  }
  function redraw() {
    seen?.disconnect();
    seen = new IntersectionObserver(draw, { root: panel });
    for (const node of grid.children) seen.observe(node);
  }

  let selects = [];
  const options = () => lights.map((light) => [light, text(light)]);
  const slider = element("input", { type: "range", min: 0, max: 1, step: 0.01, value: 0 });
  slider.addEventListener("input", () => {
    t = +slider.value;
    apply();
  });

  // The lights of the mix after the first two, each with its share of the whole.
  const others = element("div"), MOST = 16;
  function drawOthers() {
    others.replaceChildren(...more.map((part, i) => {
      const share = element("input", { type: "range", min: 0, max: 1, step: 0.01, value: part.share });
      share.addEventListener("input", () => (part.share = +share.value, apply()));
      const choice = select(options(), part.light, (light) => (part.light = light, apply()));
      choice.setAttribute("aria-label", `Light ${i + 3} of the mix`);
      const away = element("button", { title: "Remove from the mix", onclick: () => (more.splice(i, 1), drawOthers(), apply()) }, "×");
      away.setAttribute("aria-label", `Remove light ${i + 3} from the mix`);
      return element("div", {}, element("div", { className: "row" }, choice, away), row(`Share of light ${i + 3}`, share, (v) => `${Math.round(v * 100)} %`));
    }));
  }
  function mixAnother() {
    const light = lights.find((one) => one !== a && one !== b && !more.some((part) => part.light === one));
    if (!light || more.length + 2 >= MOST) return say(`A mix has at most ${MOST} lights of this city.`, true);
    more.push({ light, share: 0.33 });
    drawOthers();
    apply();
  }

  // `rest`: the lights of the mix after the first two.
  function setLight(from, to, between, rest = more) {
    a = from;
    if (to) b = to;
    t = slider.value = between;
    more = rest;
    slider.dispatchEvent(new Event("shown"));
    drawOthers();
    for (const [node, light] of [[selects[0], a], [selects[1], b]]) {
      // Photos that are held out are no choice, but for those that were asked for.
      if (![...node.options].some((one) => one.value === light)) node.append(element("option", { value: light }, text(light)));
      node.value = light;
    }
    apply();
  }
  app.setLight = (light) => setLight(light, "", 0, []);
  app.setLights = (light) => setLight(light.a, light.b, light.t, light.more);

  // A light that was fitted to a photo just now; `show`: by this page.
  function addLight(light, show) {
    if (!lights.includes(light)) {
      lights.splice(1, 0, light);
      for (const node of selects) node.append(element("option", { value: light }, text(light)));
      grid.prepend(card(light));
      redraw();
    }
    if (show) setLight(light, "", 0);
    else apply();
  }

  async function list() {
    const { head } = await link.ask("list", { what: "light" });
    saved.replaceChildren(...head.names.map((name) => element("button", {
      onclick: () => link.ask("load", { what: "light", name }).then(({ head: { data } }) => {
        picture.setLook({ exposure_ev: data.exposure_ev ?? 0, display_view: data.display_view ?? "", look: data.look ?? "" });
        setLight(data.a || "mean", data.b, data.t ?? 0, data.more ?? []);
        field.value = name;
        files.loaded(name);
      }, (e) => say(e.message, true)),
    }, name)));
    if (!head.names.length) saved.textContent = "None yet.";
  }

  const files = saver(link, "light");
  function save() {
    const { exposure_ev, display_view, look } = picture.look, name = field.value.trim();
    files.save(name, { appearance: mixed(), a, b, t, more, exposure_ev, display_view, look })
      .then(() => (say(`Saved as ${name}.`), list()), (e) => say(e.message, true));
  }
  const field = element("input", { type: "text", placeholder: "name", maxLength: 64 });

  function begin(facts) {
    city = facts;
    lights = ["mean", ...city.named, ...city.views.filter((view) => !view.held_out).map((view) => view.name)];
    a = "mean";
    b = lights[Math.min(1, lights.length - 1)];
    selects = [select(options(), a, (value) => (a = value, apply())), select(options(), b, (value) => (b = value, apply()))];
    grid.replaceChildren(...lights.slice(0, CARDS).map(card));
    panel.replaceChildren(
      element("h2", {}, "Mix"), row("From", selects[0]), row("To", selects[1]), row("Between", slider, (v) => `${Math.round(v * 100)} %`),
      others, element("button", { id: "mix-another", onclick: mixAnother }, "Mix in another light"),
      element("div", { className: "row" },
        element("button", { id: "compare-lights", onclick: () => app.compare({ ...picture.look, appearance: b }, text(a), text(b)) }, "Side by side"),
        element("button", { onclick: () => app.compare(null) }, "One picture")),
      element("h2", {}, lights.length > CARDS ? `The first ${CARDS} of ${lights.length} lights, in this view` : "Every light, in this view"), grid, element("button", { onclick: redraw }, "Draw them again"),
      ...timeControls(city, setLight), ...dropControls(app, city, addLight),
      element("h2", {}, "Saved"), saved,
      element("div", { className: "row" }, field, element("button", { id: "save-light", onclick: save }, "Save this light")));
    field.setAttribute("aria-label", "Name of the light");
    list().catch(() => {});
  }
  return { id: "light", begin, open: redraw };
}
