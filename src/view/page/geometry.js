// Vectors, cameras, and places on Earth. Axes: x east, y north, z up; cameras look along z, with y down.

export const RAD = Math.PI / 180;
export const add = (a, b) => [a[0] + b[0], a[1] + b[1], a[2] + b[2]];
export const sub = (a, b) => [a[0] - b[0], a[1] - b[1], a[2] - b[2]];
export const scale = (a, k) => [a[0] * k, a[1] * k, a[2] * k];
export const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
export const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
export const norm = (a) => Math.hypot(a[0], a[1], a[2]);
export const unit = (a) => scale(a, 1 / (norm(a) || 1));
export const clamp = (x, low, high) => Math.min(Math.max(x, low), high);
export const mix = (a, b, t) => a + (b - a) * t;

// Heading clockwise from north and pitch upwards, in degrees; roll clockwise as seen from behind the camera.
// Rows: the camera's right, down and forward.
export function rotationOf({ heading, pitch, roll = 0 }) {
  const h = heading * RAD, p = pitch * RAD, r = roll * RAD;
  const forward = [Math.sin(h) * Math.cos(p), Math.cos(h) * Math.cos(p), Math.sin(p)];
  const right = [Math.cos(h), -Math.sin(h), 0];
  const down = cross(forward, right);
  const x = add(scale(right, Math.cos(r)), scale(down, Math.sin(r)));
  const y = sub(scale(down, Math.cos(r)), scale(right, Math.sin(r)));
  return [...x, ...y, ...forward];
}

export function anglesOf(rotation) {
  const forward = rotation.slice(6, 9), right = rotation.slice(0, 3);
  const pitch = Math.asin(clamp(forward[2], -1, 1)) / RAD;
  const steep = Math.hypot(forward[0], forward[1]) < 1e-6;
  const heading = (steep ? Math.atan2(-right[1], right[0]) : Math.atan2(forward[0], forward[1])) / RAD;
  const level = rotationOf({ heading, pitch });
  const roll = Math.atan2(dot(right, level.slice(3, 6)), dot(right, level.slice(0, 3))) / RAD;
  return { heading: (heading + 360) % 360, pitch, roll };
}

const times = (q, k) => q.map((x) => k * x);

// The quaternion of a rotation, by the largest of its four parts.
function quaternionOf([a, b, c, d, e, f, g, h, i]) {
  const all = [[1 + a + e + i, h - f, c - g, d - b], [h - f, 1 + a - e - i, b + d, c + g],
    [c - g, b + d, 1 - a + e - i, f + h], [d - b, c + g, f + h, 1 - a - e + i]];
  const q = all[[1, 2, 3].reduce((most, k) => (all[k][k] > all[most][most] ? k : most), 0)];
  return times(q, 1 / Math.hypot(...q));
}

// From one rotation (t = 0) to another (t = 1) by the shorter way, at an even speed.
export function turnBetween(from, to, t) {
  const p = quaternionOf(from);
  let q = quaternionOf(to), cosine = p.reduce((sum, x, k) => sum + x * q[k], 0);
  if (cosine < 0) [q, cosine] = [times(q, -1), -cosine];
  const angle = Math.acos(Math.min(cosine, 1)), near = angle < 1e-5;
  const k = near ? 1 - t : Math.sin((1 - t) * angle), l = near ? t : Math.sin(t * angle);
  const sum = p.map((x, n) => k * x + l * q[n]), [w, x, y, z] = times(sum, 1 / Math.hypot(...sum));
  return [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y), 2 * (x * y + w * z), 1 - 2 * (x * x + z * z),
    2 * (y * z - w * x), 2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)];
}

// The pose of a photo's view, turned by quarters until it stands upright, as far as it does not look steeply down or up.
export function uprightPose(view) {
  const { heading, pitch, roll } = anglesOf(view.rotation), quarters = Math.abs(pitch) > 60 ? 0 : Math.round(roll / 90);
  const t = Math.tan(view.vfov_deg * RAD / 2) * (quarters % 2 ? view.aspect : 1);
  return { ...view, rotation: rotationOf({ heading, pitch, roll: roll - 90 * quarters }), vfov_deg: 2 * Math.atan(t) / RAD };
}

// The unit direction of a place in the picture: x and y from -1 (left, top) to 1.
export function rayOf(camera, aspect, x, y) {
  const t = Math.tan(camera.vfov * RAD / 2), r = rotationOf(camera), c = [x * t * aspect, y * t, 1];
  return unit([0, 1, 2].map((i) => r[i] * c[0] + r[3 + i] * c[1] + r[6 + i] * c[2]));
}

// Where a place is in the picture, as for rayOf; null behind the camera.
export function placeIn(camera, aspect, place) {
  const t = Math.tan(camera.vfov * RAD / 2), r = rotationOf(camera), v = sub(place, camera.centre);
  const [x, y, z] = [0, 3, 6].map((i) => dot(r.slice(i, i + 3), v));
  return z > 0 ? [x / z / t / aspect, y / z / t] : null;
}

// Converts local metres (east, north, up from the frame's origin) to WGS84 latitude, longitude and height.
const A = 6378137, F = 1 / 298.257223563, E2 = F * (2 - F);
function ecefOf(lat, lon, h) {
  const n = A / Math.sqrt(1 - E2 * Math.sin(lat) ** 2);
  return [(n + h) * Math.cos(lat) * Math.cos(lon), (n + h) * Math.cos(lat) * Math.sin(lon), (n * (1 - E2) + h) * Math.sin(lat)];
}
export function geodeticOf(frame, local) {
  const lat0 = frame.latitude_deg * RAD, lon0 = frame.longitude_deg * RAD;
  const [sl, cl, so, co] = [Math.sin(lat0), Math.cos(lat0), Math.sin(lon0), Math.cos(lon0)];
  const [e, n, u] = local;
  const p = add(ecefOf(lat0, lon0, frame.height_m),
    [-so * e - sl * co * n + cl * co * u, co * e - sl * so * n + cl * so * u, cl * n + sl * u]);
  const across = Math.hypot(p[0], p[1]);
  let lat = Math.atan2(p[2], across * (1 - E2)), h = 0;
  for (let i = 0; i < 6; i++) {
    const radius = A / Math.sqrt(1 - E2 * Math.sin(lat) ** 2);
    h = across / Math.cos(lat) - radius;
    lat = Math.atan2(p[2], across * (1 - E2 * radius / (radius + h)));
  }
  return { lat: lat / RAD, lon: Math.atan2(p[1], p[0]) / RAD, height: h };
}

export function placeText(frame, local) {
  if (!frame.georeferenced) return local.map((x) => x.toFixed(2)).join(", ");
  const g = geodeticOf(frame, local);
  return `${g.lat.toFixed(6)}°, ${g.lon.toFixed(6)}°, ${g.height.toFixed(1)} m`;
}
