"use strict";
// One time cursor and one zoom for all figures of a flight: hover or arrow keys show the values of the log, a drag
// selects a time range, Ctrl and the wheel or + and - zoom, a double click or Escape resets. A link may end in
// #t=4.2&from=2&to=6. A drag, arrow keys or a slider turn the track in space.
(() => {
  const SVG = "http://www.w3.org/2000/svg";
  const flights = new Map();

  const element = (parent, tag, attributes, text) => {
    const made = document.createElementNS(SVG, tag);
    for (const [name, value] of Object.entries(attributes)) made.setAttribute(name, value);
    if (text !== undefined) made.textContent = text;
    return parent.appendChild(made);
  };

  // Numbers that stand in the page as integers less the one before.
  const sums = (differences, perUnit) => {
    let sum = 0;
    return differences.map((difference) => (difference === null ? null : (sum += difference) / perUnit));
  };

  const decode = (data) => {
    data.time_s = sums(data.time, 1e3);
    for (const line of data.panels.flatMap((panel) => panel.lines)) line.values = sums(line.values, 1e4);
    if (data.map) [data.map.x, data.map.y] = [sums(data.map.x, 1e4), sums(data.map.y, 1e4)];
    if (data.space) data.space.track = data.space.track.map((row) => sums(row, 1e4));
    return data;
  };

  // Index of the time nearest to t.
  const nearest = (times, t) => {
    let low = 0;
    let high = times.length - 1;
    while (low < high) {
      const middle = (low + high) >> 1;
      if (times[middle] < t) low = middle + 1;
      else high = middle;
    }
    return low > 0 && t - times[low - 1] < times[low] - t ? low - 1 : low;
  };

  const pixelX = ({ area: [left, , right] }, [from, to], t) => left + ((t - from) / (to - from)) * (right - left);
  const pixelY = ({ area: [, top, , bottom], y: [low, high] }, v) => bottom - ((v - low) / (high - low)) * (bottom - top);

  const ticks = (from, to, count = 8) => {
    const raw = (to - from) / count;
    const unit = 10 ** Math.floor(Math.log10(raw));
    const step = unit * [1, 2, 5, 10].find((factor) => factor * unit >= raw);
    const list = [];
    for (let t = Math.ceil(from / step) * step; t <= to + 1e-9; t += step) list.push(t);
    return list.map((t) => [t, t.toFixed(Math.max(0, -Math.floor(Math.log10(step))))]);
  };

  const drawSpace = spaceDrawer({ element, ticks });

  const drawLine = (group, frame, range, times, line) => {
    let path = "";
    let isOpen = false;
    for (let i = nearest(times, range[0]); i < times.length && times[i] <= range[1]; i += 1) {
      const value = line.values[i];
      if (value === null || times[i] < range[0]) {
        isOpen = false;
        continue;
      }
      path += `${isOpen ? "L" : "M"}${pixelX(frame, range, times[i]).toFixed(1)} ${pixelY(frame, value).toFixed(1)}`;
      isOpen = true;
    }
    const look = { d: path, fill: "none", stroke: line.color, "stroke-width": 1.4 };
    if (line.is_dashed) look["stroke-dasharray"] = "5 5";
    element(group, "path", look);
  };

  // The part of a panel that is zoomed, over the whole one.
  const drawZoom = (group, data, panel, range, isLast) => {
    const [left, top, right, bottom] = panel.frame.area;
    const width = right - left;
    element(group, "rect", { x: left, y: top, width, height: bottom - top, fill: "#ffffff" });
    // A line for each number of the axes; those of y stay as they are, one for 22 px.
    const across = ticks(...range).map(([t]) => `M${pixelX(panel.frame, range, t).toFixed(1)} ${top}V${bottom}`);
    const rows = panel.bars.length > 0 ? [] : ticks(...panel.frame.y, (bottom - top) / 22);
    const along = rows.map(([value]) => `M${left} ${pixelY(panel.frame, value).toFixed(1)}H${right}`);
    element(group, "path", { d: [...across, ...along].join(""), fill: "none", stroke: "#e2e2e2", class: "grid" });
    const inRange = ([from, to]) =>
      [Math.max(from, range[0]), Math.min(to, range[1])].map((t) => pixelX(panel.frame, range, t));
    for (const band of panel.bars.length > 0 ? [] : data.bands) {
      for (const [x, end] of band.spans.map(inRange)) {
        const look = { fill: band.color, "fill-opacity": band.opacity };
        if (x < end) element(group, "rect", { x, y: top, width: end - x, height: bottom - top, ...look });
      }
    }
    for (const line of panel.lines) drawLine(group, panel.frame, range, data.time_s, line);
    panel.bars.forEach(([name, spans], row) => {
      const height = (bottom - top) / panel.bars.length;
      for (const [x, end] of spans.map(inRange)) {
        const y = top + height * (row + 0.48);
        if (x < end) element(group, "rect", { x, y, width: end - x, height: 0.4 * height, fill: "#d55e00" });
      }
      element(group, "text", { x: left + 4, y: top + height * (row + 0.4), "font-size": 11, fill: "#1a1a1a" }, name);
    });
    element(group, "path", { d: `M${left} ${top}V${bottom}H${right}`, fill: "none", stroke: "#707070" });
    if (!isLast) return;
    element(group, "rect", { x: left - 20, y: bottom + 3, width: width + 33, height: 15, fill: "#ffffff" });
    for (const [t, label] of ticks(...range)) {
      const x = pixelX(panel.frame, range, t);
      element(group, "text", { x, y: bottom + 15, "font-size": 11, fill: "#1a1a1a", "text-anchor": "middle" }, label);
    }
  };

  /** Words beside the cursor at x: one line, or more where less of the figure is seen, on a phone. */
  const drawLabel = (group, [left, top, right], x, words) => {
    const svg = group.ownerSVGElement;
    const px = svg.getBoundingClientRect().width / svg.viewBox.baseVal.width || 1;
    const { scrollLeft, clientWidth } = svg.parentElement;
    const low = Math.max(left, scrollLeft / px) + 2;
    const high = Math.min(right, (scrollLeft + clientWidth) / px) - 2;
    const label = element(group, "text", { y: top + 12, "font-size": 11, fill: "#1a1a1a", class: "values" });
    const lengthOf = (text) => {
      label.textContent = text;
      return label.getComputedTextLength();
    };
    const lines = lengthOf(words.join("; ")) > high - low ? [] : [words.join("; ")];
    for (const word of lines.length > 0 ? [] : words) {
      const longer = lines.length > 0 ? `${lines[lines.length - 1]}; ${word}` : word;
      if (lines.length > 0 && lengthOf(longer) <= high - low) lines[lines.length - 1] = longer;
      else lines.push(word);
    }
    const length = Math.max(...lines.map(lengthOf));
    const begin = Math.min(Math.max(x + 6, low), Math.max(high - length, low));
    label.textContent = lines.length === 1 ? lines[0] : "";
    label.setAttribute("x", begin);
    const more = lines.length === 1 ? [] : lines;
    more.forEach((line, k) => element(label, "tspan", { x: begin, y: top + 12 + 14 * k }, line));
    const box = { x: begin - 3, y: top + 1, width: length + 6, height: 14 * lines.length + 1, fill: "#ffffff", "fill-opacity": 0.85 };
    group.insertBefore(element(group, "rect", box), label);
  };

  const drawCursor = (group, data, range, at) => {
    const i = nearest(data.time_s, at);
    const t = data.time_s[i];
    if (data.map && data.map.x[i] !== null) {
      const { frame, x, y } = data.map;
      const [cx, cy] = [pixelX(frame, frame.x, x[i]), pixelY(frame, y[i])];
      element(group, "circle", { cx, cy, r: 5, fill: "none", stroke: "#d55e00", "stroke-width": 2.5 });
    }
    for (const panel of data.panels) {
      const [left, top, right, bottom] = panel.frame.area;
      const x = pixelX(panel.frame, range, t);
      if (x < left || x > right) continue;
      element(group, "path", { d: `M${x} ${top}V${bottom}`, class: "cursor", stroke: "#707070", "data-t": t });
      const unit = panel.unit === "1" ? "" : ` ${panel.unit}`;
      const shown = panel.lines.filter((line) => line.values[i] !== null);
      const words = shown.map((line) => `${line.name} ${line.values[i].toFixed(4)}${unit}`);
      const isNow = ([from, to]) => from <= t && t < to;
      const bands = data.bands.filter(({ spans }) => spans.some(isNow)).map(({ name }) => name);
      const time = `${t.toFixed(2)} s`;
      // Rows of bars have their names at the left: the time stands at the right.
      if (panel.bars.length > 0) drawLabel(group, panel.frame.area, right, [time]);
      else drawLabel(group, panel.frame.area, x, [time, ...words, ...bands]);
    }
  };

  const draw = (flight) => {
    for (const { data, group } of flight.figures) {
      group.replaceChildren();
      if (data.space) drawSpace(group, data.space, data.view, flight.at === null ? null : nearest(data.time_s, flight.at));
      const isZoomed = flight.range[0] > flight.all[0] || flight.range[1] < flight.all[1];
      data.panels.forEach((panel, position) => {
        if (isZoomed) drawZoom(group, data, panel, flight.range, position + 1 === data.panels.length);
      });
      if (flight.at !== null) drawCursor(group, data, flight.range, flight.at);
      const [from, to] = flight.drag ?? [0, 0];
      for (const panel of from === to ? [] : data.panels) {
        const [, top, , bottom] = panel.frame.area;
        const [x, end] = [Math.min(from, to), Math.max(from, to)].map((t) => pixelX(panel.frame, flight.range, t));
        const box = { x, y: top, width: end - x, height: bottom - top, fill: "#0072b2", "fill-opacity": 0.15 };
        element(group, "rect", box);
      }
    }
  };

  const setRange = (flight, from, to) => {
    const [first, last] = flight.all;
    const range = [Math.max(first, from), Math.min(last, to)];
    if (range[1] - range[0] > 0.05) flight.range = range;
    draw(flight);
  };

  const zoom = (flight, factor) => {
    const [from, to] = flight.range;
    const at = flight.at ?? (from + to) / 2;
    setRange(flight, at - (at - from) * factor, at + (to - at) * factor);
  };

  // The flight and what its figure shows: the last part of the figure's name.
  const nameOf = (svg) => `${svg.querySelector("title").textContent}, ${svg.closest("figure").id.split("-").pop()}`;

  const listen = (flight, svg, data) => {
    const timeAt = (event) => {
      const point = new DOMPoint(event.clientX, event.clientY).matrixTransform(svg.getScreenCTM().inverse());
      const [left, , right] = data.panels[0].frame.area;
      const fraction = Math.min(Math.max((point.x - left) / (right - left), 0), 1);
      return flight.range[0] + fraction * (flight.range[1] - flight.range[0]);
    };
    svg.setAttribute("tabindex", "0");
    svg.setAttribute("role", "application");
    svg.setAttribute("aria-label", `${nameOf(svg)}: arrow keys move the time, plus and minus zoom`);
    svg.addEventListener("pointermove", (event) => {
      flight.at = timeAt(event);
      if (flight.drag) flight.drag[1] = flight.at;
      draw(flight);
    });
    svg.addEventListener("pointerdown", (event) => {
      flight.at = timeAt(event);
      if (event.button === 0 && event.pointerType === "mouse") flight.drag = [flight.at, flight.at];
      draw(flight);
    });
    svg.addEventListener("dblclick", () => setRange(flight, ...flight.all));
    svg.addEventListener("wheel", (event) => {
      if (!event.ctrlKey) return;
      event.preventDefault();
      zoom(flight, event.deltaY > 0 ? 1.25 : 0.8);
    }, { passive: false });
    svg.addEventListener("keydown", (event) => {
      const step = (flight.range[1] - flight.range[0]) / (event.shiftKey ? 20 : 200);
      const move = (by) => {
        const at = (flight.at ?? flight.range[0]) + by;
        flight.at = Math.min(Math.max(at, flight.range[0]), flight.range[1]);
        draw(flight);
      };
      const actions = {
        ArrowLeft: () => move(-step),
        ArrowRight: () => move(step),
        "+": () => zoom(flight, 0.8),
        "-": () => zoom(flight, 1.25),
        Escape: () => setRange(flight, ...flight.all),
      };
      if (!actions[event.key]) return;
      event.preventDefault();
      actions[event.key]();
    });
  };

  /** Turns the track in space: by a mouse as one turns a globe, by arrow keys in steps of 5 degrees, by a slider. */
  const listenToTurns = (flight, svg, data) => {
    const [degree, circle] = [Math.PI / 180, 2 * Math.PI];
    const slider = document.createElement("input");
    Object.assign(slider, { type: "range", min: 0, max: 360, step: 5, value: FIRST_VIEW.azimuth / degree });
    const label = document.createElement("label");
    label.className = "turn";
    label.append("Turn ", slider);
    svg.after(label);
    const show = (azimuth, elevation) => {
      const turned = ((azimuth % circle) + circle) % circle;
      data.view = { azimuth: turned, elevation: Math.min(Math.max(elevation, 0), Math.PI / 2) };
      slider.value = turned / degree;
      draw(flight);
    };
    const turn = (right, up) => show(data.view.azimuth - right, data.view.elevation + up);
    const reset = () => show(FIRST_VIEW.azimuth, FIRST_VIEW.elevation);
    let from = null;
    svg.setAttribute("tabindex", "0");
    svg.setAttribute("role", "application");
    svg.setAttribute("aria-label", `${nameOf(svg)}: arrow keys turn the view`);
    slider.addEventListener("input", () => show(slider.value * degree, data.view.elevation));
    svg.addEventListener("pointerdown", (event) => {
      if (event.pointerType !== "mouse") return;
      from = [event.clientX, event.clientY];
      svg.setPointerCapture(event.pointerId);
    });
    svg.addEventListener("pointermove", (event) => {
      if (from === null) return;
      turn((event.clientX - from[0]) / 150, (event.clientY - from[1]) / 150);
      from = [event.clientX, event.clientY];
    });
    for (const name of ["pointerup", "pointercancel"]) svg.addEventListener(name, () => (from = null));
    svg.addEventListener("dblclick", reset);
    svg.addEventListener("keydown", (event) => {
      const step = 5 * degree;
      const steps = { ArrowLeft: [-step, 0], ArrowRight: [step, 0], ArrowUp: [0, step], ArrowDown: [0, -step] };
      if (event.key !== "Escape" && !steps[event.key]) return;
      event.preventDefault();
      if (event.key === "Escape") reset();
      else turn(...steps[event.key]);
    });
    data.view = { ...FIRST_VIEW };
    if (!matchMedia("(max-width: 820px)").matches) return;
    // The figure scrolls: the view fits the part of it that is seen at first.
    const [left, top] = data.space.area;
    const seen = svg.parentElement.clientWidth;
    data.space.area = [left - 30, top, seen - 14, top + seen];
    svg.setAttribute("viewBox", `0 0 ${svg.viewBox.baseVal.width} ${top + seen + 38}`);
    svg.setAttribute("height", top + seen + 38);
  };

  for (const figure of document.querySelectorAll("figure")) {
    const script = figure.querySelector("script");
    if (!script) continue;
    const data = decode(JSON.parse(script.textContent));
    const svg = figure.querySelector("svg");
    const name = figure.id.slice(0, figure.id.lastIndexOf("-"));
    const flight = flights.get(name) ?? { figures: [], all: [Infinity, -Infinity], range: null, at: null, drag: null };
    flights.set(name, flight);
    flight.figures.push({ data, group: element(svg, "g", { class: "overlay" }) });
    if (data.space) listenToTurns(flight, svg, data);
    if (data.panels.length === 0) continue;
    const { x } = data.panels[0].frame;
    flight.all = [Math.min(flight.all[0], x[0]), Math.max(flight.all[1], x[1])];
    listen(flight, svg, data);
  }
  addEventListener("pointerup", () => {
    for (const flight of flights.values()) {
      const drag = flight.drag;
      flight.drag = null;
      if (drag && Math.abs(drag[1] - drag[0]) > 0.05) setRange(flight, Math.min(...drag), Math.max(...drag));
    }
  });
  const hash = new URLSearchParams(location.hash.slice(1));
  const number = (key) => (hash.has(key) ? Number(hash.get(key)) : NaN);
  for (const flight of flights.values()) {
    flight.range = flight.all;
    if (Number.isFinite(number("t"))) flight.at = number("t");
    const [from, to] = [number("from"), number("to")];
    setRange(flight, Number.isFinite(from) ? from : flight.all[0], Number.isFinite(to) ? to : flight.all[1]);
  }
})();
