// Time plots of the last seconds: lines with a common time axis.

import { Room } from "./room.js";

export const SECONDS = 10;

const LEFT = 46, RIGHT = 10, TOP = 18, BOTTOM = 18, TICK_S = 2;

export class Plot {
  // title with unit; range: the least span of the axis [low, high].
  constructor(canvas, title, range, changed) {
    Object.assign(this, { title, range, room: new Room(canvas, changed) });
    this.ink = this.room.ink;
  }

  // lines: [{cycles, value(cycle), colour, dash}], all of cycles by time; now in ms; marks: [ms].
  draw(lines, now, marks, colours) {
    const { width, height, ratio } = this.room, { ink } = this;
    if (!width) return;
    ink.setTransform(ratio, 0, 0, ratio, 0, 0);
    ink.fillStyle = colours.card;
    ink.fillRect(0, 0, width + 1, height + 1);
    const bottom = height - BOTTOM, right = width - RIGHT;
    const [low, high, step] = this.axis(lines);
    const x = (t) => right + (t - now) / (1000 * SECONDS) * (right - LEFT);
    const y = (value) => bottom - (value - low) / (high - low) * (bottom - TOP);
    this.grid(low, high, step, y, right, colours);
    this.seconds(x, now, bottom, colours);
    ink.save();
    ink.beginPath();
    ink.rect(LEFT, TOP - 4, right - LEFT, bottom - TOP + 8);
    ink.clip();
    ink.strokeStyle = colours.soft;
    ink.lineWidth = 1;
    for (const mark of marks) {
      ink.beginPath();
      ink.moveTo(x(mark), TOP);
      ink.lineTo(x(mark), bottom);
      ink.stroke();
    }
    for (const line of lines) this.line(line, x, y);
    ink.restore();
  }

  axis(lines) {
    let [low, high] = this.range;
    for (const { cycles, value } of lines) {
      for (const cycle of cycles) {
        const each = value(cycle);
        if (each < low) low = each;
        if (each > high) high = each;
      }
    }
    if (low > this.range[0] - 0.05 * (high - low)) low = this.range[0]; // noise below 0 needs no line of its own
    const span = (high - low) / 4, power = 10 ** Math.floor(Math.log10(span));
    const step = power * [1, 2, 5, 10].find((each) => each * power >= span);
    return [Math.floor(low / step) * step, Math.ceil(high / step) * step, step];
  }

  grid(low, high, step, y, right, colours) {
    const { ink } = this;
    ink.font = "11px system-ui, sans-serif";
    ink.textBaseline = "middle";
    ink.textAlign = "right";
    ink.lineWidth = 1;
    for (let value = low; value <= high + step / 2; value += step) {
      ink.strokeStyle = Math.abs(value) < step / 2 ? colours.soft : colours.line;
      ink.beginPath();
      ink.moveTo(LEFT, Math.round(y(value)) + 0.5);
      ink.lineTo(right, Math.round(y(value)) + 0.5);
      ink.stroke();
      ink.fillStyle = colours.soft;
      const rounded = Math.abs(value) < step / 2 ? 0 : Number(value.toPrecision(3));
      ink.fillText(String(rounded).replace("-", "−"), LEFT - 6, y(value));
    }
    ink.textAlign = "left";
    ink.textBaseline = "alphabetic";
    ink.fillStyle = colours.ink;
    ink.font = "600 12px system-ui, sans-serif";
    const fits = LEFT + ink.measureText(this.title).width <= this.room.width;
    ink.fillText(fits ? this.title : this.title.split(" (")[0], LEFT, 11);
  }

  // The time axis: seconds before the shown time.
  seconds(x, now, bottom, colours) {
    const { ink } = this;
    ink.font = "11px system-ui, sans-serif";
    ink.textBaseline = "alphabetic";
    ink.fillStyle = colours.soft;
    for (let ago = 0; ago <= SECONDS; ago += TICK_S) {
      ink.textAlign = ago === 0 ? "right" : ago === SECONDS ? "left" : "center";
      ink.fillText(ago ? `−${ago}` : "0 s", x(now - 1000 * ago), bottom + 14);
    }
    ink.textAlign = "left";
  }

  line({ cycles, value, colour, dash }, x, y) {
    const { ink } = this;
    ink.beginPath();
    let drawn = false, last = -Infinity;
    for (const cycle of cycles) {
      const each = value(cycle);
      if (each !== each) { drawn = false; continue; }
      if (drawn && cycle.t - last < 200) ink.lineTo(x(cycle.t), y(each));
      else ink.moveTo(x(cycle.t), y(each));
      drawn = true;
      last = cycle.t;
    }
    ink.strokeStyle = colour;
    ink.lineWidth = dash ? 1.4 : 2;
    ink.setLineDash(dash ?? []);
    ink.lineJoin = "round";
    ink.stroke();
  }
}
