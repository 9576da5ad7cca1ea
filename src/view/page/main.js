// Puts the page together.
import { addressOf, cameraIn, settingsIn } from "./address.js";
import { Camera } from "./camera.js";
import { add, anglesOf, norm, placeIn, placeText, rayOf, rotationOf, scale, sub, uprightPose } from "./geometry.js";
import { Link } from "./link.js";
import { Picture } from "./picture.js";
import { Stage } from "./stage.js";
import { byId, group, say, tabs } from "./ui.js";
import { setUpJob } from "./job.js";
import { setUpLight } from "./light.js";
import { setUpLook } from "./look.js";
import { setUpMap } from "./map.js";
import { setUpMeasure } from "./measure.js";
import { setUpPath } from "./path.js";
import { setUpPhotos } from "./photos.js";
import { setUpTraining } from "./training.js";

const canvas = byId("view");
const app = { city: null };

const NO_LIGHT = { a: "mean", b: "", t: 0, more: [] };
const FIRST_MS = 1000; // without a picture, until a page that begins says what it waits for

function linkView() {
  history.replaceState(null, "", addressOf(app.camera, app.picture.look, app.light ?? NO_LIGHT));
}

// Sets the light and the other settings of an address.
function takeSettings(hash) {
  const { look, crop, light, unknown } = settingsIn(hash, app.city);
  app.picture.setLook(look);
  app.setCrop(crop);
  app.setLights(light);
  if (unknown.length) say(`The address asks for ${unknown.join(", ")}, which this city does not have.`, true);
}

// What the panels list, and what tells one city from another.
const digestOf = ({ tiles, views }) => JSON.stringify([tiles, views]);

// A server of another city has taken the address of the last one. Only a page that begins anew shows it right; an
// address has a view of the old city. Where the city has only a new plan, an unsaved path stays until the visitor reloads.
function changed(city) {
  if (city.name === app.city.name) {
    if (digestOf(city) !== digestOf(app.city)) say("The city has a new plan or other photos now. Reload this page.", true, true);
    return false;
  }
  history.replaceState(null, "", location.pathname + location.search);
  location.reload();
  return true;
}

function begin(city) {
  if (app.city && changed(city)) return;
  const first = !app.city, hash = location.hash, linked = cameraIn(hash);
  app.city = city;
  document.title = `${city.name} – Conurb`;
  byId("city-name").textContent = city.name;
  app.camera.metric = city.frame.georeferenced;
  app.camera.reach = Math.max(...city.tiles.map((tile) => tile.radius_m), 1) / 3;
  if (first && linked) app.camera.set(linked);
  else if (first && city.views.length) app.camera.setPose(uprightPose(city.views[0]));
  app.picture.ready = true;
  app.picture.refresh();
  if (!first) return;
  performance.mark("conurb city");
  // The first picture is asked for already: the server makes it while the rest is set up here.
  try {
    app.stage.setUp();
  } catch (error) {
    return sayBlack(error.message);
  }
  performance.mark("conurb drawing");
  for (const panel of app.panels) panel.begin?.(city);
  if (hash.includes("&")) takeSettings(hash);
  setTimeout(() => app.shown || sayBlack("The server renders the first picture."), FIRST_MS);
}

function readout() {
  const { camera, city } = app;
  if (!city) return;
  byId("place").textContent = `Camera ${placeText(city.frame, camera.centre)}`;
  byId("needle").setAttribute("transform", `rotate(${-camera.heading})`);
  byId("north").setAttribute("transform", `rotate(${camera.heading} 0 -11)`); // upright: an N on its side is a Z
  byId("compass").setAttribute("aria-label", `Look north; now ${Math.round(camera.heading)} degrees`);
}

// Says why the picture is black; "": it is not.
function sayBlack(why) {
  byId("empty").hidden = !why;
  byId("empty").textContent = why;
}
function sayEmpty(tile) {
  const none = !Object.keys(app.trained ?? app.city.trained).length;
  sayBlack(tile ? "" : none ? "No tile of this city is trained yet. The first one appears here by itself, while it trains."
    : "No trained tile is in reach of this view.");
}

// Told again when the picture changes under a cursor that rests.
function under() {
  const { camera, city, cursor } = app, depth = cursor ? camera.depthAt(...cursor) : 0;
  const [x, y] = cursor || [0, 0];
  const place = add(camera.centre, scale(rayOf(camera, camera.aspect, x, y), depth));
  byId("under").textContent = city && depth ? `Under the cursor ${placeText(city.frame, place)} (${depth.toFixed(1)} ${city.frame.unit} away)` : "";
}

// While walking, the camera keeps its height above the surface below.
async function stand(first = false) {
  const { camera, picture } = app;
  if (camera.mode !== "walk" || app.standing) return;
  app.standing = true;
  const centre = add(camera.centre, [0, 0, camera.reach / 10]);
  try {
    const depth = await picture.probe({ centre, heading: 0, pitch: -90, roll: 0, vfov: 1 });
    if (depth && camera.mode === "walk") camera.stand(centre[2] - depth, first);
  } catch {
    // The next step sends the request again.
  }
  app.standing = false;
}

let before = performance.now();
function loop(now) {
  const { camera, picture, stage } = app;
  if (camera.step(Math.min((now - before) / 1000, 0.1)) && camera.mode === "walk") stand();
  before = now;
  if (stage.resize()) picture.move();
  if (stage.gl && stage.dirty) {
    stage.draw(camera.state(), camera.aspect, camera.reach);
    readout();
  }
  requestAnimationFrame(loop);
}

function start() {
  performance.mark("conurb files");
  const link = app.link = new Link(), stage = app.stage = new Stage(canvas);
  const camera = app.camera = new Camera(canvas), picture = app.picture = new Picture(link, camera, stage);
  camera.depthAt = (x, y) => stage.depthAt(camera, camera.aspect, x, y);
  camera.addEventListener("step", () => stand());
  camera.addEventListener("home", () => app.city?.views.length && camera.flyToPose(uprightPose(app.city.views[0])));
  link.addEventListener("open", () => link.ask("city").then(({ head }) => {
    if (app.lost) say("");
    app.lost = false;
    begin(head);
  }).catch((e) => app.lost || say(e.message, true)));
  link.addEventListener("closed", ({ detail }) => {
    app.lost = true;
    say(detail || "The connection to the server was lost; trying again.", true, true);
  });
  picture.addEventListener("failed", (e) => say(e.detail, true));
  picture.addEventListener("shown", ({ detail: { head, asked, took } }) => {
    const rate = picture.rate();
    if (asked.slot === 0) {
      if (!app.shown) performance.mark("conurb picture");
      app.shown = { ...head, moving: asked.moving };
      if (head.last && !asked.moving) linkView();
      sayEmpty(head.tile);
      under();
    }
    byId("speed").textContent = asked.moving && rate ? `${rate.toFixed(1)} pictures/s, ${head.width} px`
      : `${head.width} × ${head.height}${head.last ? "" : " …"}, ${Math.round(took)} ms${head.tile ? `, tile ${head.tile}` : ""}`;
  });
  canvas.addEventListener("webglcontextrestored", () => {
    stage.setUp();
    if (!picture.beside) app.showDivider(false); // a photo was there
    picture.refresh();
  });
  // As when an address is pasted that has a view; the page's own changes of it are not told here.
  addEventListener("hashchange", () => {
    const linked = cameraIn(location.hash);
    if (!linked || !app.city) return;
    takeSettings(location.hash);
    camera.flyTo(linked);
  });
  canvas.addEventListener("pointermove", (e) => (app.cursor = camera.inPicture(e), under()));
  canvas.addEventListener("pointerleave", () => (app.cursor = null, under()));
  byId("compass").addEventListener("click", () => camera.flyTo({ ...camera.state(), heading: 0, roll: 0 }));
  group(byId("modes"), "aria-checked", (button) => {
    camera.mode = button.dataset.mode;
    document.body.classList.toggle("moving-by-buttons", camera.mode !== "orbit");
    document.body.classList.toggle("walking", camera.mode === "walk");
    camera.target = null;
    stand(true);
  });
  byId("panel-toggle").addEventListener("click", (e) => {
    const hidden = document.body.classList.toggle("wide");
    e.currentTarget.setAttribute("aria-expanded", !hidden);
  });
  app.openTab = tabs((id) => app.panels.find((panel) => panel.id === id)?.open?.());
  app.panels = [setUpLook, setUpMeasure, setUpLight, setUpPhotos, setUpMap, setUpPath, setUpJob, setUpTraining].map((setUp) => setUp(app));
  requestAnimationFrame(loop);
}

// For the browser tests and for debugging in the console.
globalThis.conurb = Object.assign(app, { geometry: { anglesOf, norm, placeIn, rotationOf, sub, uprightPose } });
try {
  start();
} catch (error) {
  say(error.message, true);
}
