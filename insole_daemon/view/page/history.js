// The cycles of the last minute; a pause keeps the shown ones while new ones arrive.

const KEPT_MS = 60_000, LOSS_MS = 10_000;

export class History {
  constructor() {
    this.live = { left: [], right: [] };
    this.frozen = null;
    this.at = null; // ms, of a pause
    this.missing = 0;
    this.losses = []; // [when in ms, how many cycles], of the last LOSS_MS
  }

  // Cycles that did not reach this page within the last LOSS_MS.
  lost(now = performance.now()) {
    this.losses = this.losses.filter(([when]) => now - when < LOSS_MS);
    return this.losses.reduce((sum, [, cycles]) => sum + cycles, 0);
  }

  add(cycle) {
    const cycles = this.live[cycle.foot], last = cycles.at(-1);
    if (last) {
      const missing = cycle.seq - last.seq - 1;
      if (missing > 0) {
        this.missing += missing;
        this.losses.push([performance.now(), missing]);
      }
      if (missing < 0) cycles.length = 0; // the daemon was started anew
    }
    cycles.push(cycle);
    const old = cycles.findIndex((each) => each.t > cycle.t - KEPT_MS);
    if (old > 200) cycles.splice(0, old); // not at every cycle: it moves all the rest
  }

  forget(foot) {
    this.live[foot].length = 0;
  }

  get paused() {
    return this.frozen !== null;
  }

  pause() {
    this.frozen = { left: this.live.left.slice(), right: this.live.right.slice() };
    this.at = this.end();
  }

  resume() {
    this.frozen = this.at = null;
  }

  get cycles() {
    return this.frozen ?? this.live;
  }

  end() {
    return Math.max(...Object.values(this.cycles).map((cycles) => cycles.at(-1)?.t ?? -Infinity));
  }

  start() {
    return Math.min(...Object.values(this.cycles).map((cycles) => cycles[0]?.t ?? Infinity));
  }

  now() {
    return this.paused ? this.at : this.end();
  }

  // The shown cycle: the last one, or in a pause the last one up to the selected time.
  shown(foot) {
    const cycles = this.cycles[foot];
    return this.paused ? cycles[after(cycles, this.at) - 1] : cycles.at(-1);
  }

  // Cycles within `ms` before the shown time.
  since(foot, ms) {
    const cycles = this.cycles[foot], now = this.now();
    return cycles.slice(after(cycles, now - ms), this.paused ? after(cycles, now) : undefined);
  }
}

function after(cycles, t) {
  let low = 0, high = cycles.length;
  while (low < high) {
    const middle = (low + high) >> 1;
    if (cycles[middle].t <= t) low = middle + 1;
    else high = middle;
  }
  return low;
}
