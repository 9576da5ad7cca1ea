// The address has the view, its light and its settings, so that it can be kept and passed on, and a reload comes back to it.
// "#x,y,z,heading,pitch,roll,vfov", then "&key=value" for each setting that is not as it was at first.
import { clamp } from "./geometry.js";
import { CHANNELS } from "./look.js";

const PLAIN = { channel: "colour", blend: "", display_view: "", look: "", exposure_ev: 0, name: "" };
const MOST_EV = 6; // as the slider has it

export function cameraIn(hash) {
  const n = hash.slice(1).split("&")[0].split(",").map(Number);
  if (n.length !== 7 || !n.every(Number.isFinite) || n[6] < 1 || n[6] > 170) return null;
  return { centre: n.slice(0, 3), heading: n[3], pitch: n[4], roll: n[5], vfov: n[6] };
}

const short = (list) => list.map((x) => +x.toFixed(3)).join(",");

// light: {a, b, t, more} of the panel of lights.
export function addressOf({ centre, heading, pitch, roll, vfov }, look, { a, b, t, more }) {
  const settings = new URLSearchParams(), mixes = t > 0 && b && b !== a, others = more.filter(({ share }) => share > 0);
  for (const [key, plain] of Object.entries(PLAIN)) if ((look[key] ?? plain) !== plain) settings.set(key, look[key]);
  if (look.crop) settings.set("crop", short(look.crop));
  if ((a || "mean") !== "mean" || mixes || others.length) settings.set("light", a || "mean");
  if (mixes) settings.set("to", b), settings.set("between", t);
  for (const { light, share } of others) settings.append("mix", `${share} ${light}`);
  return `#${short([...centre, heading, pitch, roll, vfov])}${`&${settings}`.replace(/&$/, "")}`;
}

function cropIn(text) {
  const n = (text || "").split(",").map(Number);
  return n.length === 6 && n.every(Number.isFinite) && [0, 1, 2].every((i) => n[i] <= n[i + 3]) ? n : null;
}

// {look, crop, light, unknown}: the last are names that this city does not have; they are left out.
export function settingsIn(hash, city) {
  const given = new URLSearchParams(hash.split("&").slice(1).join("&")), look = { ...PLAIN }, unknown = [];
  const known = { channel: CHANNELS.map(([name]) => name), blend: city.blends, display_view: city.display_views, look: city.looks,
    name: city.tiles.map(({ id }) => id) };
  const lights = ["mean", ...city.named, ...city.views.map(({ name }) => name)];
  const take = (name, names) => (names.includes(name) ? name : (unknown.push(name), ""));
  for (const [key, names] of Object.entries(known)) if (given.has(key)) look[key] = take(given.get(key), names) || PLAIN[key];
  look.exposure_ev = clamp(Number(given.get("exposure_ev")) || 0, -MOST_EV, MOST_EV);
  const share = (text) => clamp(Number(text) || 0, 0, 1);
  const more = given.getAll("mix").map((text) => text.match(/^(\S+) (.*)$/s) || []).filter(([all]) => all)
    .map(([, part, light]) => ({ light: take(light, lights), share: share(part) })).filter(({ light }) => light);
  const a = take(given.get("light") ?? "mean", lights) || "mean", b = given.has("to") ? take(given.get("to"), lights) : "";
  return { look, crop: cropIn(given.get("crop")), light: { a, b, t: b ? share(given.get("between")) : 0, more }, unknown };
}
