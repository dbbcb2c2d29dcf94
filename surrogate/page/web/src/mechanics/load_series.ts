/**
 * The load series of a body, as `surrogate/mechanics/series/body_series.py`:
 *
 *   u = Σ_k c_k u_k,  K u_1 = f + f_{p,1},  K u_k = f_{p,k} − Σ_q w_q P̂_k G,  u_k · r(u) = 0
 *
 * with the part P̂_k of the k-th term of the stress that follows from the terms before it, that of
 * u_k = 0, and the terms of the forces of pressures.
 */

import type { Equilibrium } from "./equilibrium";
import { Galerkin, product } from "./galerkin";
import { combined, dot, largest, norm, plus, solve } from "./vectors";

const STEPS = 30; // of the search for the weights, at most
const SMALL_STEP = 3e-3; // relative to the last term
const SMALLEST_STEP = 1e-10; // relative to the first one
const SHORTENINGS = 10;
const SMALL = 1e-5; // gradients whose sum of terms, all weights 1, is right to rounding
const SHIFT = 1e-9; // of the matrix, relative to its diagonal
const TINY = 1e-300;

/** A residual and its derivative, (n, n). */
interface Residual {
  g: Float64Array;
  matrix: Float64Array;
}

/** Displacements in m under forces in N, both (points · d), by a series to some order. */
export function loadSeries(equilibrium: Equilibrium, f: Float64Array, order: number): Float64Array {
  const terms = seriesTerms(equilibrium, f, order);
  return combined(order === 1 ? [1] : weights(equilibrium, terms, f), terms);
}

/** Terms u_k in m. */
export function seriesTerms(
  equilibrium: Equilibrium,
  f: Float64Array,
  order: number,
): Float64Array[] {
  const { solid, pressure } = equilibrium;
  const rest = new Float64Array(f.length);
  const terms = [equilibrium.linearResponse(pressure ? plus(f, pressure.forces(rest)) : f)];
  solid.set(0, solid.slopes(rest));
  for (let k = 2; k <= order; k++) {
    solid.set(k - 1, solid.slopes(terms[k - 2]));
    solid.set(k, null);
    const acting = solid.forces(k).map((value) => -value);
    const pushed = pressure ? plus(acting, pressure.forces(rest, ...terms)) : acting;
    terms.push(equilibrium.linearResponse(pushed));
  }
  return terms;
}

/** Weights of Galerkin's combination, by Newton's method, from terms that fade. */
export function weights(
  equilibrium: Equilibrium,
  terms: readonly Float64Array[],
  f: Float64Array,
): number[] {
  const n = terms.length;
  const galerkin = new Galerkin(equilibrium.solid, terms);
  const { slopes, weighted } = galerkin;
  const squares = slopes.map((h, k) => product(h, weighted[k]));
  let c = squares.map(() => 1);
  if (slopes[0].every((block) => largest(block) <= SMALL)) return c;
  const scale = squares.map((square) => (square + TINY) ** -0.5);
  for (let k = 1; k < n; k++) c[k] = c[k - 1] / (1 + (squares[k] / (squares[k - 1] + TINY)) ** 2);
  const at = (c: number[]): Residual | null => residual(equilibrium, terms, galerkin, f, c);
  let found = at(c);
  for (let step = 0; step < STEPS; step++) {
    if (!found) {
      c = c.map((value, k) => value * 0.5 ** (k + 1));
      found = at(c);
      continue;
    }
    const matrix = found.matrix.map((x, i) => x * scale[Math.floor(i / n)] * scale[i % n]);
    for (let i = 0; i < n * n; i += n + 1) matrix[i] += SHIFT * (Math.abs(matrix[i]) + TINY);
    const solved = (g: Float64Array): Float64Array | null =>
      solve(
        matrix,
        g.map((value, k) => value * scale[k]),
      );
    const direction = solved(found.g);
    if (!direction) return c;
    const size = norm(direction);
    const small = (SMALL_STEP * Math.abs(c[n - 1])) / scale[n - 1] + SMALLEST_STEP / scale[0];
    let taken = false;
    for (let halving = 0; halving < SHORTENINGS && !taken; halving++) {
      const part = 0.5 ** halving;
      const trial = c.map((value, k) => value - part * scale[k] * direction[k]);
      const after = at(trial);
      const simplified = after && solved(after.g);
      taken = simplified !== null && norm(simplified) <= (1 - part / 4) * size + small;
      if (taken) [c, found] = [trial, after];
    }
    if (!taken || size <= small) return c;
  }
  return c;
}

/** u_k · r(Σ c u) and its derivative by c; null where cells are inverted. */
function residual(
  { pressure }: Equilibrium,
  terms: readonly Float64Array[],
  galerkin: Galerkin,
  f: Float64Array,
  c: readonly number[],
): Residual | null {
  const n = terms.length;
  const u = combined(c, terms);
  const works = galerkin.works(c);
  if (!works) return null;
  const acting = pressure ? plus(f, pressure.forces(u)) : f;
  const g = works.map((work, k) => work - dot(terms[k], acting));
  const matrix = galerkin.tangent();
  terms.forEach((term, l) => {
    const change = pressure?.forces(u, term);
    for (let k = 0; k < n && change; k++) matrix[k * n + l] -= dot(terms[k], change);
  });
  return [...g, ...matrix].every(Number.isFinite) ? { g, matrix } : null;
}
