// A recorded flight in place of a live one: the facts of the time that is chosen, and what was before them.

const BEFORE_S = 60;

/** Shows `recording` from its begin, or from the time in the address (#t=6). */
function play({ briefing, facts, note }) {
  const [first, last] = [facts[0].t_s, facts[facts.length - 1].t_s];
  const [timeline, button, speed] = [byId("timeline"), byId("play"), byId("speed")];
  const playing = { index: -1, t: first, since: null };

  /** Number of the last facts that are not after t. */
  const indexAt = (t) => {
    let [low, high] = [0, facts.length - 1];
    while (low < high) {
      const middle = (low + high + 1) >> 1;
      [low, high] = facts[middle].t_s <= t ? [middle, high] : [low, middle - 1];
    }
    return low;
  };
  const show = (t) => {
    playing.t = Math.min(Math.max(t, first), last);
    const index = indexAt(playing.t);
    let from = playing.index + 1;
    if (playing.index < 0 || index < playing.index || index - playing.index > 50) {
      known.facts = null;
      byId("news").replaceChildren();
      hear({ briefing: { briefing, trail: [] } });
      from = indexAt(playing.t - BEFORE_S);
    }
    facts.slice(from, index + 1).forEach(take);
    playing.index = index;
    timeline.value = playing.t;
    timeline.setAttribute("aria-valuetext", `${playing.t.toFixed(1)} s`);
    isDirty = true;
  };
  const run = (isOn) => {
    playing.since = isOn ? performance.now() : null;
    button.textContent = isOn ? "Pause" : "Play";
  };
  const step = (now) => {
    if (playing.since !== null) {
      show(playing.t + ((now - playing.since) / 1000) * Number(speed.value));
      playing.since = now;
      if (playing.t >= last) {
        run(false);
      }
    }
    requestAnimationFrame(step);
  };

  document.body.classList.add("recorded");
  wire.isRecorded = true;
  Object.assign(timeline, { min: first, max: last, step: 0.02 });
  timeline.addEventListener("input", () => show(Number(timeline.value)));
  button.addEventListener("click", () => {
    if (playing.since === null && playing.t >= last) {
      show(first);
    }
    run(playing.since === null);
  });
  const asked = Number(new URLSearchParams(location.hash.slice(1)).get("t") ?? NaN);
  show(Number.isFinite(asked) ? asked : first);
  byId("program").textContent = `${briefing.program}${note === null ? "" : `. ${note}`}`;
  requestAnimationFrame(step);
}

play(JSON.parse(byId("recording").textContent));
