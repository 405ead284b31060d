// One cycle of one foot from its bytes; view/packets.py is the other half of this file.

const FLOATS = ["fz", "mx", "my", "copX", "copY", "validFraction", "ageMs",
  "refFz", "refMx", "refMy", "modelFz", "modelMx", "modelMy"];
const HEAD_BYTES = 80;
const KPA_PER_UNIT = 0.02;
const UNKNOWN = 0xffff;

export const FEET = ["left", "right"];
export const INVALID = 1, STALE = 2, SATURATED = 4;

export function decode(buffer) {
  const view = new DataView(buffer);
  if (view.getUint8(0) !== 1) return null;
  const triangles = view.getUint16(2, true), n = triangles * 12;
  const cycle = {
    foot: FEET[view.getUint8(1)],
    seq: view.getUint32(4, true),
    t: view.getFloat64(8, true), // ms since 1970
    published: view.getFloat64(16, true),
    triangles,
    units: new Uint16Array(buffer, HEAD_BYTES, n),
    predicted: new Uint16Array(buffer, HEAD_BYTES + 2 * n, n),
    counts: new Uint8Array(buffer, HEAD_BYTES + 4 * n, n),
    flags: new Uint8Array(buffer, HEAD_BYTES + 5 * n, n),
  };
  FLOATS.forEach((name, i) => { cycle[name] = view.getFloat32(24 + 4 * i, true); });
  return cycle;
}

// The quantities of the map: a value for every taxel, NaN where unknown.
export const QUANTITIES = {
  pressure: {
    unit: "kPa", fixed: [100, 200, 300, 400, 600], start: 300, least: 50, signed: false,
    values: (cycle, out) => {
      for (let i = 0; i < out.length; i++) out[i] = known(cycle.units[i]);
    },
  },
  counts: {
    unit: "counts below no-load", fixed: [32, 64, 128, 240], start: 64, least: 16, signed: false,
    values: (cycle, out, noLoad) => {
      for (let i = 0; i < out.length; i++) out[i] = Math.max(noLoad[i] - cycle.counts[i], 0);
    },
  },
  residual: {
    unit: "kPa, measured − simulated", fixed: [20, 50, 100, 200], start: 50, least: 10, signed: true,
    values: (cycle, out) => {
      for (let i = 0; i < out.length; i++) out[i] = known(cycle.units[i]) - known(cycle.predicted[i]);
    },
  },
};

function known(units) {
  return units === UNKNOWN ? NaN : units * KPA_PER_UNIT;
}
