/**
 * Power series of the stress at points of one material on a path F = I + Σ sᵏ H_k, term by term, as
 * `surrogate/series/measured_series.py`. The part of P_k that follows from the terms before is that
 * with H_k = 0.
 */

import {
  DILATION,
  FIBRES,
  FIRST,
  outputSeries,
  runSeries,
  SECOND,
  sum,
  VOLUME,
  type Law,
  type Values,
} from "./tape";
import {
  addContraction,
  addCross,
  addDyad,
  addProduct,
  addTraceMinus,
  applied,
  trace,
} from "./tensors";

export class StressSeries {
  /** H_k, cof F of order k, and cof F × F, from k = 1 on. */
  private readonly h: Float64Array[] = [];
  private readonly c: Float64Array[] = [];
  private readonly x: Float64Array[] = [];
  private readonly pressure: Values[] = [];
  /** Slots of the tape of every order, from 1 on. */
  private readonly slots: Values[][] = [];
  private gains: Values[] = [];

  /** @param fibres - directions of the families of the law, (d, n) each */
  constructor(
    private readonly law: Law,
    private readonly d: number,
    private readonly n: number,
    private readonly fibres: readonly Float64Array[],
  ) {}

  /** Set the measures of the next order as if H were zero; J. */
  begin(): Float64Array {
    const { d, n, h, c, x, law, fibres } = this;
    const k = h.length + 1;
    const cofactors = this.tensor();
    for (let j = 1; d === 3 && 2 * j <= k; j++)
      addCross(cofactors, h[j - 1], h[k - j - 1], d, 2 * j === k ? 0.5 : 1);
    const volume = new Float64Array(n);
    for (let j = 1; j < k; j++) addContraction(volume, h[j - 1], c[k - j - 1], j / k);
    const measures = new Array<Values>(law.count).fill(null);
    measures[VOLUME] = volume;
    if (law.used.includes(FIRST)) measures[FIRST] = products(h, h, n);
    if (law.used.includes(SECOND)) {
      measures[SECOND] = sum([2, trace(cofactors, d)], [1, products(c, c, n)]);
      const crossed = this.tensor();
      addTraceMinus(crossed, cofactors, d);
      for (let j = 1; j < k; j++) addCross(crossed, c[j - 1], h[k - j - 1], d);
      x.push(crossed);
    }
    c.push(cofactors);
    h.push(this.tensor());
    fibres.forEach((a, family) => {
      [h, c].forEach((terms, i) => {
        const along = alongOf(terms, a);
        measures[FIBRES + 2 * family + i] = sum(
          ...along.map((v, j): [number, Values] => [1, dot(v, along[k - j], n)]),
        );
      });
    });
    this.slots.push(measures);
    return volume;
  }

  /** Run the tape for the next order, with θ of elements that have one; ∂ψ/∂θ. */
  scalars(dilation: Values): Float64Array {
    this.slots[this.slots.length - 1][DILATION] = dilation;
    runSeries(this.law, this.slots);
    const series = outputSeries(this.law, DILATION, this.slots);
    return (series[series.length - 1] as Values) ?? new Float64Array(this.n);
  }

  /** P of the next order without H, with p of this order. */
  stress(pressure: Values): Float64Array {
    const { d, h, c, x, law, fibres } = this;
    const k = h.length;
    this.pressure.push(pressure);
    const total = this.tensor();
    const first = this.series(FIRST);
    const second = this.series(SECOND);
    const volume = this.series(VOLUME);
    for (let i = 0; i < d; i++) {
      const diagonal = total.subarray(i * (d + 1) * this.n, (i * (d + 1) + 1) * this.n);
      const unit = new Float64Array(this.n).fill(1);
      addProduct(diagonal, first[k], unit, 2);
      addProduct(diagonal, second[k], unit, 4);
      addProduct(diagonal, volume[k], unit);
    }
    for (let j = 1; j <= k; j++) {
      if (j < k) addProduct(total, first[k - j], h[j - 1], 2);
      addProduct(total, volume[k - j], c[j - 1]);
      if (law.used.includes(SECOND)) addProduct(total, second[k - j], x[j - 1], 2);
    }
    fibres.forEach((a, family) => {
      const stretch = this.series(FIBRES + 2 * family);
      const area = this.series(FIBRES + 2 * family + 1);
      const dyads = [h, c].map((terms) =>
        alongOf(terms, a).map((v) => {
          const dyad = this.tensor();
          addDyad(dyad, v, a, d);
          return dyad;
        }),
      );
      for (let j = 0; j <= k; j++) {
        addProduct(total, stretch[k - j], dyads[0][j], 2);
        const crossed = this.tensor(); // of order j of F × (cof F a ⊗ a)
        addTraceMinus(crossed, dyads[1][j], d);
        for (let m = 1; m <= j && d === 3; m++) addCross(crossed, h[m - 1], dyads[1][j - m], d);
        addProduct(total, area[k - j], crossed, 2);
      }
    });
    return total;
  }

  /** Set H of the order that was begun, and what θ gains by it. */
  complete(slope: Float64Array, dilation: Values): void {
    const { d, h, c, x, law, slots } = this;
    const k = h.length - 1;
    h[k] = slope;
    const turned = this.tensor();
    addTraceMinus(turned, slope, d);
    addProduct(c[k], 1, turned);
    if (law.used.includes(SECOND)) {
      addTraceMinus(x[k], turned, d);
      addProduct(x[k], 1, turned);
    }
    const ofSlope = trace(slope, d);
    this.gains = [sum([2, ofSlope]), sum([4, ofSlope]), ofSlope, dilation];
    for (const a of this.fibres) {
      const along = dot(a, applied(slope, a), this.n);
      const square = dot(a, a, this.n).map((value, p) => value * ofSlope[p]);
      this.gains.push(sum([2, along]), sum([2, square], [-2, along]));
    }
    const last = slots[k];
    law.slopes.forEach((slopes, slot) => {
      if (slopes.some((factor, a) => factor !== 0 && this.gains[a]))
        last[slot] = sum([1, last[slot]], [1, this.gain(slot)]);
    });
  }

  /** What ∂ψ/∂θ of the order that was completed gains by H. */
  pressureGain(): Float64Array {
    const slot = this.law.stress.outputs[DILATION];
    return (slot < 0 ? null : this.gain(slot)) ?? new Float64Array(this.n);
  }

  /** Add to p of the order that was completed. */
  press(pressure: Float64Array): void {
    const last = this.pressure.length - 1;
    this.pressure[last] = sum([1, this.pressure[last]], [1, pressure]);
  }

  private gain(slot: number): Values {
    return sum(...this.law.slopes[slot].map((x, a): [number, Values] => [x, this.gains[a]]));
  }

  /** ψ_a of the orders 0 to k, with p in that by J. */
  private series(measure: number): (number | Values)[] {
    const found: (number | Values)[] = outputSeries(this.law, measure, this.slots);
    if (measure !== VOLUME) return found;
    return found.map((value, order) =>
      order === 0
        ? (value as number) + outputSeries(this.law, DILATION, [])[0]
        : sum([1, value as Values], [1, this.pressure[order - 1]]),
    );
  }

  private tensor(): Float64Array {
    return new Float64Array(this.d * this.d * this.n);
  }
}

/** Σ A_j : B_{k−j}, 1 ≤ j < k, of lists that begin with order 1 and end with k − 1. */
function products(a: readonly Float64Array[], b: readonly Float64Array[], n: number): Values {
  const found = new Float64Array(n);
  a.forEach((term, j) => {
    addContraction(found, term, b[a.length - 1 - j]);
  });
  return found;
}

/** Terms from order 0 on of a series of tensors that begins with I, times a direction. */
function alongOf(terms: readonly Float64Array[], a: Float64Array): Float64Array[] {
  return [a, ...terms.map((term) => applied(term, a))];
}

function dot(a: Float64Array, b: Float64Array, n: number): Float64Array {
  const found = new Float64Array(n);
  addContraction(found, a, b);
  return found;
}
