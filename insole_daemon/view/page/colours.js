// Colours of values (perceptually uniform), of feet (for any colour vision), and of marks (from the style sheet).

const STEPS = 256;

// viridis (van der Walt and Smith) at 0, 1/8, …, 1, as in report/colours.py.
const VIRIDIS = [
  [68, 1, 84], [71, 45, 123], [59, 82, 139], [44, 114, 142], [33, 145, 140],
  [40, 174, 128], [94, 201, 98], [173, 220, 48], [253, 231, 37],
];
// From blue over grey to red, with symmetric lightness (after ColorBrewer's RdBu).
const DIVERGING = [[33, 102, 172], [103, 169, 207], [232, 232, 232], [239, 138, 98], [178, 24, 43]];

function table(anchors) {
  return Uint32Array.from({ length: STEPS }, (_, i) => {
    const place = i / (STEPS - 1) * (anchors.length - 1), low = Math.min(Math.floor(place), anchors.length - 2);
    const [r, g, b] = anchors[low].map((from, k) => Math.round(from + (place - low) * (anchors[low + 1][k] - from)));
    return (255 << 24 | b << 16 | g << 8 | r) >>> 0; // as ImageData has it
  });
}

const SEQUENTIAL = table(VIRIDIS), SIGNED = table(DIVERGING);

// Colour of a value on a scale to `most`, from 0 or, if signed, from −most.
export class Scale {
  constructor(most, signed) {
    this.most = most;
    this.signed = signed;
    this.colours = signed ? SIGNED : SEQUENTIAL;
  }

  get least() {
    return this.signed ? -this.most : 0;
  }

  packed(value) {
    const part = (value - this.least) / (this.most - this.least);
    return this.colours[part <= 0 ? 0 : part >= 1 ? STEPS - 1 : Math.round(part * (STEPS - 1))];
  }

  css(value) {
    const packed = this.packed(value);
    return `rgb(${packed & 255} ${packed >> 8 & 255} ${packed >> 16 & 255})`;
  }
}

// Colours of the style sheet, read again when the theme changes.
export function theme() {
  const style = getComputedStyle(document.documentElement);
  const names = ["ink", "soft", "line", "card", "sole", "hatch", "alarm", "left", "right", "sum"];
  return Object.fromEntries(names.map((name) => [name, style.getPropertyValue(`--${name}`).trim()]));
}
