"use strict";
// The track in space, seen from where the reader turns to; at first as in the figure below it.
const FIRST_VIEW = { azimuth: Math.PI / 4, elevation: Math.asin(Math.sqrt(1 / 3)) };

/** Makes the function that draws `space` as seen from `view`, with a ring at the place of number `at`, into `group`. */
const spaceDrawer = ({ element, ticks }) => {
  const ink = (width, stroke, dash) => ({ fill: "none", stroke, "stroke-width": width, ...(dash && { "stroke-dasharray": dash }) });

  /** From a place in the room to pixels: a metre is as long in every view of the same elevation. */
  const projection = ({ area: [left, top, right, bottom], ends }, { azimuth, elevation }) => {
    const middle = ends.map(([low, high]) => (low + high) / 2);
    const [dx, dy, dz] = ends.map(([low, high]) => high - low);
    const [cosA, sinA, cosE, sinE] = [Math.cos(azimuth), Math.sin(azimuth), Math.cos(elevation), Math.sin(elevation)];
    const across = Math.hypot(dx, dy);
    // Room for the numbers of the axes.
    const px = Math.min((right - left - 90) / across, (bottom - top - 50) / (across * sinE + dz * cosE));
    return (place) => {
      const [x, y, z] = place.map((value, k) => value - middle[k]);
      const away = y * cosA - x * sinA;
      const at = [x * cosA + y * sinA, z * cosE + away * sinE];
      return { x: (left + right) / 2 + px * at[0], y: (top + bottom) / 2 - px * at[1], away };
    };
  };

  const way = (project, places) => {
    let isOpen = false;
    return places.map((place) => {
      const command = isOpen ? "L" : "M";
      isOpen = place[0] !== null;
      if (!isOpen) return "";
      const { x, y } = project(place);
      return `${command}${x.toFixed(1)} ${y.toFixed(1)}`;
    }).join("");
  };

  /** The floor with its grid, numbers at the edges towards the reader, a ruler for z at the left. */
  const drawBox = (group, project, [xEnds, yEnds, zEnds]) => {
    const floor = zEnds[0];
    const line = (from, to, look) => element(group, "path", { d: way(project, [from, to]), ...look });
    const text = (place, [right, down], words, anchor) => {
      const { x, y } = project(place);
      element(group, "text", { x: x + right, y: y + down, "font-size": 11, fill: "#1a1a1a", "text-anchor": anchor }, words);
    };
    const nearer = (one, other) => (project(one).away < project(other).away ? one : other);
    const nearY = nearer([xEnds[0], yEnds[0], floor], [xEnds[0], yEnds[1], floor])[1];
    const nearX = nearer([xEnds[0], yEnds[0], floor], [xEnds[1], yEnds[0], floor])[0];
    const centre = project([xEnds, yEnds, [floor, floor]].map(([low, high]) => (low + high) / 2)).x;
    // Numbers stand outside of the floor: left of an edge on the left, else right of it.
    const outside = (place) => (project(place).x < centre ? [[-6, 13], "end"] : [[6, 13], "start"]);
    const axis = (name, ends, along, range) => {
      const numbers = ticks(...ends, 6);
      for (const [value] of numbers) line(along(value, range[0]), along(value, range[1]), ink(1, "#e2e2e2"));
      const near = name === "x" ? nearY : nearX;
      const middle = along((ends[0] + ends[1]) / 2, near);
      const [[right, down], anchor] = outside(middle);
      for (const [value, label] of numbers) text(along(value, near), [right, down], label, anchor);
      text(middle, [5 * right, down + 13], `${name} [m]`, anchor);
      line(along(ends[0], near), along(ends[1], near), ink(1, "#707070"));
    };
    axis("x", xEnds, (value, y) => [value, y, floor], yEnds);
    axis("y", yEnds, (value, x) => [x, value, floor], xEnds);
    const corners = xEnds.flatMap((x) => yEnds.map((y) => [x, y]));
    const [x, y] = corners.reduce((one, other) => (project([...one, floor]).x < project([...other, floor]).x ? one : other));
    line([x, y, floor], [x, y, zEnds[1]], ink(1, "#707070"));
    for (const [value, label] of ticks(...zEnds, 4)) text([x, y, value], [-6, 4], label, "end");
    text([x, y, zEnds[1]], [0, -8], "z [m]", "middle");
  };

  return (group, space, view, at) => {
    const project = projection(space, view);
    element(group, "rect", { x: 0, y: space.area[1] - 9, width: "100%", height: "100%", fill: "#ffffff" });
    drawBox(group, project, space.ends);
    const places = space.track[0].map((x, k) => [x, space.track[1][k], space.track[2][k]]);
    const floor = places.map(([x, y]) => [x, y, space.ends[2][0]]);
    element(group, "path", { d: way(project, floor), ...ink(1, "#707070"), "stroke-opacity": 0.5 });
    element(group, "path", { d: way(project, space.outline), ...ink(1.6, "#1a1a1a", "6 6") });
    element(group, "path", { d: way(project, places), ...ink(1.6, "#0072b2"), class: "track" });
    const seen = places.filter(([x]) => x !== null);
    const dot = (place, look) => {
      const { x, y } = project(place);
      element(group, "circle", { cx: x, cy: y, ...look });
    };
    if (seen.length > 0) {
      dot(seen[0], { r: 4, fill: "#e69f00" });
      dot(seen[seen.length - 1], { r: 4, fill: "#d55e00" });
    }
    if (at !== null && places[at] && places[at][0] !== null) {
      dot(places[at], { r: 5, fill: "none", stroke: "#d55e00", "stroke-width": 2.5, class: "at" });
    }
  };
};
