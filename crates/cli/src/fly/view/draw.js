"use strict";
// How a flight is drawn: pure pictures of what the page knows, no state but the canvas.

/** Colours of the style sheet, light or dark as the page is now. */
function palette() {
  const style = getComputedStyle(document.documentElement);
  const colour = (name) => style.getPropertyValue("--" + name).trim();
  const names = ["paper", "ink", "faint", "rule", "bad", "trail", "committed", "plan", "goal", "path"];
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

/** Lower and upper end of what must be visible along each axis: the reference path and where the vehicle was. m */
function extent(briefing, facts, trail) {
  const points = [...briefing.path, ...briefing.targets, ...trail, ...facts.committed, ...facts.plan];
  const spots = [facts.estimate, facts.measured].filter((spot) => spot !== null);
  points.push([0, 0, 0], ...spots.map((spot) => [spot.x, spot.y, spot.z]));
  return [0, 1, 2].map((axis) => {
    const values = points.map((point) => point[axis]);
    const [low, high] = [Math.min(...values), Math.max(...values)];
    const margin = Math.max(0.3, 0.08 * (high - low));
    return axis === 2 ? [Math.min(low, 0) - 0.1, high + margin] : [low - margin, high + margin];
  });
}

/** From metres to pixels, equal along both axes, `across` to the right and `up` upwards. */
function scaleOf({ width, height }, ends, across, up) {
  const [[left, right], [low, high]] = [ends[across], ends[up]];
  const px = Math.min((width - 50) / (right - left), (height - 30) / (high - low));
  const [midX, midY] = [(left + right) / 2, (low + high) / 2];
  return {
    px,
    x: (value) => (width + 25) / 2 + (value - midX) * px,
    y: (value) => (height - 15) / 2 - (value - midY) * px,
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

/** Lines a round distance apart, with their numbers. */
function grid({ pen, width, height }, scale, colours) {
  const step = [0.25, 0.5, 1, 2, 5, 10].find((size) => size * scale.px >= 45) || 20;
  pen.fillStyle = colours.faint;
  const digits = step < 1 ? 2 : 0;
  const number = (value) => value.toFixed(digits).replace(/^-(0(\.0*)?)$/, "$1");
  pen.textAlign = "center";
  pen.textBaseline = "bottom";
  for (let k = Math.ceil(-width / scale.px / step) - 50; k < 200; k += 1) {
    const x = scale.x(k * step);
    if (x > 28 && x < width) {
      line(pen, [[x, 0], [x, height - 16]], colours.rule, k === 0 ? 1.5 : 0.5);
      pen.fillText(number(k * step), x, height - 2);
    }
  }
  pen.textAlign = "right";
  pen.textBaseline = "middle";
  for (let k = -100; k < 200; k += 1) {
    const y = scale.y(k * step);
    if (y > 6 && y < height - 16) {
      line(pen, [[28, y], [width, y]], colours.rule, k === 0 ? 1.5 : 0.5);
      pen.fillText(number(k * step), 26, y);
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

/** The room with all that is in it; `across` and `up` are axes of the world. */
function drawRoom(canvas, known, ends, across, up) {
  const { briefing, facts, trail } = known;
  const paper = sheet(canvas);
  const { pen } = paper;
  const colours = palette();
  const scale = scaleOf(paper, ends, across, up);
  const way = (points) => points.map((point) => scale.of(point));
  const spot = ({ x, y, z }) => scale.of([x, y, z]);
  grid(paper, scale, colours);
  pen.save();
  pen.beginPath();
  pen.rect(28, 0, paper.width - 28, paper.height - 16);
  pen.clip();
  if (briefing.room !== null) {
    const [low, high] = briefing.room;
    const corners = [[0, 0], [1, 0], [1, 1], [0, 1], [0, 0]];
    const wall = corners.map(([i, j]) => [scale.x([low, high][i][across]), scale.y([low, high][j][up])]);
    line(pen, wall, colours.bad, 2);
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

/** Lateness and solve times of the last `span` seconds, with the time that the solvers have. */
function drawStrip(canvas, history, briefing, span) {
  const { pen, width, height } = sheet(canvas);
  const colours = palette();
  const top = 1000 * briefing.dt_s;
  const now = history.length > 0 ? history[history.length - 1].t : 0;
  const x = (t) => 30 + ((t - now) / span + 1) * (width - 36);
  const y = (ms) => height - 6 - (Math.min(Math.max(ms, 0), top) / top) * (height - 14);
  pen.fillStyle = colours.faint;
  pen.textAlign = "right";
  pen.textBaseline = "middle";
  for (const ms of [0, top / 2, top]) {
    line(pen, [[30, y(ms)], [width - 6, y(ms)]], colours.rule, 1);
    pen.fillText(ms.toFixed(0), 26, y(ms));
  }
  const deadline = 1000 * briefing.deadline_s;
  line(pen, [[30, y(deadline)], [width - 6, y(deadline)]], colours.bad, 1, [2, 4]);
  line(pen, history.map(({ t, solve }) => [x(t), y(solve)]), colours.trail, 1.5, [5, 2]);
  line(pen, history.map(({ t, late }) => [x(t), y(late)]), colours.goal, 1.5);
}
