// From the values of the taxels to those of a fine grid: the mean of the nearest, the nearer the more.

const NEAREST = 7, SPREAD_MM = 5.5;
const KNOWN = 0.4; // of the weight around a place must be valid, or what lies there is not known

export class Field {
  // places: [[x, y], …] mm of the taxels; line: the outline; step: of the grid in mm.
  constructor(places, line, step) {
    const xs = line.map(([x]) => x), ys = line.map(([, y]) => y);
    this.step = step;
    this.top = Math.max(...xs); // x of the first row: toes up
    this.start = Math.max(...ys); // y of the first column: the wearer's left is at the left
    this.height = Math.ceil((this.top - Math.min(...xs)) / step) + 1;
    this.width = Math.ceil((this.start - Math.min(...ys)) / step) + 1;
    const n = this.width * this.height;
    this.taxel = new Uint16Array(n * NEAREST);
    this.weight = new Float32Array(n * NEAREST);
    this.image = new ImageData(this.width, this.height);
    this.pixels = new Uint32Array(this.image.data.buffer);
    for (let row = 0; row < this.height; row++) {
      for (let column = 0; column < this.width; column++) {
        this.weigh(places, row * this.width + column, this.top - row * step, this.start - column * step);
      }
    }
  }

  weigh(places, at, x, y) {
    const near = places.map(([px, py], i) => [(px - x) ** 2 + (py - y) ** 2, i]);
    const chosen = [];
    for (const each of near) { // the NEAREST smallest, without sorting them all
      if (chosen.length === NEAREST && each[0] >= chosen[NEAREST - 1][0]) continue;
      let place = chosen.length === NEAREST ? NEAREST - 1 : chosen.length;
      while (place > 0 && chosen[place - 1][0] > each[0]) { chosen[place] = chosen[place - 1]; place--; }
      chosen[place] = each;
    }
    // From the nearest on, so that far from all the weights are still some.
    const weights = chosen.map(([squared]) => Math.exp(-(squared - chosen[0][0]) / (2 * SPREAD_MM ** 2)));
    const total = weights.reduce((sum, each) => sum + each, 0);
    chosen.forEach(([, i], k) => {
      this.taxel[at * NEAREST + k] = i;
      this.weight[at * NEAREST + k] = weights[k] / total;
    });
  }

  // Paint the image: values (n), NaN where not known, by a Scale.
  paint(values, scale) {
    const { taxel, weight, pixels } = this;
    for (let at = 0, k = 0; at < pixels.length; at++) {
      let sum = 0, known = 0;
      for (const end = k + NEAREST; k < end; k++) {
        const value = values[taxel[k]];
        if (value === value) { sum += weight[k] * value; known += weight[k]; }
      }
      pixels[at] = known < KNOWN ? 0 : scale.packed(sum / known);
    }
    return this.image;
  }
}
