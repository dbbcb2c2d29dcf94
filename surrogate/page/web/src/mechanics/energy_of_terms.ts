/**
 * Strain energy of Σ_k c_k u_k, and its derivatives by c, as `surrogate/series/least_energy.py`:
 *
 *   E = Σ_q w_q [μ/2 H:H + μ (e − ln (1 + e) − (e − tr H)) + U],  H = Σ_k c_k H_k,
 *   ∂E/∂c_k = Σ_q w_q [μ H:H_k + μ (e tr H_k − C:H_k) / J + J U' tr A_k],
 *   ∂²E/∂c_k∂c_l = Σ_q w_q [μ H_k:H_l + (μ − J U') tr A_k A_l + (J U' + J² U'') tr A_k tr A_l]
 *
 * with the gradients H_k of the terms, A_k = F⁻¹ H_k, e = J − 1 and C = cof F − I as polynomials of H:
 * all is of second order, so that nothing is lost where the gradients are small.
 */

import { invert } from "./elements";
import { volumetric, type Solid } from "./solid";

/** Strain energy in J of some coefficients, with its first and second derivatives by them. */
export interface EnergyOfTerms {
  energy: number;
  gradient: Float64Array;
  hessian: Float64Array;
}

/** Σ_q w_q H_k:H_k of every term. */
export function squares(solid: Solid, slopes: readonly Float64Array[]): Float64Array {
  const size = solid.d * solid.d;
  const { volumes } = solid;
  return Float64Array.from(slopes, (h) =>
    h.reduce((sum, value, i) => sum + volumes[Math.floor(i / size)] * value * value, 0),
  );
}

/**
 * E of some coefficients, infinite if a cell is inverted.
 *
 * @param slopes - H_k, (points, d, d) each
 */
export function energyOfTerms(
  solid: Solid,
  slopes: readonly Float64Array[],
  c: Float64Array,
): EnergyOfTerms {
  const { d, volumes, material } = solid;
  const { mu, lambda } = material;
  const n = slopes.length;
  const size = d * d;
  const gradient = new Float64Array(n);
  const hessian = new Float64Array(n * n);
  const a = slopes.map(() => new Float64Array(size));
  const traces = new Float64Array(n);
  const [h, f, inverse, beyond] = Array.from({ length: 4 }, () => new Float64Array(size));
  let energy = 0;
  for (let point = 0; point < volumes.length; point++) {
    const w = volumes[point];
    const first = point * size;
    let square = 0;
    for (let i = 0; i < size; i++) {
      h[i] = 0;
      for (let k = 0; k < n; k++) h[i] += c[k] * slopes[k][first + i];
      f[i] = h[i] + (i % (d + 1) === 0 ? 1 : 0);
      square += h[i] * h[i];
    }
    const nonlinear = cofactorsBeyond(h, d, beyond);
    const e = trace(h, d) + nonlinear;
    if (!(e > -1)) return { energy: Infinity, gradient, hessian };
    invert(f, d, inverse);
    const logarithmic = e - Math.log1p(e);
    const bulk =
      material.volumetric === "paper"
        ? (lambda / 4) * (e * e + 2 * logarithmic)
        : (lambda / 2) * e * e;
    energy += w * ((mu / 2) * square + mu * (logarithmic - nonlinear) + bulk);
    const [pressure, squared] = volumetric(material, e);
    for (let k = 0; k < n; k++) {
      const of = a[k];
      let contraction = 0;
      let expansion = 0;
      traces[k] = 0;
      let ofTerm = 0;
      for (let row = 0; row < d; row++) {
        for (let column = 0; column < d; column++) {
          let product = 0;
          for (let m = 0; m < d; m++) {
            product += inverse[row * d + m] * slopes[k][first + m * d + column];
          }
          const i = row * d + column;
          of[i] = product;
          contraction += h[i] * slopes[k][first + i];
          expansion += beyond[i] * slopes[k][first + i];
        }
        traces[k] += of[row * (d + 1)];
        ofTerm += slopes[k][first + row * (d + 1)];
      }
      const lost = (e * ofTerm - expansion) / (1 + e); // tr H_k − tr A_k
      gradient[k] += w * (mu * (contraction + lost) + pressure * traces[k]);
      for (let l = 0; l <= k; l++) {
        let contracted = 0;
        let crossed = 0;
        for (let row = 0; row < d; row++) {
          for (let column = 0; column < d; column++) {
            const i = row * d + column;
            contracted += slopes[k][first + i] * slopes[l][first + i];
            crossed += of[i] * a[l][column * d + row];
          }
        }
        hessian[k * n + l] +=
          w * (mu * contracted + (mu - pressure) * crossed + squared * traces[k] * traces[l]);
      }
    }
  }
  for (let k = 0; k < n; k++) {
    for (let l = 0; l < k; l++) hessian[l * n + k] = hessian[k * n + l]!;
  }
  return { energy, gradient, hessian };
}

function trace(h: Float64Array, d: number): number {
  let sum = 0;
  for (let row = 0; row < d; row++) sum += h[row * (d + 1)];
  return sum;
}

/** Write cof (I + H) − I; returns J − 1 − tr H. */
function cofactorsBeyond(h: Float64Array, d: number, out: Float64Array): number {
  if (d === 2) {
    out.set([h[3], -h[2], -h[1], h[0]]);
    return h[0] * h[3] - h[1] * h[2];
  }
  const sum = trace(h, 3);
  let nonlinear = 0;
  for (let row = 0; row < 3; row++) {
    const [up, down] = [3 * ((row + 1) % 3), 3 * ((row + 2) % 3)];
    for (let column = 0; column < 3; column++) {
      const [left, right] = [(column + 1) % 3, (column + 2) % 3];
      const minor = h[up + left] * h[down + right] - h[up + right] * h[down + left];
      const i = 3 * row + column;
      const isDiagonal = row === column;
      nonlinear += (minor * h[i]) / 3 + (isDiagonal ? minor : 0);
      out[i] = minor - h[3 * column + row] + (isDiagonal ? sum : 0);
    }
  }
  return nonlinear;
}
