/**
 * The load series of a Neo-Hookean body with the least potential energy, as `surrogate/series`:
 *
 *   u = Σ_k c_k u_k,  K u_1 = f,  K u_k = −[t^k] f_int(t u_1 + … + t^{k−1} u_{k−1}),
 *   c = arg min Π(c)
 *
 * The coefficient of t^k in the internal forces, which is even or odd as k is, follows from the
 * forces at ± a small t. It grows with k, so that an error of u_{k−2}, of the order of its own t², is
 * small beside the coefficient.
 */

import { dot, type Equilibrium } from "./equilibrium";
import type { Solid } from "./solid";

const SMALL_SLOPES = [1e-4, 1e-3, 1e-2]; // largest displacement gradient at the small t, from k = 2 on
const NEGLIGIBLE = 1e-5; // largest gradient of u_1 from which on the coefficients differ from 1
const EVALUATIONS = 30; // of Π
const SMALLEST_SHIFT = 1e-9; // of the Hessian, relative to its diagonal
const GROWTH = 10;
const SETTLED = 1e-12; // decrease of Π, relative

/** Displacements in m under forces in N, both (nodes · d), by a series to some order, 4 at most. */
export function loadSeries(equilibrium: Equilibrium, f: Float64Array, order: number): Float64Array {
  const { solid } = equilibrium;
  const terms = [equilibrium.linearResponse(f)];
  const slope = solid.slopes(terms[0]).reduce((most, value) => Math.max(most, Math.abs(value)), 0);
  if (order === 1 || slope === 0) return terms[0];
  for (let k = 2; k <= Math.min(order, SMALL_SLOPES.length + 1); k++) {
    const t = SMALL_SLOPES[k - 2] / slope;
    const even = k % 2 === 0;
    const ahead = solid.internalForces(sum(terms, powers(t, k - 1)));
    const behind = solid.internalForces(sum(terms, powers(-t, k - 1)));
    const coefficient = ahead.map((value, i) =>
      even ? (value + behind[i]) / (2 * t ** k) : ((value - behind[i]) / 2 - t * f[i]) / t ** k,
    );
    terms.push(equilibrium.linearResponse(coefficient).map((value) => -value));
  }
  const ones = new Float64Array(terms.length).fill(1);
  return sum(terms, slope < NEGLIGIBLE ? ones : leastEnergy(solid, terms, f));
}

/** t, t², … */
function powers(t: number, count: number): Float64Array {
  return Float64Array.from({ length: count }, (_, k) => t ** (k + 1));
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

/** Coefficients of the least potential energy, by Newton's method with a shift (Levenberg, Marquardt). */
function leastEnergy(solid: Solid, terms: readonly Float64Array[], f: Float64Array): Float64Array {
  const n = terms.length;
  const slopes = terms.map((term) => solid.slopes(term));
  const works = Float64Array.from(terms, (term) => dot(term, f));
  let c = powers(1, n);
  let state = solid.energyOf(slopes, c);
  let potential = state.energy - dot(works, c);
  for (let part = 0.5; !(potential < 0) && part > 1e-6; part /= 2) {
    c = powers(part, n);
    state = solid.energyOf(slopes, c);
    potential = state.energy - dot(works, c);
  }
  let shift = 0;
  for (let evaluation = 0; evaluation < EVALUATIONS; evaluation++) {
    const gradient = state.gradient.map((value, k) => value - works[k]);
    const step = solved(state.hessian, gradient, shift);
    if (step) {
      const expected = dot(gradient, step) / 2;
      if (expected < SETTLED * Math.abs(potential)) break;
      const trial = c.map((value, k) => value - step[k]);
      const next = solid.energyOf(slopes, trial);
      const there = next.energy - dot(works, trial);
      if (there < potential) {
        [c, state, potential] = [trial, next, there];
        shift = shift > SMALLEST_SHIFT ? shift / GROWTH : 0;
        continue;
      }
    }
    shift = Math.max(SMALLEST_SHIFT, GROWTH * shift);
  }
  return c;
}

/** Solve (H + shift · diag H) x = g by Cholesky's method; null if the matrix is not positive definite. */
function solved(h: Float64Array, g: Float64Array, shift: number): Float64Array | null {
  const n = g.length;
  const l = new Float64Array(n * n);
  for (let i = 0; i < n; i++) {
    for (let j = 0; j <= i; j++) {
      let rest = h[i * n + j] * (i === j ? 1 + shift : 1);
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
