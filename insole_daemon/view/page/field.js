// Interpolation of the taxels' values to a fine grid: a mean of the nearest taxels, weighted by distance.

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
    const px = Float32Array.from(places, ([x]) => x), py = Float32Array.from(places, ([, y]) => y);
    for (let row = 0, at = 0; row < this.height; row++) {
      for (let column = 0; column < this.width; column++, at++) {
        this.weigh(px, py, at * NEAREST, this.top - row * step, this.start - column * step);
      }
    }
  }

  // Store the nearest taxels of a place and their weights from `at` on. It allocates no arrays: there are 20 000 places.
  weigh(px, py, at, x, y) {
    const { taxel, weight } = this, end = at + NEAREST;
    weight.fill(Infinity, at, end); // squares of distances, at first
    for (let i = 0; i < px.length; i++) {
      const squared = (px[i] - x) ** 2 + (py[i] - y) ** 2;
      let k = end - 1;
      if (squared >= weight[k]) continue;
      for (; k > at && weight[k - 1] > squared; k--) { weight[k] = weight[k - 1]; taxel[k] = taxel[k - 1]; }
      weight[k] = squared;
      taxel[k] = i;
    }
    const nearest = weight[at]; // measured from there, so that far from all the weights are still some
    let total = 0;
    for (let k = at; k < end; k++) total += weight[k] = Math.exp((nearest - weight[k]) / (2 * SPREAD_MM ** 2));
    for (let k = at; k < end; k++) weight[k] /= total;
  }

  // Paint the image: values (n), NaN where unknown, with a Scale.
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
