// Texts and tables: state, boards, events, gait, notes.

import { FEET } from "./packets.js";

const EVENTS = 40, NOTE_MS = 12_000;
const ROWS = [
  ["cadence", "steps/min", "cadence_per_min", 1, 0],
  ["stride", "s", "stride_s", 1, 2],
  ["stance", "s", "stance_s", 1, 2],
  ["swing", "s", "swing_s", 1, 2],
  ["double support", "s", "double_support_s", 1, 2],
  ["symmetry of stance", "%", "stance_symmetry_percent", 1, 1],
  ["peak force", "N", "peak_force_n", 1, 0],
];
const REGIONS = ["heel", "midfoot", "forefoot", "toes"].map((region) => [
  region, "", `${region}_peak_pa`, 1e-3, 0, `${region}_integral_pa_s`, 1e-3, 0]);

export class Panels {
  constructor($) {
    this.$ = $;
    this.faults = { left: [], right: [] };
    this.health = {};
    this.recording = false;
    this.cells = {};
    const group = element("tr", "", { className: "group" });
    group.append(element("th", "peak, kPa · its time integral, kPa s", { scope: "colgroup", colSpan: 3 }));
    $("figures").replaceChildren(...ROWS.map((row) => this.row(row)), group, ...REGIONS.map((row) => this.row(row)));
    this.begin();
  }

  // After a reconnection the server sends the last events again.
  begin() {
    this.$("events").replaceChildren();
  }

  row([name, unit, ...keys]) {
    const head = element("th", name, { scope: "row" });
    head.append(element("small", ` ${unit}`));
    const cells = FEET.map((foot) => (this.cells[foot + keys[0]] = element("td", "–")));
    const row = document.createElement("tr");
    row.append(head, ...cells);
    return row;
  }

  take(words) {
    if (words.kind === "health") this.takeHealth(words);
    else if (words.kind === "event") this.event(words);
    else if (words.kind === "recording") this.takeRecording(words);
  }

  describe(meta) {
    this.approximate ??= {};
    this.approximate[meta.foot] = [meta.layout_builtin && "layout", meta.calibration_builtin && "calibration"].filter(Boolean);
    this.boards();
  }

  takeHealth(health) {
    this.health[health.foot] = health;
    this.faults[health.foot] = health.faults;
    this.boards();
  }

  takeRecording({ running, text }) {
    this.recording = running;
    const button = this.$("record");
    button.setAttribute("aria-pressed", running);
    button.textContent = running ? "End recording" : "Record";
    button.title = text;
  }

  event({ t_ns: t, text, what, foot, figures, boards, triangle, taxel }) {
    if (figures && Object.keys(figures).length) return this.step(foot, figures);
    // Drawn at once: health repeats it up to a second later.
    if (what && /^(triangle_loose|taxel_(dead|stuck|saturated)|board_(silent|address_clash|rezeroed))$/.test(what)) {
      this.faults[foot] = [...this.faults[foot], { kind: what, board: boards[0], triangle, taxel }];
    }
    const time = element("time", new Date(t / 1e6).toLocaleTimeString());
    const item = document.createElement("li");
    item.append(time, foot ? element("b", ` ${foot} `) : " ", text);
    this.$("events").prepend(item);
    while (this.$("events").children.length > EVENTS) this.$("events").lastChild.remove();
  }

  step(foot, figures) {
    for (const [, , key, factor, digits, also, alsoFactor, alsoDigits] of [...ROWS, ...REGIONS]) {
      if (!(key in figures)) continue;
      const said = number(figures[key], factor, digits) + (also ? ` · ${number(figures[also], alsoFactor, alsoDigits)}` : "");
      this.cells[foot + key].textContent = said;
    }
  }

  rate(hz, history) {
    const ages = FEET.map((foot) => history.live[foot].at(-1)?.ageMs ?? NaN).filter((age) => age === age);
    this.$("rate").textContent = `${hz.toFixed(1)} Hz`;
    this.$("age").textContent = ages.length ? age(Math.max(...ages)) : "–";
    this.$("missing").textContent = history.lost();
  }

  state(connected, idle, lostHere) {
    const all = Object.values(this.health), states = all.map(({ state }) => state);
    const worst = ["no data", "degraded", "ok"].find((state) => states.includes(state)) ?? "waiting";
    const poorest = all.map(({ quality }) => quality).sort((a, b) => a.share - b.share)[0];
    // A page that lost cycles within the last 10 s is not green, whatever the state of the boards.
    const lost = poorest && (poorest.skipped || poorest.verdict !== "good");
    const [state, text] = !connected ? ["lost", "the server is gone; trying again"]
      : idle ? ["lost", "no cycles come"]
      : [worst === "ok" && (lost || lostHere) ? "degraded" : worst, worst === "ok" ? "all boards stream" : worst === "waiting" ? "waiting for a daemon" : worst];
    this.$("state").dataset.state = state;
    const losses = [
      lost && `${poorest.verdict}, ${percent(poorest.share)} of the cycles`,
      lostHere && `this page lost ${lostHere} cycles of the last 10 s`,
    ].filter(Boolean);
    this.$("state").textContent = connected && !idle ? [text, ...losses].join("; ") : text;
  }

  boards() {
    this.$("boards").replaceChildren(...FEET.filter((foot) => this.health[foot]).map((foot) => {
      const health = this.health[foot], group = element("div", "", { className: "foot" });
      group.append(element("h3", `${foot} ${health.publish_rate_hz.toFixed(1)} Hz`));
      group.append(quality(health.quality));
      const list = document.createElement("ul");
      list.className = "chips";
      list.append(...health.boards.map((board) => {
        const faults = health.faults.filter((fault) => fault.board === board.address).map(({ kind }) => kind.replaceAll("_", " "));
        const wrong = board.state !== "streaming" || faults.length;
        const chip = element("li", "", { className: wrong ? "wrong" : "well" });
        chip.append(element("b", `board ${board.address}`), ` ${board.state === "streaming" ? `${board.rate_hz.toFixed(0)} Hz, ${age(board.age_ms)}` : board.state}`);
        if (faults.length) chip.append(element("em", ` ${tally(faults)}`));
        return chip;
      }));
      group.append(list);
      const about = this.approximate?.[foot] ?? [];
      if (about.length) group.append(element("p", `built-in ${about.join(" and ")}: an approximation`, { className: "soft" }));
      return group;
    }));
  }

  // The present lines: those of other sources only while they are published.
  lines(cycles) {
    const all = FEET.flatMap((foot) => cycles[foot].slice(-50));
    const there = [["left", "left"], ["right", "right"]];
    if (all.some((cycle) => cycle.refFz === cycle.refFz)) there.push(["reference", "reference"]);
    if (all.some((cycle) => cycle.modelFz === cycle.modelFz)) there.push(["model", "simulation or other model"]);
    const key = JSON.stringify(there);
    if (this.$("lines").dataset.there === key) return;
    this.$("lines").dataset.there = key;
    this.$("lines").replaceChildren(...there.map(([mark, text]) => {
      const item = element("li", text);
      item.dataset.mark = mark;
      return item;
    }));
  }

  temperatures(text) {
    this.$("temperature").querySelector("span").textContent = text;
  }

  note(text, ok) {
    const note = this.$("note");
    note.textContent = text;
    note.dataset.ok = ok;
    note.hidden = false;
    clearTimeout(this.noting);
    this.noting = setTimeout(() => { note.hidden = true; }, NOTE_MS);
  }
}

function element(name, text, properties = {}) {
  return Object.assign(document.createElement(name), { textContent: text }, properties);
}

export function number(value, factor, digits) {
  if (value === null) return "–";
  const rounded = Number((value * factor).toFixed(digits)) || 0; // −0 is 0
  return rounded.toFixed(digits).replace("-", "−");
}

// The verdict on the last 10 s, with its share and its reasons.
function quality({ verdict, share, skipped, repeated, late }) {
  const reasons = [[skipped, "skipped"], [repeated, "repeated"], [late, "late"]].filter(([n]) => n).map(([n, what]) => `${n} ${what}`);
  const line = element("p", `${verdict}: ${percent(share)} of the cycles of the last 10 s${reasons.length ? `, ${reasons.join(", ")}` : ""}`, { className: "quality" });
  line.dataset.verdict = verdict;
  return line;
}

function percent(share) {
  return `${(Math.floor(share * 1000) / 10).toFixed(1)} %`;
}

function age(ms) {
  if (ms === null) return "never seen";
  return ms < 1000 ? `${ms.toFixed(0)} ms` : `${(ms / 1000).toFixed(1)} s`;
}

function tally(faults) {
  const counts = new Map();
  for (const kind of faults) counts.set(kind, (counts.get(kind) ?? 0) + 1);
  return [...counts].map(([kind, n]) => (n > 1 ? `${n} × ${kind}` : kind)).join(", ");
}
