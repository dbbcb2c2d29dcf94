/**
 * Series of the Neo-Hookean stress on a path F = I + Σ_k t^k H_k, as `surrogate/series/stress_series.py`:
 *
 *   C_k = (tr H_k) I − H_kᵀ + ½ Σ_j H_j × H_{k−j},  k J_k = Σ_j j C_{k−j}:H_j,  R_k = −Σ_j J_j R_{k−j},
 *   P_k = μ H_k + Σ_j s_{k−j} C_j,  s_k = g J_k − d R_k,  C_0 = I,  J_0 = R_0 = 1,  s_0 = −μ
 *
 * of the cofactors, J, 1/J and the stress, term by term. The cross products are zero in the plane.
 */

import type { Material } from "./solid";

const NEXT = [1, 2, 0];
const LAST = [2, 0, 1];

export class StressSeries {
  private readonly growth: number;
  private readonly decay: number;
  private readonly points: number;
  /** H_k, C_k, (points, d, d), and J_k, R_k, s_k, (points), from k = 0 on. */
  private readonly h: Float64Array[];
  private readonly c: Float64Array[];
  private readonly j: Float64Array[];
  private readonly r: Float64Array[];
  private readonly s: Float64Array[];

  /**
   * @param material - of the body
   * @param d - number of space dimensions
   * @param first - H_1, (points, d, d)
   */
  constructor(
    material: Material,
    private readonly d: number,
    first: Float64Array,
  ) {
    const { lambda, mu, volumetric } = material;
    this.growth = volumetric === "paper" ? lambda / 2 : lambda;
    this.decay = lambda + mu - this.growth;
    this.points = first.length / (d * d);
    const one = new Float64Array(this.points).fill(1);
    const unit = first.map((_, i) => ((i % (d * d)) % (d + 1) === 0 ? 1 : 0));
    this.h = [unit];
    this.c = [unit];
    this.j = [one];
    this.r = [one];
    this.s = [one.map(() => -mu)];
    this.nextWithout();
    this.add(first);
  }

  /** The next P_k without the part that is linear in H_k, (points, d, d) in Pa. */
  nextWithout(): Float64Array {
    const { d, points, h, c, j, r, s, growth, decay } = this;
    const size = d * d;
    const k = h.length;
    const cofactors = new Float64Array(points * size);
    const jacobian = new Float64Array(points);
    const reciprocal = new Float64Array(points);
    for (let i = 1; i < k; i++) {
      if (d === 3) addCross(cofactors, h[i], h[k - i]);
      for (let point = 0; point < points; point++) {
        let product = 0;
        for (let a = point * size; a < (point + 1) * size; a++) product += h[i][a] * c[k - i][a];
        jacobian[point] += (i / k) * product;
        reciprocal[point] -= j[i][point] * r[k - i][point];
      }
    }
    for (let point = 0; point < points; point++) reciprocal[point] -= jacobian[point];
    c.push(cofactors);
    j.push(jacobian);
    r.push(reciprocal);
    s.push(jacobian.map((value, point) => growth * value - decay * reciprocal[point]));
    const stress = new Float64Array(points * size);
    for (let i = 0; i <= k; i++) {
      for (let a = 0; a < stress.length; a++) {
        stress[a] += s[k - i][Math.floor(a / size)] * c[i][a];
      }
    }
    return stress;
  }

  /** Set H_k, (points, d, d), after `nextWithout`. */
  add(gradient: Float64Array): void {
    const { d, points, h, c, j, r, s, growth, decay } = this;
    const k = h.length;
    h.push(gradient);
    for (let point = 0; point < points; point++) {
      const first = point * d * d;
      let trace = 0;
      for (let a = 0; a < d; a++) trace += gradient[first + a * (d + 1)];
      for (let a = 0; a < d; a++) {
        c[k][first + a * (d + 1)] += trace;
        for (let b = 0; b < d; b++) c[k][first + a * d + b] -= gradient[first + b * d + a];
      }
      j[k][point] += trace;
      r[k][point] -= trace;
      s[k][point] = growth * j[k][point] - decay * r[k][point];
    }
  }
}

/** Add ½ A × B of matrices, (points, 3, 3), together with ½ B × A once the order is the other. */
function addCross(sum: Float64Array, a: Float64Array, b: Float64Array): void {
  for (let first = 0; first < sum.length; first += 9) {
    for (let row = 0; row < 3; row++) {
      const [up, down] = [first + 3 * NEXT[row], first + 3 * LAST[row]];
      for (let column = 0; column < 3; column++) {
        const [left, right] = [NEXT[column], LAST[column]];
        sum[first + 3 * row + column] +=
          a[up + left] * b[down + right] - a[up + right] * b[down + left];
      }
    }
  }
}
