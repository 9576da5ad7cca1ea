// A camera path: keyframes on a time line. It is played here, saved for `conurb render --path`, and rendered.
import { anglesOf, clamp, mix, norm, rotationOf, scale, add, sub, turnBetween } from "./geometry.js";
import { follow } from "./job.js";
import { saver } from "./link.js";
import { coloured, frustum } from "./look.js";
import { makeTrack } from "./track.js";
import { byId, calm, check, element, row, say, select } from "./ui.js";

const STEP_S = 3; // between keyframes when they are set
const PIECES = 16; // of the line that is drawn from one keyframe to the next

// Centripetal Catmull-Rom. This and stateAt are as path/spline.c has them, which makes the film.
function between(a, b, c, d, t) {
  const gap = (p, q) => Math.sqrt(norm(sub(q, p))), step = gap(b, c);
  if (!step) return [...b];
  const other = (s) => (s < 1e-6 * step ? step : s); // where neighbours are at one place, any positive one works
  const t1 = other(gap(a, b)), t2 = t1 + step, t3 = t2 + other(gap(c, d)), u = mix(t1, t2, t);
  const on = (p, q, from, to) => add(scale(p, (to - u) / (to - from)), scale(q, (u - from) / (to - from)));
  const ab = on(a, b, 0, t1), bc = on(b, c, t1, t2), cd = on(c, d, t2, t3);
  return on(on(ab, bc, 0, t2), on(bc, cd, t1, t3), t1, t2);
}
const mirror = (p, q) => sub(scale(p, 2), q);

export function stateAt(keys, time) {
  if (keys.length === 1) return keys[0].state;
  const j = clamp(keys.findLastIndex((key) => key.time <= time), 0, keys.length - 2), a = keys[j], b = keys[j + 1];
  const t = clamp((time - a.time) / (b.time - a.time || 1), 0, 1);
  const before = keys[j - 1]?.state.centre ?? mirror(a.state.centre, b.state.centre);
  const after = keys[j + 2]?.state.centre ?? mirror(b.state.centre, a.state.centre);
  const angles = anglesOf(turnBetween(rotationOf(a.state), rotationOf(b.state), t));
  return { ...angles, centre: between(before, a.state.centre, b.state.centre, after, t), vfov: mix(a.state.vfov, b.state.vfov, t * t * (3 - 2 * t)) };
}

export const toFile = (keys, fps) => ({
  fps,
  keyframes: keys.map(({ time, state }) => ({
    time_s: +time.toFixed(3), local: state.centre, heading_deg: state.heading, pitch_deg: clamp(state.pitch, -89.9, 89.9),
    roll_deg: state.roll, vfov_deg: state.vfov,
  })),
});
export function fromFile(data) {
  let vfov = 60;
  return data.keyframes.map((k) => {
    if (!k.local || k.look_at) throw new Error("this path was not made here; render it by conurb render --path");
    vfov = k.vfov_deg ?? vfov;
    return { time: k.time_s ?? 0, state: { centre: k.local, heading: k.heading_deg ?? 0, pitch: k.pitch_deg ?? 0, roll: k.roll_deg ?? 0, vfov } };
  });
}

export function setUpPath(app) {
  const { camera, link, picture, stage } = app, panel = byId("path"), list = element("ol", { className: "keys" });
  const line = element("input", { type: "range", min: 0, max: 1, step: 0.01, value: 0, disabled: true });
  const name = element("input", { type: "text", placeholder: "name", maxLength: 64 });
  const fps = select([["24", "24"], ["25", "25"], ["30", "30"], ["60", "60"]], "24", () => {});
  const length = element("input", { type: "number", min: 0.1, step: 0.5, value: 0, disabled: true });
  const width = select([["160", "160 px, a quick look"], ["320", "320 px"], ["640", "640 px"], ["1280", "1280 px"], ["1920", "1920 px"]], "640", () => {});
  const told = element("p", { role: "status" }), load = element("div", { className: "row" });
  let keys = [], before = null, playing = 0, drawIt = true;
  name.setAttribute("aria-label", "Name of the path");
  app.route = () => keys.map((k) => k.state.centre);
  app.path = { keys: () => keys, stateAt };

  // Before keyframes go: Undo brings them back, and a second time takes them away again.
  const remember = () => {
    before = keys.map((key) => ({ ...key }));
    undo.disabled = false;
  };
  const undo = element("button", { id: "undo-path", disabled: true, title: "Bring back keyframes that were deleted, cleared, set or replaced",
    onclick: () => {
      const back = before;
      remember();
      keys = back;
      saved.loaded(""); // a path that was loaded meanwhile is not replaced unasked
      draw();
    } }, "Undo");

  const go = (time) => {
    if (!keys.length) return;
    camera.set(stateAt(keys, time));
    track.at(time);
  };
  line.addEventListener("input", () => go(+line.value));
  const track = makeTrack({ keys: () => keys, moved: () => draw(), chosen: (key) => (camera.flyTo(key.state), track.at(key.time)) });

  // The whole path becomes longer or shorter.
  length.addEventListener("change", () => {
    const k = Math.max(+length.value || 0, 0.1) / (keys.at(-1)?.time || 1);
    for (const key of keys) key.time = Math.round(1000 * k * key.time) / 1000;
    draw();
  });

  // The camera's way and its keyframes in the picture, but for while it is played. The frusta are a little wide: that of
  // the present view is then beyond the edges.
  function mark() {
    if (!drawIt || playing || !keys.length) return stage.unmark("path");
    const end = keys.at(-1).time, n = PIECES * (keys.length - 1), at = (i) => stateAt(keys, end * i / n).centre;
    const way = Array.from({ length: n }, (_, i) => [at(i), at(i + 1)]).flat();
    const views = keys.flatMap(({ state }) => frustum({ centre: state.centre, rotation: rotationOf(state), vfov_deg: state.vfov + 2, aspect: camera.aspect }, camera.reach / 10));
    stage.mark("path", "LINES", coloured([...way, ...views], [1, 0.45, 0.2]), 0.9);
  }

  function draw() {
    keys.sort((a, b) => a.time - b.time);
    line.max = keys.length ? keys[keys.length - 1].time : 1;
    line.disabled = length.disabled = keys.length < 2;
    length.value = keys.at(-1)?.time ?? 0;
    track.draw();
    mark();
    list.replaceChildren(...keys.map((key, i) => {
      const time = element("input", { type: "number", min: 0, step: 0.5, value: key.time });
      time.setAttribute("aria-label", `Seconds of keyframe ${i + 1}`);
      time.addEventListener("change", () => {
        key.time = Math.max(+time.value || 0, 0);
        draw();
      });
      return element("li", {}, element("span", { className: "grow" }, `${i + 1}`), time, "s",
        element("button", { onclick: () => camera.flyTo(key.state) }, "Go"),
        element("button", { title: "Take the camera as it is now", onclick: () => (remember(), key.state = camera.state(), draw()) }, "Set"),
        element("button", { title: "Delete", "aria-label": `Delete keyframe ${i + 1}`, onclick: () => (remember(), keys.splice(keys.indexOf(key), 1), draw()) }, "×"));
    }));
  }

  function play() {
    if (playing) return ended(cancelAnimationFrame(playing));
    if (keys.length < 2) return say("Set two keyframes first.", true);
    const begin = performance.now() - 1000 * (+line.value < +line.max ? +line.value : 0);
    button.textContent = "Stop";
    const step = (now) => {
      const time = (now - begin) / 1000;
      line.value = time;
      line.dispatchEvent(new Event("shown"));
      go(Math.min(time, +line.max));
      if (time < +line.max) playing = requestAnimationFrame(step);
      else ended();
    };
    playing = requestAnimationFrame(step);
    mark();
  }
  function ended() {
    playing = 0;
    button.textContent = "Play";
    mark();
  }
  const button = element("button", { id: "play", onclick: play }, "Play");

  const saved = saver(link, "path");
  const save = async () => keys.length ? saved.save(name.value.trim(), toFile(keys, +fps.value)).then(refresh)
    : Promise.reject(new Error("Add a view to the path first."));
  async function refresh() {
    const { head } = await link.ask("list", { what: "path" });
    load.replaceChildren(...head.names.map((one) => element("button", {
      onclick: () => link.ask("load", { what: "path", name: one }).then(({ head: { data } }) => {
        const loaded = fromFile(data);
        if (keys.length) remember();
        keys = loaded;
        name.value = one;
        saved.loaded(one);
        if ([...fps.options].some((o) => +o.value === data.fps)) fps.value = data.fps;
        draw();
      }).catch((e) => say(e.message, true)),
    }, one)));
  }
  const tell = (e) => say(e.message, true);

  async function film() {
    await save();
    const { appearance, display_view, look, exposure_ev, blend, crop } = picture.look;
    const id = link.send("film", { name: name.value.trim(), width: +width.value, appearance, display_view, look, exposure_ev, blend, crop });
    link.waiting.set(id, { yes: () => {}, no: tell });
  }
  follow(link, "film", (detail) => {
    app.film = detail;
    told.textContent = detail.state === "running" ? `Rendering ${detail.name}; its progress is over the picture.` : detail.state === "done" ? `Done: ${detail.folder}${detail.film ? "/flight.mp4" : ""}` : `${detail.name}: ${detail.text || detail.state}`;
    if (detail.film) showFilm(detail.name).catch(tell);
  });
  const screen = element("div", { id: "film" }), whole = element("p", { className: "soft", id: "film-whole", hidden: true });
  picture.addEventListener("look", () => {
    whole.hidden = !picture.look.name;
    whole.textContent = `The film is made of all tiles, not only of ${picture.look.name}.`;
  });

  // The film plays in the page. One that is too long for that stays where it is told to be.
  async function showFilm(one) {
    const { tail } = await link.ask("film_show", { name: one });
    const url = URL.createObjectURL(new Blob([tail], { type: "video/mp4" }));
    if (screen.firstChild) URL.revokeObjectURL(screen.firstChild.src);
    screen.replaceChildren(element("video", { src: url, controls: true, muted: true, loop: true, autoplay: !calm(), "aria-label": `The film of ${one}` }));
  }

  function begin() {
    panel.replaceChildren(
      element("h2", {}, "Keyframes"), list,
      element("div", { className: "row" },
        element("button", { id: "add-key", onclick: () => {
          keys.push({ time: keys.length ? keys[keys.length - 1].time + STEP_S : 0, state: camera.state() });
          draw();
        } }, "Add this view"), button,
        element("button", { onclick: () => (remember(), (keys = []), draw()) }, "Clear"), undo),
      element("button", { id: "close-path", title: "Ends where it began", onclick: () => {
        if (keys.length < 2) return say("Set two keyframes first.", true);
        keys.push({ time: keys.at(-1).time + STEP_S, state: { ...keys[0].state } });
        draw();
      } }, "Back to the first"),
      track.node, row("Time line", line, (v) => `${(+v).toFixed(1)} s`), row("Length, s", length),
      check("Draw the path in the picture", true, (on) => ((drawIt = on), mark())),
      element("h2", {}, "Save and load"),
      element("div", { className: "row" }, name, element("button", { id: "save-path", onclick: () => save().then(() => say("Saved."), tell) }, "Save")),
      load,
      element("p", { className: "soft" }, "Saved paths are in views/paths of the city; conurb render --path takes them."),
      element("h2", {}, "Film"), row("Width", width), row("Pictures/s", fps),
      element("div", { className: "row" }, element("button", { id: "render-path", onclick: () => film().catch(tell) }, "Render this path"),
        element("button", { id: "show-film", onclick: () => showFilm(name.value.trim()).catch(tell) }, "Show its film")),
      whole,
      told, screen);
    draw();
    refresh().catch(() => {});
  }
  return { id: "path", begin };
}
