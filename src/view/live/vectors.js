// Vectors of three numbers and the camera's axes. The world has z up; a camera looks along -z of its own axes, y up.
"use strict";

const add3 = (a, b, t = 1) => a.map((v, i) => v + t * b[i]);
const dot3 = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
const unit3 = (a) => a.map((v) => v / (Math.hypot(...a) || 1));
const clamp = (v, low, high) => Math.min(Math.max(v, low), high);
const radians = (degrees) => degrees * Math.PI / 180;

// right, up, forward of a heading (clockwise from north, which is y) and a pitch, in degrees.
function axesOf(heading, pitch) {
  const h = radians(heading), p = radians(pitch);
  const forward = [Math.sin(h) * Math.cos(p), Math.cos(h) * Math.cos(p), Math.sin(p)];
  const right = [Math.cos(h), -Math.sin(h), 0];
  const up = [-Math.sin(h) * Math.sin(p), -Math.cos(h) * Math.sin(p), Math.cos(p)];
  return { right, up, forward };
}

// heading and pitch of a direction.
function anglesOf(direction) {
  const [x, y, z] = unit3(direction);
  return { heading: Math.atan2(x, y) * 180 / Math.PI, pitch: Math.asin(clamp(z, -1, 1)) * 180 / Math.PI };
}
