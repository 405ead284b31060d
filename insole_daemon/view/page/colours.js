// Colours: of values, perceptually uniform; of feet, told apart with any colour vision; of marks, from the style sheet.

const STEPS = 256;

// viridis (van der Walt and Smith), as polynomials in the value.
const VIRIDIS = [
  [0.2777273272, 0.1050930431, -0.3308618287, -4.6342304990, 6.2282699363, 4.7763849977, -5.4354558559],
  [0.0054073445, 1.4046135299, 0.2148475595, -5.7991009734, 14.1799333668, -13.7451453777, 4.6458526122],
  [0.3340998053, 1.3845901626, 0.0950951630, -19.3324409563, 56.6905526007, -65.3530326334, 26.3124352496],
];
// From blue over grey to red, alike in lightness on both sides (after ColorBrewer's RdBu).
const DIVERGING = [[33, 102, 172], [103, 169, 207], [232, 232, 232], [239, 138, 98], [178, 24, 43]];

function viridis(part) {
  return VIRIDIS.map((terms) => 255 * terms.reduceRight((sum, term) => sum * part + term, 0));
}

function diverging(part) {
  const place = part * (DIVERGING.length - 1), low = Math.min(Math.floor(place), DIVERGING.length - 2);
  return DIVERGING[low].map((from, i) => from + (place - low) * (DIVERGING[low + 1][i] - from));
}

function table(colour) {
  return Uint32Array.from({ length: STEPS }, (_, i) => {
    const [r, g, b] = colour(i / (STEPS - 1)).map((each) => Math.min(255, Math.max(0, Math.round(each))));
    return (255 << 24 | b << 16 | g << 8 | r) >>> 0; // as ImageData has it
  });
}

const SEQUENTIAL = table(viridis), SIGNED = table(diverging);

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

// What the style sheet says, read again when the theme changes.
export function theme() {
  const style = getComputedStyle(document.documentElement);
  const names = ["ink", "soft", "line", "card", "sole", "hatch", "alarm", "left", "right", "sum"];
  return Object.fromEntries(names.map((name) => [name, style.getPropertyValue(`--${name}`).trim()]));
}
