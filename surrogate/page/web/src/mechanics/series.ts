/**
 * The load series of a Neo-Hookean body with the least potential energy, as `surrogate/series`:
 *
 *   u = Σ_k c_k u_k,  K u_1 = f,  K u_k = −Σ_q w_q P̂_k G,  c = arg min Π(c)
 *
 * with the part P̂_k of the k-th term of the stress that follows from the terms before it.
 */

import { energyOfTerms, squares } from "./energy_of_terms";
import { dot, norm, type Equilibrium } from "./equilibrium";
import type { Solid } from "./solid";
import { StressSeries } from "./stress_series";

const EVALUATIONS = 30; // of Π
const SMALLEST_SHIFT = 1e-9; // of the Hessian, relative to the stiffness of every term
const SECOND_SHIFT = 1e-3;
const GROWTH = 10;
const ROUNDING = 4096 * Number.EPSILON; // of Π, relative
const SMALL_STEP = 3e-3; // relative to the last term
const SMALLEST_STEP = 1e-10; // relative to the first one
const NEGLIGIBLE = 0.01 * Number.EPSILON; // largest gradient of u_1 beyond which there are more terms

/** Displacements in m under forces in N, both (nodes · d), by a series to some order. */
export function loadSeries(equilibrium: Equilibrium, f: Float64Array, order: number): Float64Array {
  const { solid } = equilibrium;
  const terms = [equilibrium.linearResponse(f)];
  const slopes = [solid.slopes(terms[0])];
  const slope = slopes[0].reduce((most, value) => Math.max(most, Math.abs(value)), 0);
  if (order === 1 || !(slope > NEGLIGIBLE)) return terms[0];
  const series = new StressSeries(solid.material, solid.d, slopes[0]);
  while (terms.length < order) {
    if (terms.length > 1) series.add(slopes[slopes.length - 1]);
    const balanced = equilibrium.linearResponse(solid.forcesOf(series.nextWithout()));
    terms.push(balanced.map((value) => -value));
    slopes.push(solid.slopes(terms[terms.length - 1]));
  }
  return sum(terms, leastEnergy(solid, terms, slopes, f));
}

/** Σ_k c_k u_k */
function sum(terms: readonly Float64Array[], c: Float64Array): Float64Array {
  const total = new Float64Array(terms[0].length);
  c.forEach((factor, k) => {
    const term = terms[k];
    for (let i = 0; i < total.length; i++) total[i] += factor * term[i];
  });
  return total;
}

/**
 * Coefficients of the least potential energy, by Newton's method with a shift (Levenberg, Marquardt),
 * from terms that fade: c_k = Π_{j≤k} 1 / (1 + (M_jj / M_{j−1,j−1})²), M_kk = Σ_q w_q H_k:H_k.
 */
function leastEnergy(
  solid: Solid,
  terms: readonly Float64Array[],
  slopes: readonly Float64Array[],
  f: Float64Array,
): Float64Array {
  const n = terms.length;
  const works = Float64Array.from(terms, (term) => dot(term, f));
  const stiffness = squares(solid, slopes).map((value) => value * solid.material.mu);
  const scale = stiffness.map((value) => (value + Number.EPSILON ** 2 * stiffness[0]) ** -0.5);
  let c = new Float64Array(n).fill(1);
  for (let k = 1; k < n; k++) c[k] = c[k - 1] / (1 + (stiffness[k] / stiffness[k - 1] || 0) ** 2);
  let state = energyOfTerms(solid, slopes, c);
  let potential = state.energy - dot(works, c);
  let shift = SMALLEST_SHIFT;
  for (let evaluation = 0; evaluation < EVALUATIONS; evaluation++) {
    let trial = c.map((value, k) => value * 0.5 ** (k + 1)); // those of half the load
    if (potential < Infinity) {
      const { gradient, hessian } = state;
      const right = gradient.map((value, k) => (value - works[k]) * scale[k]);
      const scaled = hessian.map((value, i) => value * scale[Math.floor(i / n)] * scale[i % n]);
      const relative = solved(scaled, right, shift);
      if (relative) {
        trial = c.map((value, k) => value - scale[k] * relative[k]);
        const small = (SMALL_STEP * Math.abs(c[n - 1])) / scale[n - 1] + SMALLEST_STEP / scale[0];
        if (norm(relative) <= small && shift <= SMALLEST_SHIFT) return trial;
      }
      if (!relative) trial = c.map(() => NaN);
    }
    const next = energyOfTerms(solid, slopes, trial);
    const there = next.energy - dot(works, trial);
    const falls = there <= potential + ROUNDING * Math.abs(potential);
    if (falls) [c, state, potential] = [trial, next, there];
    shift = falls ? SMALLEST_SHIFT : Math.max(SECOND_SHIFT, GROWTH * shift);
  }
  return c;
}

/** Solve (H + shift · I) x = g by Cholesky's method; null if the matrix is not positive definite. */
function solved(h: Float64Array, g: Float64Array, shift: number): Float64Array | null {
  const n = g.length;
  const l = new Float64Array(n * n);
  for (let i = 0; i < n; i++) {
    for (let j = 0; j <= i; j++) {
      let rest = h[i * n + j] + (i === j ? shift : 0);
      for (let m = 0; m < j; m++) rest -= l[i * n + m] * l[j * n + m];
      if (i !== j) l[i * n + j] = rest / l[j * n + j];
      else if (rest > 0) l[i * n + i] = Math.sqrt(rest);
      else return null;
    }
  }
  const x = new Float64Array(n);
  for (let i = 0; i < n; i++) {
    let rest = g[i];
    for (let m = 0; m < i; m++) rest -= l[i * n + m] * x[m];
    x[i] = rest / l[i * n + i];
  }
  for (let i = n - 1; i >= 0; i--) {
    let rest = x[i];
    for (let m = i + 1; m < n; m++) rest -= l[m * n + i] * x[m];
    x[i] = rest / l[i * n + i];
  }
  return x;
}
