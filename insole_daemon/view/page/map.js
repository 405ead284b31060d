// The map of one insole: its values, its faulty parts, the centre of pressure and its trail.

import { INVALID, SATURATED, STALE } from "./packets.js";
import { Field } from "./field.js";
import { hull, outline } from "./outline.js";
import { Room } from "./room.js";

const PADS = new Set([6, 10]); // thermal, of the 12 taxels of a triangle
const STEP_MM = 1.5, MARGIN_MM = 5, TAXEL_MM = 2.6, STALE_MM = 9;
export const TRAIL_MS = 1500;

// Faults whose part is masked; a saturated taxel has its own mark.
const DISBELIEVED = new Set(["board_silent", "board_address_clash", "board_rezeroed", "triangle_loose", "taxel_dead", "taxel_stuck"]);

export class FootMap {
  constructor(canvas, changed) {
    const room = new Room(canvas, () => { this.drawn = ""; changed(); });
    this.canvas = canvas;
    this.ink = room.ink;
    this.small = document.createElement("canvas");
    this.under = document.createElement("canvas"); // sole and hatching: drawn anew only when it changes
  }

  describe(meta) {
    this.triangles = meta.triangles;
    this.minForce = meta.min_force_n;
    const all = Array.from({ length: meta.n_triangles * 12 }, (_, i) => [meta.xy_mm[2 * i], meta.xy_mm[2 * i + 1]]);
    this.index = all.map((_, i) => i).filter((i) => !PADS.has(i % 12)); // taxels that bear pressure
    this.places = this.index.map((i) => all[i]);
    this.hulls = meta.triangles.map((_, row) => hull(all.slice(12 * row, 12 * row + 12)));
    this.line = outline(this.places);
    this.field = new Field(this.places, this.line, STEP_MM);
    this.values = new Float32Array(meta.n_triangles * 12);
    this.used = new Float32Array(this.index.length);
    this.noLoad = Float32Array.from(all, (_, i) => {
      const own = meta.triangles[Math.floor(i / 12)].board;
      return meta.boards.find((board) => board.address === own).no_load;
    });
    this.small.width = this.field.width;
    this.small.height = this.field.height;
    this.drawn = "";
  }

  // Position on the canvas of a place of the foot: toes up, the wearer's left at the left, seen from above.
  place() {
    const xs = this.line.map(([x]) => x), ys = this.line.map(([, y]) => y);
    const front = Math.max(...xs) + MARGIN_MM, side = Math.max(...ys) + MARGIN_MM;
    const long = front - Math.min(...xs) + MARGIN_MM, wide = side - Math.min(...ys) + MARGIN_MM;
    const perMm = Math.min(this.canvas.height / long, this.canvas.width / wide);
    const top = (this.canvas.height - perMm * long) / 2, left = (this.canvas.width - perMm * wide) / 2;
    this.perMm = perMm;
    this.at = ([x, y]) => [left + perMm * (side - y), top + perMm * (front - x)];
    this.shape = this.path(this.line);
  }

  path(points) {
    const path = new Path2D();
    points.forEach((point, i) => (i ? path.lineTo(...this.at(point)) : path.moveTo(...this.at(point))));
    path.closePath();
    return path;
  }

  // The values of a cycle, NaN where not valid.
  read(cycle, quantity) {
    quantity.values(cycle, this.values, this.noLoad);
    this.index.forEach((i, k) => { this.used[k] = cycle.flags[i] ? NaN : this.values[i]; });
    return this.used;
  }

  draw(cycle, trail, faults, { scale, taxels, colours }) {
    if (!this.field || !this.canvas.width) return;
    const state = [cycle ? cycle.flags.join("") : "", colours.sole, colours.card].join();
    if (state !== this.drawn) this.lay(cycle, colours);
    this.drawn = state;
    const { ink } = this;
    ink.drawImage(this.under, 0, 0);
    if (!cycle) return;
    const pixels = this.small.getContext("2d");
    pixels.putImageData(this.field.paint(this.used, scale), 0, 0);
    ink.save();
    ink.clip(this.shape);
    const half = this.field.step / 2, [x, y] = this.at([this.field.top + half, this.field.start + half]);
    const size = this.perMm * this.field.step;
    ink.drawImage(this.small, x, y, size * this.field.width, size * this.field.height);
    if (taxels) { // pale, so that they stand out
      ink.globalAlpha = 0.65;
      ink.fillStyle = colours.card;
      ink.fillRect(0, 0, this.canvas.width, this.canvas.height);
    }
    ink.restore();
    ink.lineWidth = Math.max(1, 0.5 * this.perMm);
    ink.strokeStyle = colours.line;
    ink.stroke(this.shape);
    if (taxels) {
      this.drawTaxels(cycle, scale, colours);
      this.drawTriangles(colours);
    }
    const disbelieved = faults.filter(({ kind }) => DISBELIEVED.has(kind));
    this.drawSaturated(cycle, disbelieved);
    this.drawFaults(disbelieved, colours);
    this.drawCentre(trail, cycle);
    if (taxels) this.nameTriangles(colours); // above everything, to be read
  }

  // The sole with its unknown parts hatched; stale parts are hatched in the other direction.
  lay(cycle, colours) {
    this.place();
    this.under.width = this.canvas.width;
    this.under.height = this.canvas.height;
    const ink = this.under.getContext("2d", { alpha: false });
    ink.fillStyle = colours.card;
    ink.fillRect(0, 0, this.under.width, this.under.height);
    // The field is painted over it where values are known, so the hatching shows where they are not.
    ink.fillStyle = cycle?.flags.some((flags) => flags & INVALID) ? hatching(ink, colours, false, this.perMm) : colours.sole;
    ink.fill(this.shape);
    ink.save();
    ink.clip(this.shape);
    const stale = new Path2D();
    this.index.forEach((i, k) => {
      if (!cycle || !(cycle.flags[i] & STALE)) return;
      const [x, y] = this.at(this.places[k]);
      stale.moveTo(x, y);
      stale.arc(x, y, STALE_MM * this.perMm, 0, 2 * Math.PI);
    });
    ink.fillStyle = hatching(ink, colours, true, this.perMm);
    ink.fill(stale);
    ink.restore();
    ink.strokeStyle = colours.line;
    ink.stroke(this.shape);
  }

  drawTaxels(cycle, scale, colours) {
    const { ink, perMm } = this;
    this.index.forEach((i, k) => {
      const [x, y] = this.at(this.places[k]), value = this.used[k];
      ink.beginPath();
      if (value === value) {
        ink.arc(x, y, TAXEL_MM * perMm, 0, 2 * Math.PI);
        ink.fillStyle = scale.css(value);
        ink.fill();
      } else {
        const arm = 0.6 * TAXEL_MM * perMm;
        ink.moveTo(x - arm, y - arm);
        ink.lineTo(x + arm, y + arm);
        ink.moveTo(x + arm, y - arm);
        ink.lineTo(x - arm, y + arm);
        ink.strokeStyle = colours.ink;
        ink.stroke();
      }
    });
  }

  drawTriangles(colours) {
    const { ink } = this;
    ink.lineWidth = 1;
    ink.strokeStyle = colours.soft;
    for (const own of this.hulls) ink.stroke(this.path(own));
  }

  // The number of each triangle, as board.triangle.
  nameTriangles(colours) {
    const { ink, perMm } = this;
    ink.font = `600 ${Math.max(9, 4 * perMm)}px system-ui, sans-serif`;
    ink.textAlign = "center";
    ink.textBaseline = "middle";
    ink.lineJoin = "round";
    this.triangles.forEach(({ board, triangle }, row) => {
      const middle = [0, 1].map((axis) => this.hulls[row].reduce((sum, place) => sum + place[axis], 0) / this.hulls[row].length);
      ink.lineWidth = Math.max(3, 0.9 * perMm);
      ink.strokeStyle = colours.card;
      ink.fillStyle = colours.ink;
      ink.strokeText(`${board}.${triangle}`, ...this.at(middle));
      ink.fillText(`${board}.${triangle}`, ...this.at(middle));
    });
  }

  drawSaturated(cycle, faults) {
    const { ink, perMm } = this;
    this.index.forEach((i, k) => {
      if (!(cycle.flags[i] & SATURATED) || cycle.flags[i] & STALE) return;
      if (faults.some((fault) => concerns(fault, this.triangles[Math.floor(i / 12)]))) return;
      const [x, y] = this.at(this.places[k]);
      for (const [half, colour] of [[1.9, "#000"], [1.2, "#fff"]]) {
        ink.fillStyle = colour;
        ink.fillRect(x - half * perMm, y - half * perMm, 2 * half * perMm, 2 * half * perMm);
      }
    });
  }

  // A dashed line around a faulty part: a taxel, a triangle, or all triangles of a board.
  drawFaults(faults, colours) {
    const { ink, perMm } = this;
    ink.save();
    ink.strokeStyle = colours.alarm;
    ink.lineWidth = Math.max(1.5, 0.9 * perMm);
    ink.setLineDash([2.4 * perMm, 1.6 * perMm]);
    for (const fault of faults) {
      this.triangles.forEach((triangle, row) => {
        if (!concerns(fault, triangle)) return;
        if (fault.taxel === null) return ink.stroke(this.path(this.hulls[row]));
        const [x, y] = this.at(this.places[this.index.indexOf(12 * row + fault.taxel)] ?? [NaN, NaN]);
        ink.beginPath();
        ink.arc(x, y, 1.4 * TAXEL_MM * perMm, 0, 2 * Math.PI);
        ink.stroke();
      });
    }
    ink.restore();
  }

  drawCentre(trail, cycle) {
    const { ink, perMm } = this;
    ink.lineCap = "round";
    for (const [width, colour] of [[2, "#000"], [1, "#fff"]]) {
      ink.lineWidth = width * perMm;
      ink.strokeStyle = colour;
      for (let i = 1; i < trail.length; i++) {
        const [from, to] = [trail[i - 1], trail[i]];
        if (from.copX !== from.copX || to.copX !== to.copX || to.t - from.t > 100) continue;
        ink.globalAlpha = Math.max(0, 1 - (cycle.t - to.t) / TRAIL_MS);
        ink.beginPath();
        ink.moveTo(...this.at([1e3 * from.copX, 1e3 * from.copY]));
        ink.lineTo(...this.at([1e3 * to.copX, 1e3 * to.copY]));
        ink.stroke();
      }
    }
    ink.globalAlpha = 1;
    if (cycle.refFz >= this.minForce) {
      const [x, y] = this.at([-1e3 * cycle.refMy / cycle.refFz, 1e3 * cycle.refMx / cycle.refFz]), arm = 3.2 * perMm;
      ink.beginPath();
      ink.moveTo(x, y - arm);
      ink.lineTo(x + arm, y);
      ink.lineTo(x, y + arm);
      ink.lineTo(x - arm, y);
      ink.closePath();
      ink.lineWidth = 1.6 * perMm;
      ink.strokeStyle = "#000";
      ink.stroke();
      ink.lineWidth = 0.8 * perMm;
      ink.strokeStyle = "#fff";
      ink.stroke();
    }
    if (cycle.copX === cycle.copX) {
      ring(ink, ...this.at([1e3 * cycle.copX, 1e3 * cycle.copY]), 3 * perMm, 1.2 * perMm, "#fff", "#000");
    }
  }
}

function concerns(fault, { board, triangle }) {
  return fault.board === board && (fault.triangle === null || fault.triangle === triangle);
}

function ring(ink, x, y, radius, width, inner, outer) {
  for (const [extra, colour] of [[1, outer], [0, inner]]) {
    ink.beginPath();
    ink.arc(x, y, radius, 0, 2 * Math.PI);
    ink.lineWidth = width * (1 + extra);
    ink.strokeStyle = colour;
    ink.stroke();
  }
}

function hatching(ink, colours, falls, perMm) {
  const size = Math.max(4, Math.round(2.6 * perMm)), tile = document.createElement("canvas");
  tile.width = tile.height = size;
  const own = tile.getContext("2d");
  own.fillStyle = colours.card;
  own.fillRect(0, 0, size, size);
  own.strokeStyle = colours.hatch;
  own.lineWidth = size / 4;
  own.beginPath();
  for (const shift of [-size, 0, size]) {
    own.moveTo(shift, falls ? 0 : size);
    own.lineTo(shift + size, falls ? size : 0);
  }
  own.stroke();
  return ink.createPattern(tile, "repeat");
}
