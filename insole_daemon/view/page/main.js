// The page: it stores the data from the link and draws once for each frame of the screen.

import { Scale, theme } from "./colours.js";
import { History } from "./history.js";
import { Link } from "./link.js";
import { FootMap, TRAIL_MS } from "./map.js";
import { FEET, QUANTITIES, decode } from "./packets.js";
import { Panels, number } from "./panels.js";
import { Plot, SECONDS } from "./plots.js";
import { Room } from "./room.js";
import { drawScale, highest, peakOf } from "./scale.js";
import { Weight } from "./weight.js";

const $ = (id) => document.getElementById(id);
const IDLE_MS = 1000; // without a cycle the page says so
const COUNTED_MS = 1000, SAID_MS = 100;

const history = new History(), weight = new Weight($("mass"), $("weight")), panels = new Panels($);
const metas = {}, marks = [];
let colours = theme(), changed = true, lastCycle = 0, connected = false, automatic = 0;
let picked = false, beyond = 0; // the scale, by the person; pictures with a peak beyond it
const MOST_BEYOND = 25;

function draw() {
  changed = true;
}

const maps = { left: new FootMap($("map-left"), draw), right: new FootMap($("map-right"), draw) };
const plots = {
  force: new Plot($("plot-force"), "f_z of each foot, N", [0, 100], draw),
  sum: new Plot($("plot-sum"), "f_z of both, body weights", [0, 1.2], draw),
  mx: new Plot($("plot-mx"), "m_x, N·m (above 0: load on the left)", [-5, 5], draw),
  my: new Plot($("plot-my"), "m_y, N·m (lower: farther forward)", [-50, 0], draw),
};
const scaleRoom = new Room($("scale"), draw);

// Figures of the page itself, for benchmarks.
const own = { frames: 0, cycles: 0, missing: 0, painted: [], ready: 0 };
window.insole = { own, history, maps };

const link = new Link({
  cycle(buffer) {
    const cycle = decode(buffer);
    if (!cycle || metas[cycle.foot]?.n_triangles !== cycle.triangles) return;
    history.add(cycle);
    own.cycles++;
    own.missing = history.missing;
    lastCycle = performance.now();
    changed = true;
  },
  words(words) {
    if (words.kind === "meta") describe(words);
    else if (words.kind === "hello") $("rig").textContent = words.rig;
    else if (words.kind === "mark") { marks.push(words.t_ns / 1e6); panels.event({ ...words, text: markText(words) }); }
    else panels.take(words);
    changed = true;
  },
  state(open) {
    connected = open;
    if (open) panels.begin();
    changed = true;
  },
});

function markText(words) {
  return `mark${words.text ? ` “${words.text}”` : ""}${words.recorded ? "" : " (not in a recording: none is made)"}`;
}

function describe(meta) {
  const before = metas[meta.foot];
  metas[meta.foot] = meta;
  if (!before || before.n_triangles !== meta.n_triangles) history.forget(meta.foot);
  maps[meta.foot].describe(meta);
  panels.describe(meta);
}

// ---- what a person chooses -------------------------------------------------------------------------------------

let quantity = QUANTITIES.pressure;

function chooseQuantity() {
  quantity = QUANTITIES[document.querySelector("[name=quantity]:checked").value];
  const options = [["auto", "automatic"], ...quantity.fixed.map((each) => [each, `to ${each}`])];
  $("range").replaceChildren(...options.map(([value, text]) => new Option(text, value)));
  $("range").value = quantity.start;
  picked = false;
  beyond = 0;
  $("scale-unit").textContent = quantity.unit;
  automatic = 0;
  changed = true;
}

function scale() {
  const most = Math.max(...FEET.map((foot) => highest(maps[foot].used ?? [])));
  if (!picked && !history.paused && most > Number($("range").value)) {
    const peak = Math.max(...FEET.map((foot) => peakOf(maps[foot].used ?? [])));
    if (peak > Number($("range").value) && ++beyond > MOST_BEYOND) {
      $("range").value = quantity.fixed.find((each) => each >= peak) ?? quantity.fixed.at(-1);
      beyond = 0;
    }
  }
  if ($("range").value !== "auto") return new Scale(Number($("range").value), quantity.signed);
  // The scale rises at once and falls slowly, so that colours can be compared from step to step; in a pause it stays.
  automatic = Math.max(history.paused ? automatic : automatic * 0.995, quantity.least, most);
  return new Scale(automatic, quantity.signed);
}

let pausedFaults = null; // those of the moment of a pause

function pause(on = !history.paused) {
  pausedFaults = on ? { ...panels.faults } : null;
  if (on) history.pause();
  else history.resume();
  $("pause").setAttribute("aria-pressed", on);
  $("pause").textContent = on ? "Go on" : "Pause";
  $("scrub").disabled = !on;
  $("scrub").value = 0;
  if (on) $("scrub").min = Math.min(-1, Math.ceil((history.start() - history.end()) / 20) / 50); // whole steps of 0.02 s
  changed = true;
}

function look(seconds) {
  if (!history.paused) return;
  history.at = history.end() + 1000 * Math.max(Number($("scrub").min), Math.min(0, seconds));
  $("scrub").value = (history.at - history.end()) / 1000;
  changed = true;
}

async function ask(what, done) {
  const { ok, said } = await link.ask(what);
  panels.note(ok ? done(said) : (said.refusals?.join("; ") || said.text || said.note || "it was not done"), ok);
}

async function zero(feet) {
  panels.note("Keep still: three seconds of readings are taken …", true);
  const replies = await Promise.all(feet.map((foot) => link.ask({ do: "zero", foot })));
  panels.note(replies.map(({ ok, said }, i) => (ok
    ? `${feet[i]}: zeroed ${said.n_taxels} taxels, moved by ${said.shift_count.toFixed(2)} counts on average`
    : `${feet[i]}: refused, nothing has changed: ${said.refusals?.join("; ") ?? said.text}`)).join(". "), replies.every(({ ok }) => ok));
}

const KEYS = {
  " ": () => pause(),
  m: () => $("mark").click(),
  z: () => $("zero").click(),
  r: () => $("record").click(),
  t: () => $("taxels").click(),
  a: () => { picked = true; $("range").value = $("range").value === "auto" ? quantity.start : "auto"; changed = true; },
  1: () => document.querySelectorAll("[name=quantity]")[0].click(),
  2: () => document.querySelectorAll("[name=quantity]")[1].click(),
  3: () => document.querySelectorAll("[name=quantity]")[2].click(),
  ArrowLeft: () => look(Number($("scrub").value) - 0.02),
  ArrowRight: () => look(Number($("scrub").value) + 0.02),
};

addEventListener("keydown", (event) => {
  if (document.querySelector("dialog[open]")) return;
  const own = event.target.closest("input:not([type=radio]):not([type=checkbox]), select");
  const pressed = event.key === " " && event.target.closest("button, label, input");
  if (own || pressed || event.ctrlKey || event.metaKey || event.altKey || !KEYS[event.key]) return;
  if (event.key.startsWith("Arrow") && event.target.type === "radio") return;
  event.preventDefault();
  KEYS[event.key]();
});
for (const each of document.querySelectorAll("[name=quantity]")) each.addEventListener("change", chooseQuantity);
for (const id of ["taxels", "range"]) $(id).addEventListener("change", draw);
$("range").addEventListener("change", () => { picked = true; });
$("pause").addEventListener("click", () => pause());
$("scrub").addEventListener("input", () => look(Number($("scrub").value)));
$("zero").addEventListener("click", () => $("zeroing").showModal());
$("zeroing").addEventListener("close", () => {
  const chosen = $("zeroing").returnValue;
  if (chosen) zero(chosen === "both" ? FEET.filter((foot) => metas[foot]) : [chosen]);
  $("zeroing").returnValue = "";
});
$("mark").addEventListener("click", () => ask({ do: "mark", text: "" }, (said) => (said.recorded ? "Marked in the recording." : "Marked. No recording is being made, so it is only seen here.")));
$("record").addEventListener("click", () => {
  if (panels.recording) ask({ do: "stop" }, (said) => `Recorded ${said.text}.`);
  else ask({ do: "record" }, (said) => `Recording into ${said.folder}.`);
});
$("ask-temperature").addEventListener("click", async () => {
  panels.temperatures("asking …");
  const replies = await Promise.all(FEET.filter((foot) => metas[foot]).map((foot) => link.ask({ do: "temperature", foot })));
  panels.temperatures(replies.map(({ ok, said }) => (ok
    ? said.boards.map(({ address, temperature_c: c, why }) => `board ${address} ${c === null ? why : `${c.toFixed(1)} °C`}`).join(", ")
    : said.text)).join("; "));
});

// ---- light and dark --------------------------------------------------------------------------------------------

const THEMES = ["", "light", "dark"];

function dress(name) {
  document.documentElement.dataset.theme = name;
  colours = theme();
  changed = true;
}
try { dress(localStorage.getItem("theme") ?? ""); } catch { /* a browser that keeps nothing */ }
$("theme").addEventListener("click", () => {
  const next = THEMES[(THEMES.indexOf(document.documentElement.dataset.theme) + 1) % THEMES.length];
  try { localStorage.setItem("theme", next); } catch { /* it lasts as long as the page */ }
  dress(next);
});
matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => dress(document.documentElement.dataset.theme ?? ""));

// ---- drawing ---------------------------------------------------------------------------------------------------

let countedAt = performance.now(), countedCycles = 0, saidAt = 0, turn = 0;

function frame(now) {
  requestAnimationFrame(frame);
  if (now - countedAt >= COUNTED_MS) count(now);
  if (!changed) return;
  changed = false;
  own.frames++;
  const newest = Math.max(...FEET.map((foot) => history.live[foot].at(-1)?.published ?? 0));
  for (const foot of FEET) {
    const cycle = history.shown(foot);
    if (cycle && maps[foot].field) maps[foot].read(cycle, quantity);
  }
  if (history.paused || now - saidAt >= SAID_MS) say(now);
  const shown = scale(), taxels = $("taxels").checked;
  for (const foot of FEET) {
    const faults = (pausedFaults ?? panels.faults)[foot];
    maps[foot].draw(history.shown(foot), history.since(foot, TRAIL_MS), faults, { scale: shown, taxels, colours });
  }
  drawScale(scaleRoom, shown, colours);
  // The time plots are drawn in turns, which looks as smooth and saves time on a slow computer.
  const names = Object.keys(plots);
  drawPlots(history.paused ? names : [names[turn++ % names.length]]);
  if (newest && !history.paused) painted(newest);
}

// Texts: not at every frame, because they cause a new layout of the page.
function say(now) {
  saidAt = now;
  for (const foot of FEET) {
    const cycle = history.shown(foot);
    $(`force-${foot}`).textContent = cycle && cycle.fz === cycle.fz ? `${number(cycle.fz, 1, 0)} N` : "–";
  }
  const simulated = !quantity.signed || FEET.some((foot) => maps[foot].used?.some((value) => value === value));
  $("scale-unit").textContent = simulated ? quantity.unit : "no simulation is published";
  $("ago").textContent = history.paused ? `${number((history.at - history.end()) / 1000, 1, 2)} s` : "live";
  weight.say();
}

// After the frame is painted: the time since the daemon published the shown cycle.
function painted(published) {
  const channel = new MessageChannel();
  channel.port1.onmessage = () => {
    own.ready ||= performance.now();
    own.painted.push(performance.timeOrigin + performance.now() - published);
    if (own.painted.length > 6000) own.painted.splice(0, 3000);
  };
  channel.port2.postMessage(0);
}

function drawPlots(names) {
  const now = history.now();
  if (!Number.isFinite(now)) return;
  const own = Object.fromEntries(FEET.map((foot) => [foot, history.since(foot, SECONDS * 1000 + 100)]));
  const lines = (measured, reference, model) => FEET.flatMap((foot) => [
    { cycles: own[foot], value: (cycle) => cycle[reference], colour: colours[foot], dash: [6, 4] },
    { cycles: own[foot], value: (cycle) => cycle[model], colour: colours[foot], dash: [1.5, 3] },
    { cycles: own[foot], value: (cycle) => cycle[measured], colour: colours[foot] },
  ]);
  if (names.includes("sum")) weight.weigh(own);
  const seen = marks.filter((mark) => mark > now - SECONDS * 1000);
  for (const name of names) {
    if (name === "sum") plots.sum.draw([{ cycles: weight.sums, value: (each) => each.bodyWeights, colour: colours.sum }], now, seen, colours);
    else if (name === "force") plots.force.draw(lines("fz", "refFz", "modelFz"), now, seen, colours);
    else if (name === "mx") plots.mx.draw(lines("mx", "refMx", "modelMx"), now, seen, colours);
    else plots.my.draw(lines("my", "refMy", "modelMy"), now, seen, colours);
  }
}

// Once a second: rate and age.
function count(now) {
  const seconds = (now - countedAt) / 1000, feet = FEET.filter((foot) => metas[foot]).length || 1;
  panels.rate((own.cycles - countedCycles) / seconds / feet, history);
  panels.state(connected, now - lastCycle > IDLE_MS, history.lost());
  panels.lines(history.live);
  countedAt = now;
  countedCycles = own.cycles;
}

chooseQuantity();
requestAnimationFrame(frame);
