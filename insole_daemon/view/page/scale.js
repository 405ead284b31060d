// The colour scale beside the maps.

const FEW = 6;

// The largest absolute value, ignoring NaN.
export function highest(values) {
  let most = 0;
  for (const value of values) if (Math.abs(value) > most) most = Math.abs(value);
  return most;
}

// A value that a few taxels reach: a single one may be out of its range.
export function peakOf(values) {
  const sizes = Float32Array.from(values, Math.abs).filter((size) => size > 0).sort();
  return sizes.at(-FEW) ?? 0;
}

export function drawScale(room, scale, colours) {
  const { width, height, ratio, ink } = room, key = [width, height, ratio, scale.most, scale.signed, colours.ink].join();
  if (room.drawn === key || !width) return;
  room.drawn = key;
  ink.setTransform(ratio, 0, 0, ratio, 0, 0);
  ink.fillStyle = colours.card;
  ink.fillRect(0, 0, width + 1, height + 1);
  const top = 7, bottom = height - 7, wide = 12;
  for (let y = top; y < bottom; y++) {
    ink.fillStyle = scale.css(scale.most - (y - top) / (bottom - top) * (scale.most - scale.least));
    ink.fillRect(0, y, wide, 1.5);
  }
  ink.font = "11px system-ui, sans-serif";
  ink.textBaseline = "middle";
  ink.fillStyle = colours.soft;
  const ticks = scale.signed ? 4 : height > 220 ? 6 : 3;
  for (let i = 0; i <= ticks; i++) {
    const value = scale.least + i / ticks * (scale.most - scale.least), y = bottom - i / ticks * (bottom - top);
    ink.fillText(String(Math.round(value)).replace("-", "−") + (i === ticks ? "+" : ""), wide + 5, y);
  }
}
