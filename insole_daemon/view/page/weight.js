// The force of both feet in body weights, from the mass that a person enters or else from the mean force.

const GRAVITY_M_S2 = 9.81;
const LEAST_N = 150; // a mean below is nobody's weight

export class Weight {
  constructor(input, output) {
    Object.assign(this, { input, output, sums: [], words: "" });
    try { input.value = localStorage.getItem("mass") ?? ""; } catch { /* a browser that keeps nothing */ }
    input.addEventListener("change", () => { try { localStorage.setItem("mass", input.value); } catch { /* as above */ } });
  }

  // Sum the cycles of both feet: each of one foot with the newest of the other before it.
  weigh({ left, right }) {
    const sums = [];
    for (let i = 0, k = 0; i < left.length && right.length; i++) {
      while (k + 1 < right.length && right[k + 1].t <= left[i].t) k++;
      if (Math.abs(right[k].t - left[i].t) < 100) sums.push({ t: left[i].t, newtons: left[i].fz + right[k].fz });
    }
    const known = sums.map(({ newtons }) => newtons).filter((newtons) => newtons === newtons);
    const mean = known.reduce((sum, each) => sum + each, 0) / known.length;
    const typed = Number(this.input.value) * GRAVITY_M_S2;
    const weight = typed > 0 ? typed : mean >= LEAST_N ? mean : NaN;
    for (const each of sums) each.bodyWeights = each.newtons / weight;
    this.sums = sums;
    this.words = weight === weight ? `1 body weight = ${weight.toFixed(0)} N${typed > 0 ? "" : ", the mean shown"}` : "";
  }

  say() {
    if (this.output.textContent !== this.words) this.output.textContent = this.words;
  }
}
