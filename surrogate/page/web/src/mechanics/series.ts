/**
 * The load series of a body, as `surrogate/series/body_series.py`:
 *
 *   u = Σ_k c_k u_k,  K u_1 = f + f_{p,1},  K u_k = f_{p,k} − Σ_q w_q P̂_k G,  u_k · r(u) = 0
 *
 * with the part P̂_k of the k-th term of the stress that follows from the terms before it, and the
 * terms of the forces of pressures.
 */

import { solve } from "../touch/dense";
import { dot, norm, plus, type Equilibrium } from "./equilibrium";
import { contraction, type Field } from "./solid";
import { StressSeries } from "./stress_series";
import { addProduct, trace } from "./tensors";

const STEPS = 30; // of the search for the weights, at most
const SMALL_STEP = 3e-3; // relative to the last term
const SMALLEST_STEP = 1e-10; // relative to the first one
const SHORTENINGS = 10;
const SMALL = 1e-5; // gradients whose sum of terms, all weights 1, is right to rounding
const SHIFT = 1e-9; // of the matrix, relative to its diagonal
const SECOND_SHIFT = 1e-3;
const GROWTH = 10;
const ROUNDING = 4096 * Number.EPSILON; // of Π, relative
const TINY = 1e-300;

/** Terms u_k in m, and their gradients. */
export interface Terms {
  u: Float64Array[];
  slopes: Field[];
}

/** Displacements in m under forces in N, both (points · d), by a series to some order. */
export function loadSeries(equilibrium: Equilibrium, f: Float64Array, order: number): Float64Array {
  const terms = seriesTerms(equilibrium, f, order);
  return combined(terms.u, order === 1 ? [1] : weights(equilibrium, terms, f));
}

/** Σ c_k u_k */
function combined(u: readonly Float64Array[], c: readonly number[]): Float64Array {
  const total = new Float64Array(u[0].length);
  u.forEach((term, k) => {
    addProduct(total, c[k], term);
  });
  return total;
}

/** Terms of the series. */
export function seriesTerms(equilibrium: Equilibrium, f: Float64Array, order: number): Terms {
  const { solid, pressure } = equilibrium;
  const { blocks, d } = solid;
  const series = blocks.map(({ law, n, fibres }) => new StressSeries(law, d, n, fibres));
  const found: Terms = { u: [], slopes: [] };
  let acting = f;
  /** P of the next order without what is linear in H. */
  const begin = (): Field => {
    const volumes = series.map((block) => block.begin());
    const dilations = solid.projects ? solid.projected(volumes) : null;
    const slopes = series.map((block, b) => block.scalars(dilations?.[b] ?? null));
    const pressures = solid.projects ? solid.projected(slopes) : null;
    return series.map((block, b) => block.stress(pressures?.[b] ?? null));
  };
  begin();
  for (let k = 1; k <= order; k++) {
    if (pressure) acting = plus(acting, pressure.ofOrder(found.u));
    const u = equilibrium.linearResponse(acting);
    const slopes = solid.slopes(u);
    found.u.push(u);
    found.slopes.push(slopes);
    if (k === order) break;
    const gains = solid.projects ? solid.projected(slopes.map((h) => trace(h, d))) : null;
    series.forEach((block, b) => {
      block.complete(slopes[b], gains?.[b] ?? null);
    });
    if (solid.projects) {
      const more = solid.projected(series.map((block) => block.pressureGain()));
      series.forEach((block, b) => {
        block.press(more[b]);
      });
    }
    acting = solid.forcesOf(begin()).map((value) => -value);
  }
  return found;
}

/**
 * Weights of Galerkin's combination, by Newton's method; where that ends elsewhere, and there is an
 * energy, those of the least one.
 */
export function weights(equilibrium: Equilibrium, terms: Terms, f: Float64Array): number[] {
  const { solid } = equilibrium;
  const { slopes } = terms;
  let c = slopes.map(() => 1);
  const largest = Math.max(
    ...slopes[0].map((h) => h.reduce((m, x) => Math.max(m, Math.abs(x)), 0)),
  );
  if (largest <= SMALL) return c;
  const squares = slopes.map((h) => work(solid, h, h));
  const scale = squares.map((square) => (square + TINY) ** -0.5);
  const works = terms.u.map((u) => dot(u, f));
  let found = residual(equilibrium, terms, works, c);
  for (let step = 0; step < STEPS; step++) {
    if (!found) {
      c = c.map((value, k) => value * 0.5 ** (k + 1));
      found = residual(equilibrium, terms, works, c);
      continue;
    }
    const n = c.length;
    const scaled = found.matrix.map((x, i) => x * scale[Math.floor(i / n)] * scale[i % n]);
    for (let i = 0; i < n; i++)
      scaled[i * (n + 1)] += SHIFT * (Math.abs(scaled[i * (n + 1)]) + TINY);
    const solved = (g: Float64Array): Float64Array | null =>
      solve(
        scaled,
        g.map((value, k) => value * scale[k]),
        1,
      );
    const direction = solved(found.g);
    if (!direction) break;
    const size = norm(direction);
    const small = (SMALL_STEP * Math.abs(c[n - 1])) / scale[n - 1] + SMALLEST_STEP / scale[0];
    let taken = false;
    for (let halving = 0; halving < SHORTENINGS && !taken; halving++) {
      const part = 0.5 ** halving;
      const trial = c.map((value, k) => value - part * scale[k] * direction[k]);
      const after = residual(equilibrium, terms, works, trial);
      const simplified = after && solved(after.g);
      taken = simplified !== null && norm(simplified) <= (1 - part / 4) * size + small;
      if (taken) [c, found] = [trial, after];
    }
    if (size <= small && taken) return c;
    if (!taken) break;
  }
  return equilibrium.pressure ? c : lowest(equilibrium, terms, works, squares);
}

/** Weights of the least energy, by Newton's method with a shift (Levenberg, Marquardt), from terms that fade. */
function lowest(
  equilibrium: Equilibrium,
  terms: Terms,
  works: readonly number[],
  squares: readonly number[],
): number[] {
  const n = squares.length;
  const scale = squares.map((square) => (square + TINY) ** -0.5);
  let c = squares.map(() => 1);
  for (let k = 1; k < n; k++) c[k] = c[k - 1] / (1 + (squares[k] / (squares[k - 1] + TINY)) ** 2);
  let state = residual(equilibrium, terms, works, c);
  let shift = SHIFT;
  for (let evaluation = 0; evaluation < STEPS; evaluation++) {
    let trial = c.map((value, k) => value * 0.5 ** (k + 1)); // those of half the load
    if (state) {
      const { g, matrix } = state;
      const right = g.map((value, k) => value * scale[k]);
      const scaled = matrix.map((x, i) => x * scale[Math.floor(i / n)] * scale[i % n]);
      const stiffness = Math.abs(scaled[0]);
      for (let i = 0; i < n; i++) scaled[i * (n + 1)] += shift * stiffness;
      const step = solve(scaled, right, 1);
      const falls = step !== null && dot(step, right) >= 0;
      if (falls) {
        trial = c.map((value, k) => value - scale[k] * step[k]);
        const small = (SMALL_STEP * Math.abs(c[n - 1])) / scale[n - 1] + SMALLEST_STEP / scale[0];
        if (norm(step) <= small && shift <= SHIFT) return trial;
      } else trial = c.map(() => NaN);
    }
    const next = residual(equilibrium, terms, works, trial);
    const falls =
      next !== null &&
      !(
        next.potential >
        (state?.potential ?? Infinity) + ROUNDING * Math.abs(state?.potential ?? 0)
      );
    if (falls || !state) [c, state] = [trial, next];
    shift = falls ? SHIFT : Math.max(SECOND_SHIFT, GROWTH * shift);
  }
  return c;
}

/** u_k · r(Σ c u) and its derivative by c; null where cells are inverted. */
function residual(
  { solid, pressure }: Equilibrium,
  { u, slopes }: Terms,
  works: readonly number[],
  c: readonly number[],
): { g: Float64Array; matrix: Float64Array; potential: number } | null {
  const n = c.length;
  const states = solid.deformed(c.map((value, k) => [value, slopes[k]] as const));
  if (solid.inverted(states) > 0) return null;
  const stress = states.map((state) => state.stress());
  const g = Float64Array.from(slopes, (h, k) => work(solid, stress, h) - works[k]);
  const matrix = new Float64Array(n * n);
  slopes.forEach((h, l) => {
    const [change] = solid.changes(states, [h]);
    for (let k = 0; k <= l; k++) {
      matrix[k * n + l] = work(solid, change, slopes[k]);
      matrix[l * n + k] = matrix[k * n + l];
    }
  });
  if (pressure) {
    const at = combined(u, c);
    const forces = pressure.forces(at);
    u.forEach((term, k) => (g[k] -= dot(forces, term)));
    pressure.tangents(at, (components, block) => {
      const m = components.length;
      const local = u.map((term) => Float64Array.from(components, (i) => term[i]));
      for (let l = 0; l < n; l++) {
        for (let i = 0; i < m; i++) {
          const product = dot(block.subarray(i * m, (i + 1) * m), local[l]);
          for (let k = 0; k < n; k++) matrix[k * n + l] += local[k][i] * product;
        }
      }
    });
  }
  const potential = solid.energy(states) - works.reduce((sum, work, k) => sum + work * c[k], 0);
  return g.every(Number.isFinite) && matrix.every(Number.isFinite)
    ? { g, matrix, potential }
    : null;
}

/** Σ w A : B over all points. */
function work(solid: Equilibrium["solid"], a: Field, b: Field): number {
  return solid.integral(a.map((part, i) => contraction(part, b[i], solid.blocks[i].n)));
}
