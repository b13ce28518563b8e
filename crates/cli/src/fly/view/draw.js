"use strict";
// How a flight is drawn: pure pictures of what the page knows, no state but the canvas.

/** Colours of the style sheet, light or dark as the page is now. */
function palette() {
  const style = getComputedStyle(document.documentElement);
  const colour = (name) => style.getPropertyValue("--" + name).trim();
  const names = ["paper", "ink", "faint", "rule", "bad", "trail", "committed", "plan", "goal", "path", "wall"];
  return Object.fromEntries(names.map((name) => [name, colour(name)]));
}

/** A canvas as large as it is shown, ready to draw on in CSS pixels. */
function sheet(canvas) {
  const { width, height } = canvas.getBoundingClientRect();
  const ratio = window.devicePixelRatio || 1;
  const [w, h] = [Math.round(width * ratio), Math.round(height * ratio)];
  if (canvas.width !== w || canvas.height !== h) {
    canvas.width = w;
    canvas.height = h;
  }
  const pen = canvas.getContext("2d");
  pen.setTransform(ratio, 0, 0, ratio, 0, 0);
  pen.clearRect(0, 0, width, height);
  pen.font = "12px system-ui, sans-serif";
  pen.lineJoin = "round";
  return { pen, width, height };
}

/** Room for the numbers of the axes. px */
const LEFT_PX = 42;
const BELOW_PX = 18;

/** A wall of the room is in the picture if it is at most so far from what flies. m */
const WALL_NEAR_M = 1;

/** Lower and upper end of what must be visible along each axis: reference path, track, plan, near walls. m */
function extent(briefing, facts, trail) {
  const points = [...briefing.path, ...briefing.targets, ...trail, ...facts.committed, ...facts.plan];
  const spots = [facts.estimate, facts.measured].filter((spot) => spot !== null);
  points.push(...spots.map((spot) => [spot.x, spot.y, spot.z]));
  return [0, 1, 2].map((axis) => {
    const values = points.map((point) => point[axis]);
    let [low, high] = [Math.min(...values), Math.max(...values)];
    if (axis === 2) {
      low = Math.min(low, 0);
    }
    const margin = Math.max(0.2, 0.05 * (high - low));
    const walls = briefing.room === null ? [] : briefing.room.map((corner) => corner[axis]);
    const near = walls.filter((wall) => wall > low - WALL_NEAR_M && wall < high + WALL_NEAR_M);
    const low_end = Math.min(low - (axis === 2 ? 0.1 : margin), ...near.map((wall) => wall - 0.05));
    return [low_end, Math.max(high + margin, ...near.map((wall) => wall + 0.05))];
  });
}

/** From metres to pixels, equal along both axes, `across` to the right and `up` upwards, below `top` px. */
function scaleOf({ width, height }, ends, across, up, top) {
  const [[left, right], [low, high]] = [ends[across], ends[up]];
  const [w, h] = [width - LEFT_PX - 6, height - BELOW_PX - top - 6];
  const px = Math.max(1, Math.min(w / (right - left), h / (high - low)));
  const [midX, midY] = [(left + right) / 2, (low + high) / 2];
  return {
    px,
    x: (value) => LEFT_PX + w / 2 + (value - midX) * px,
    y: (value) => top + 3 + h / 2 - (value - midY) * px,
    of(point) {
      return [this.x(point[across]), this.y(point[up])];
    },
  };
}

function line(pen, points, colour, width, dash = []) {
  if (points.length < 2) {
    return;
  }
  pen.strokeStyle = colour;
  pen.lineWidth = width;
  pen.setLineDash(dash);
  pen.beginPath();
  points.forEach(([x, y], k) => (k === 0 ? pen.moveTo(x, y) : pen.lineTo(x, y)));
  pen.stroke();
  pen.setLineDash([]);
}

/** A number with a minus sign as wide as its digits; zero has none. */
const number = (value, digits) => {
  const size = Math.abs(value).toFixed(digits);
  return value < 0 && Number(size) > 0 ? "\u2212" + size : size;
};

/** Lines a round distance apart, with their numbers. */
function grid({ pen, width, height }, scale, colours) {
  const step = [0.25, 0.5, 1, 2, 5, 10].find((size) => size * scale.px >= 45) || 20;
  pen.fillStyle = colours.faint;
  const digits = step === 0.25 ? 2 : step < 1 ? 1 : 0;
  const [bottom, zeroX, zeroY] = [height - BELOW_PX, scale.x(0), scale.y(0)];
  const stepPx = step * scale.px;
  pen.textAlign = "center";
  pen.textBaseline = "bottom";
  for (let k = Math.ceil((LEFT_PX - zeroX) / stepPx); zeroX + k * stepPx < width; k += 1) {
    const x = zeroX + k * stepPx;
    line(pen, [[x, 0], [x, bottom]], colours.rule, k === 0 ? 1.5 : 0.5);
    const text = number(k * step, digits);
    if (x + pen.measureText(text).width / 2 < width - 1) {
      pen.fillText(text, x, height - 3);
    }
  }
  pen.textAlign = "right";
  pen.textBaseline = "middle";
  for (let k = Math.ceil((zeroY - bottom) / stepPx); zeroY - k * stepPx > 0; k += 1) {
    const y = zeroY - k * stepPx;
    line(pen, [[LEFT_PX, y], [width, y]], colours.rule, k === 0 ? 1.5 : 0.5);
    if (y > 8 && y < bottom - 4) {
      pen.fillText(number(k * step, digits), LEFT_PX - 5, y);
    }
  }
}

/** The vehicle as an arrow head along its heading. */
function arrow(pen, [x, y], angle, colours) {
  pen.save();
  pen.translate(x, y);
  pen.rotate(-angle);
  pen.fillStyle = colours.trail;
  pen.strokeStyle = colours.paper;
  pen.lineWidth = 1.5;
  pen.beginPath();
  pen.moveTo(13, 0);
  pen.lineTo(-9, 8);
  pen.lineTo(-5, 0);
  pen.lineTo(-9, -8);
  pen.closePath();
  pen.fill();
  pen.stroke();
  pen.restore();
}

function diamond(pen, [x, y], size, colour) {
  line(pen, [[x, y - size], [x + size, y], [x, y + size], [x - size, y], [x, y - size]], colour, 2.5);
}

function ring(pen, [x, y], size, colour, width) {
  pen.strokeStyle = colour;
  pen.lineWidth = width;
  pen.beginPath();
  pen.arc(x, y, size, 0, 2 * Math.PI);
  pen.stroke();
}

/** The room with all that is in it; `across` and `up` are axes of the world; `top` px belong to the legend. */
function drawRoom(canvas, known, ends, [across, up], top) {
  const { briefing, facts, trail } = known;
  const paper = sheet(canvas);
  const { pen } = paper;
  const colours = palette();
  const scale = scaleOf(paper, ends, across, up, top);
  const way = (points) => points.map((point) => scale.of(point));
  const spot = ({ x, y, z }) => scale.of([x, y, z]);
  grid(paper, scale, colours);
  pen.save();
  pen.beginPath();
  pen.rect(LEFT_PX, 0, paper.width - LEFT_PX, paper.height - BELOW_PX);
  pen.clip();
  if (briefing.room !== null) {
    const [low, high] = briefing.room;
    const corners = [[0, 0], [1, 0], [1, 1], [0, 1], [0, 0]];
    const wall = corners.map(([i, j]) => [scale.x([low, high][i][across]), scale.y([low, high][j][up])]);
    line(pen, wall, colours.wall, 2);
  }
  line(pen, way(briefing.path), colours.path, 1.5, [6, 5]);
  briefing.targets.forEach((target) => ring(pen, scale.of(target), 3, colours.path, 1.5));
  line(pen, way(trail), colours.trail, 1.5);
  line(pen, way(facts.committed), colours["committed"], 5);
  line(pen, way(facts.plan), colours.plan, 2.5);
  diamond(pen, spot(facts.target), 7, colours.goal);
  if (facts.reference !== null) {
    ring(pen, spot(facts.reference), 4, colours.ink, 2);
  }
  if (facts.measured !== null) {
    ring(pen, spot(facts.measured), 10, colours.faint, 1.5);
  }
  if (facts.estimate !== null) {
    const at = spot(facts.estimate);
    if (up === 1) {
      arrow(pen, at, facts.estimate.theta, colours);
    } else {
      pen.fillStyle = colours.trail;
      pen.fillRect(at[0] - 8, at[1] - 3, 16, 6);
    }
  }
  pen.restore();
}

/** Both sticks as a transmitter has them: yaw and throttle, roll and pitch. */
function drawSticks(canvas, { yaw, throttle, roll, pitch }) {
  const { pen, width, height } = sheet(canvas);
  const colours = palette();
  const half = Math.min(height, width / 2) / 2 - 6;
  // A positive yaw turns to the left.
  [[0.25, -yaw, throttle], [0.75, roll, pitch]].forEach(([place, right, up]) => {
    const [x, y] = [place * width, height / 2];
    pen.strokeStyle = colours.rule;
    pen.lineWidth = 1.5;
    pen.strokeRect(x - half, y - half, 2 * half, 2 * half);
    line(pen, [[x - half, y], [x + half, y]], colours.rule, 1);
    line(pen, [[x, y - half], [x, y + half]], colours.rule, 1);
    const [atX, atY] = [x + right * half, y - up * half];
    line(pen, [[x, y], [atX, atY]], colours.trail, 3);
    pen.fillStyle = colours.trail;
    pen.beginPath();
    pen.arc(atX, atY, 6, 0, 2 * Math.PI);
    pen.fill();
  });
}

/** The smallest round number that is not below `value`. */
function roundUp(value) {
  const ten = 10 ** Math.floor(Math.log10(value));
  return [1, 2, 5, 10].map((digit) => digit * ten).find((size) => size >= value * 0.999);
}

/**
 * The last `span` seconds of some values: `lines` of [key, colour, dash], between the ends of `range`, the upper
 * one at least that of what is drawn if `grows`; `limit` is marked.
 */
function drawStrip(canvas, history, span, { lines, range, grows, limit }) {
  const { pen, width, height } = sheet(canvas);
  const colours = palette();
  const now = history.length > 0 ? history[history.length - 1].t : 0;
  const largest = Math.max(...lines.flatMap(([key]) => history.map((entry) => entry[key] ?? 0)), 0);
  const [low, high] = [range[0], grows && largest > range[1] ? roundUp(largest) : range[1]];
  const [right, top, bottom] = [width - 6, 7, height - BELOW_PX];
  const x = (t) => LEFT_PX + ((t - now) / span + 1) * (right - LEFT_PX);
  const y = (value) => bottom - ((Math.min(Math.max(value, low), high) - low) / (high - low)) * (bottom - top);
  pen.fillStyle = colours.faint;
  pen.textAlign = "right";
  pen.textBaseline = "middle";
  const digits = high - low < 0.4 ? 2 : high - low < 4 ? 1 : 0;
  for (const value of [low, (low + high) / 2, high]) {
    line(pen, [[LEFT_PX, y(value)], [right, y(value)]], colours.rule, 1);
    pen.fillText(number(value, value === Number(value.toFixed(digits)) ? digits : digits + 1), LEFT_PX - 5, y(value));
  }
  pen.textBaseline = "bottom";
  for (const ago of [0, span / 3, (2 * span) / 3, span]) {
    pen.textAlign = ago === 0 ? "right" : ago === span ? "left" : "center";
    pen.fillText(ago === 0 ? "now" : `${number(-ago, 0)} s`, x(now - ago), height - 2);
  }
  if (limit !== undefined && limit <= high) {
    line(pen, [[LEFT_PX, y(limit)], [right, y(limit)]], colours.bad, 1, [2, 4]);
  }
  for (const [key, colour, dash] of lines) {
    // A value that is missing interrupts the line.
    let run = [];
    for (const entry of history) {
      if (entry[key] === null) {
        line(pen, run, colours[colour], 1.5, dash);
        run = [];
      } else {
        run.push([x(entry.t), y(entry[key])]);
      }
    }
    line(pen, run, colours[colour], 1.5, dash);
  }
}
