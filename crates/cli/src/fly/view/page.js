// The page: keeps the connection, shows what comes, sends what is pressed. Nothing that is pressed is
// kept for later: an order is given now or, visibly, not at all.

const STALE_MS = 1000;
const TRAIL_POINTS = 600;
const STRIP_S = 30;
const PRESS_MS = 500;
const CONFIRM_MS = 3000;
const ANSWER_MS = 2000;
const RETRY_MS = [250, 5000];
const KEYS = { Backspace: "emergency_stop", r: "land", q: "land", e: "hold", c: "automatic" };

const byId = (id) => document.getElementById(id);
const known = { briefing: null, facts: null, trail: [], history: [] };
const wire = { socket: null, mayOrder: false, heardAt: -Infinity, isOver: false, isRecorded: false, retryMs: RETRY_MS[0], ageMs: 0 };
const MAY_LOOK = byId("access").textContent;
const shown = { phase: null, faults: [], isDown: false, isByHand: false, reached: 0 };
let isDirty = false;

function connect() {
  const socket = new WebSocket(`ws://${location.host}/live`);
  wire.socket = socket;
  socket.addEventListener("open", () => {
    wire.retryMs = RETRY_MS[0];
    const token = location.hash.slice(1);
    if (token !== "") {
      socket.send(JSON.stringify({ token }));
    }
  });
  socket.addEventListener("message", (event) => hear(JSON.parse(event.data)));
  socket.addEventListener("close", (event) => {
    if (event.reason !== "") {
      announce(`connection closed: ${event.reason}`);
    }
    admit(false);
    setTimeout(connect, wire.retryMs);
    wire.retryMs = Math.min(2 * wire.retryMs, RETRY_MS[1]);
  });
}

function hear(message) {
  if (message.briefing) {
    Object.assign(known, { briefing: message.briefing.briefing, trail: message.briefing.trail, history: [] });
    Object.assign(shown, { phase: null, faults: [], isDown: false, isByHand: false, reached: 0 });
    Object.assign(wire, { isOver: false, ageMs: 1000 * (message.briefing.age_s ?? 0) });
    byId("access").textContent = MAY_LOOK;
    byId("program").textContent = known.briefing.program;
  } else if (message.facts) {
    take(message.facts);
  } else if (message.access) {
    admit(message.access.may_order);
  } else if (message.answer) {
    const { order: name, refusal } = message.answer;
    acknowledge(name, refusal === null ? "done" : "failed", refusal === null ? "ordered" : `NOT DONE: ${refusal}`);
  } else if (message === "over") {
    wire.isOver = true;
    byId("access").textContent = "The flight is over.";
  }
  isDirty = true;
}

/** Takes new facts; draws them when the browser draws next. */
function take(facts) {
  // The first facts after a connection may be old.
  wire.heardAt = performance.now() - wire.ageMs;
  wire.ageMs = 0;
  const before = known.facts;
  known.facts = facts;
  if (facts.estimate !== null && (before === null || facts.t_s > before.t_s)) {
    const { x, y, z } = facts.estimate;
    known.trail.push([x, y, z]);
    // The server's trail has ten points a second, and so has this one.
    if (before !== null && Math.floor(before.t_s * 10) === Math.floor(facts.t_s * 10)) {
      known.trail.splice(-2, 1);
    }
    known.trail.splice(0, known.trail.length - TRAIL_POINTS);
  }
  const { late_ms: late, estimate_ms: estimate, plan_ms: plan } = facts.times;
  const error = facts.offset === null ? null : Math.hypot(...facts.offset);
  const age = facts.mocap.age_s === null ? null : 1000 * facts.mocap.age_s;
  known.history.push({ t: facts.t_s, late, solve: estimate + plan, error, age, ...facts.sticks });
  while (known.history.length > 1 && known.history[0].t < facts.t_s - STRIP_S) {
    known.history.shift();
  }
  report(facts);
}

/** Says what is new. */
function report(facts) {
  const at = `${facts.t_s.toFixed(1)} s  `;
  const isDown = facts.link !== null && facts.link.is_down;
  const news = [];
  if (facts.phase !== shown.phase && facts.phase !== null) {
    news.push(words(facts.phase));
  }
  facts.faults.filter((fault) => !shown.faults.includes(fault)).forEach((fault) => news.push(words(fault)));
  shown.faults.filter((fault) => !facts.faults.includes(fault))
    .forEach((fault) => news.push(`${words(fault)}: over`));
  if (isDown !== shown.isDown) {
    news.push(isDown ? "sent sticks do not act" : "sent sticks act again");
  }
  if (facts.is_by_hand !== shown.isByHand) {
    news.push(facts.is_by_hand ? "by hand" : "automatic");
  }
  if (facts.targets_reached > shown.reached) {
    news.push(`target ${facts.targets_reached} reached`);
  }
  Object.assign(shown, { phase: facts.phase, faults: facts.faults, isDown });
  Object.assign(shown, { isByHand: facts.is_by_hand, reached: facts.targets_reached });
  news.forEach((text) => announce(at + text));
}

function announce(text) {
  const item = document.createElement("li");
  item.textContent = text;
  byId("news").prepend(item);
  while (byId("news").children.length > 8) {
    byId("news").lastChild.remove();
  }
}

const words = (name) => name.replaceAll("_", " ");

function admit(mayOrder) {
  wire.mayOrder = mayOrder;
  byId("access").hidden = mayOrder;
  document.querySelectorAll(".orders button").forEach((button) => {
    button.disabled = !mayOrder;
  });
}

function order(name) {
  const isOpen = wire.socket !== null && wire.socket.readyState === WebSocket.OPEN;
  if (wire.mayOrder && isOpen) {
    wire.socket.send(JSON.stringify({ order: name }));
    acknowledge(name, "sent", "sent, no answer yet");
  } else {
    acknowledge(name, "failed", `NOT SENT: ${isOpen ? "this page may only look" : "no connection"}`);
  }
}

/** Shows what became of an order: beside the buttons, on its button, and in the list of what happened. */
function acknowledge(name, state, text) {
  const line = `${words(name)}: ${text}`;
  byId("answer").textContent = line;
  byId("answer").className = `answer ${state}`;
  const button = byId(name);
  if (button !== null) {
    button.classList.remove("sent", "done", "failed");
    button.classList.add(state);
    setTimeout(() => button.classList.remove(state), ANSWER_MS);
  }
  if (state !== "sent") {
    announce(line);
  }
}

/** A button that must be pressed for a while: no stray click starts or stops motors. */
function slow(button) {
  let timer = null;
  const release = () => {
    clearTimeout(timer);
    timer = null;
    button.classList.remove("pressed");
  };
  const press = () => {
    if (timer === null && !button.disabled) {
      button.classList.add("pressed");
      timer = setTimeout(() => {
        release();
        order(button.id);
      }, PRESS_MS);
    }
  };
  button.addEventListener("pointerdown", (event) => {
    if (event.button === 0) {
      press();
    }
  });
  button.addEventListener("keydown", (event) => {
    if (event.key === " " || event.key === "Enter") {
      event.preventDefault();
      // A key that stays down repeats, and gives its order once.
      if (!event.repeat) {
        press();
      }
    }
  });
  button.addEventListener("keyup", (event) => event.preventDefault());
  // A screen reader cannot hold a button: its clicks have no place on the screen, and two of them count.
  let armedAt = -Infinity;
  button.addEventListener("click", (event) => {
    if (event.detail !== 0) {
      return;
    }
    if (performance.now() - armedAt < CONFIRM_MS) {
      armedAt = -Infinity;
      order(button.id);
    } else {
      armedAt = performance.now();
      acknowledge(button.id, "armed", "activate again within 3 s");
    }
  });
  ["pointerup", "pointerleave", "pointercancel", "keyup", "blur"]
    .forEach((name) => button.addEventListener(name, release));
  button.addEventListener("contextmenu", (event) => event.preventDefault());
}

function listen() {
  ["land", "hold", "automatic"].forEach((id) => byId(id).addEventListener("click", () => order(id)));
  ["take_off", "emergency_stop"].forEach((id) => slow(byId(id)));
  document.addEventListener("keydown", (event) => {
    const name = KEYS[event.key.length === 1 ? event.key.toLowerCase() : event.key];
    if (name && !event.repeat && !event.ctrlKey && !event.altKey && !event.metaKey) {
      event.preventDefault();
      order(name);
    }
  });
}

const set = (id, text) => {
  if (byId(id).textContent !== text) {
    byId(id).textContent = text;
  }
};
const warn = (id, isBad) => byId(id).classList.toggle("bad", isBad);
const signed = (value, digits) => {
  const size = Math.abs(value).toFixed(digits);
  return (value < 0 && Number(size) > 0 ? "\u2212" : "+") + size;
};
const three = (values) => values.map((value) => signed(value, 2)).join("\u2002");

function showNumbers(facts, briefing) {
  set("phase", facts.phase === null ? "no flight yet" : words(facts.phase));
  set("steers", facts.is_by_hand ? "BY HAND" : "automatic");
  byId("steers").classList.toggle("hand", facts.is_by_hand);
  set("time", facts.t_s.toFixed(1));
  set("target", `${facts.targets_reached} of ${briefing.targets_count} reached`);
  const at = facts.estimate;
  set("place", at === null ? "-" : three([at.x, at.y, at.z]));
  set("heading", at === null ? "-" : signed((at.theta * 180) / Math.PI, 0));
  set("velocity", facts.velocity_w === null ? "-" : three(facts.velocity_w));
  set("disturbance", facts.disturbance_w === null ? "-" : three(facts.disturbance_w));
  set("offset", facts.offset === null ? "-" : `${facts.offset[0].toFixed(2)}\u2002${signed(facts.offset[1], 2)}`);
  Object.entries(facts.sticks).forEach(([name, value]) => set(name, signed(value, 2)));
  const { drone, link, mocap, times: now, worst } = facts;
  set("battery", drone === null ? "-" : String(drone.battery_pct));
  warn("battery-row", facts.faults.some((fault) => fault.startsWith("battery")));
  set("drone", drone === null ? "never" : drone.age_s.toFixed(1));
  warn("drone-row", facts.faults.some((fault) => fault.startsWith("drone")));
  set("link", link === null ? "not watched" : link.is_down ? "DO NOT ACT" : "act");
  warn("link-row", link !== null && link.is_down);
  set("age", mocap.age_s === null ? "never" : (1000 * mocap.age_s).toFixed(0));
  warn("mocap-row", mocap.age_s === null || mocap.age_s > briefing.stale_s);
  set("rate", mocap.rate_hz.toFixed(0));
  const times = (name) => `${now[name].toFixed(2)}\u2002${worst[name].toFixed(2)}`;
  set("estimate-ms", times("estimate_ms"));
  set("plan-ms", times("plan_ms"));
  set("late-ms", times("late_ms"));
  warn("late-row", worst.late_ms > briefing.late_ms);
  set("tick-ms", times("tick_ms"));
  set("missed", String(facts.missed_periods));
  warn("missed-row", facts.missed_periods > 0);
}

function drawStrips(history, briefing) {
  const strip = (id, what) => drawStrip(byId(id), history, STRIP_S, what);
  strip("error", { lines: [["error", "trail", []]], range: [0, 0.1], grows: true });
  const sticks = [["roll", "trail", []], ["pitch", "goal", []], ["yaw", "plan", []], ["throttle", "committed", []]];
  strip("commands", { lines: sticks, range: [-1, 1] });
  strip("strip", {
    lines: [["solve", "trail", [5, 2]], ["late", "goal", []]],
    range: [0, 1000 * briefing.dt_s],
    limit: 1000 * briefing.deadline_s,
  });
  strip("pose-age", {
    lines: [["age", "trail", []]],
    range: [0, 100],
    grows: true,
    limit: 1000 * briefing.stale_s,
  });
  const { error, age } = history[history.length - 1];
  set("error-now", error === null ? "-" : error.toFixed(3));
  set("age-now", age === null ? "never" : age.toFixed(0));
}

/** How far what is shown can be trusted. */
function showLine(now) {
  const isOpen = wire.socket !== null && wire.socket.readyState === WebSocket.OPEN;
  const silentMs = now - wire.heardAt;
  const isStale = !wire.isOver && !wire.isRecorded && silentMs > STALE_MS;
  const since = Number.isFinite(silentMs) ? ` for ${(silentMs / 1000).toFixed(0)} s` : "";
  const why = isOpen ? "connected" : "reconnecting";
  const fresh = wire.isRecorded ? "RECORDED" : "LIVE";
  set("line", wire.isOver ? "FLIGHT OVER" : isStale ? `STALE${since}, ${why}` : fresh);
  byId("line").classList.toggle("live", !isStale && !wire.isOver);
  byId("line").classList.toggle("stale", isStale);
  document.body.classList.toggle("stale", isStale);
  const faults = known.facts === null ? [] : known.facts.faults.map(words);
  if (known.facts !== null && known.facts.has_log_failed) {
    faults.unshift("the log has failed: nothing is recorded");
  }
  if (isStale && known.facts !== null) {
    faults.unshift(`nothing new${since}: what you see is old`);
  }
  byId("alarm").hidden = faults.length === 0;
  set("alarm", faults.join(" \u00b7 "));
}

function draw(now) {
  showLine(now);
  const { briefing, facts } = known;
  if (isDirty && briefing !== null && facts !== null) {
    isDirty = false;
    document.title = `${words(facts.phase ?? "waiting")}: tello-ctl`;
    showNumbers(facts, briefing);
    const ends = extent(briefing, facts, known.trail);
    drawRoom(byId("above"), known, ends, [0, 1], byId("legend").offsetHeight);
    drawRoom(byId("side"), known, ends, [0, 2], 0);
    drawSticks(byId("sticks"), facts.sticks);
    drawStrips(known.history, briefing);
  }
  requestAnimationFrame(draw);
}

window.addEventListener("resize", () => {
  isDirty = true;
});
matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => {
  isDirty = true;
});
byId("legend").open = !matchMedia("(max-width: 640px)").matches;
byId("legend").addEventListener("toggle", () => {
  isDirty = true;
});
admit(false);
requestAnimationFrame(draw);
