// The colour scale beside the maps.

// The largest of some values, signs left out and NaN passed over.
export function highest(values) {
  let most = 0;
  for (const value of values) if (Math.abs(value) > most) most = Math.abs(value);
  return most;
}

export function drawScale(canvas, scale, colours) {
  const ratio = devicePixelRatio, box = canvas.getBoundingClientRect(), ink = canvas.getContext("2d");
  const key = [box.width, box.height, ratio, scale.most, scale.signed, colours.ink].join();
  if (canvas.dataset.drawn === key || !box.width) return;
  canvas.dataset.drawn = key;
  canvas.width = Math.round(box.width * ratio);
  canvas.height = Math.round(box.height * ratio);
  ink.setTransform(ratio, 0, 0, ratio, 0, 0);
  const top = 7, bottom = box.height - 7, wide = 12;
  for (let y = top; y < bottom; y++) {
    ink.fillStyle = scale.css(scale.most - (y - top) / (bottom - top) * (scale.most - scale.least));
    ink.fillRect(0, y, wide, 1.5);
  }
  ink.font = "11px system-ui, sans-serif";
  ink.textBaseline = "middle";
  ink.fillStyle = colours.soft;
  const ticks = scale.signed ? 4 : box.height > 220 ? 6 : 3;
  for (let i = 0; i <= ticks; i++) {
    const value = scale.least + i / ticks * (scale.most - scale.least), y = bottom - i / ticks * (bottom - top);
    ink.fillText(String(Math.round(value)).replace("-", "−") + (i === ticks ? "+" : ""), wide + 5, y);
  }
}
