/**
 * Directions towards the equilibrium until the estimated error is small, as `surrogate/descent/descent.py`:
 *
 *   d = −H r,  H ≈ K(u)⁻¹
 *
 * by the L-BFGS method, from P. They begin at the prediction, and nothing looks at the softest modes:
 * the estimate that follows looks at the whole tangent.
 */

import type { CarriedCompliance } from "./carried_compliance";
import { dot, longest, norm, plus, type Equilibrium } from "./equilibrium";

export const TOLERANCE = 5e-3; // of the largest displacement
const PAIRS = 8; // of steps and changes of r that are kept
const MARGIN = 0.4; // of the tolerance: largest direction that counts as small
const IN_A_ROW = 2; // small directions after a step
const MOST = 100; // directions
const SHORTENINGS = 12; // of a step
const GROWN = 5; // of the forces out of balance: most that is left by a step
const LEAST = 0.1; // of a step: what one shortening leaves, where the force along d rises steeply
const TURNED = 0.9; // of the force along a direction: largest one of the other sign after a step
const CURVED = 1e-8; // of the norms of a pair: smallest work of one that is kept

interface Pair {
  s: Float64Array;
  y: Float64Array;
  work: number;
}

interface State {
  u: Float64Array;
  r: Float64Array;
}

/**
 * Drive a prediction without inverted cells towards the equilibrium; the best state that was met.
 *
 * @param f - forces in N, (points · d)
 * @param predicted - in m
 * @param wanted - asked before every direction; the result is null once it is no longer wanted
 */
export async function descend(
  equilibrium: Equilibrium,
  compliance: CarriedCompliance,
  f: Float64Array,
  predicted: Float64Array,
  wanted: () => Promise<boolean>,
): Promise<Float64Array | null> {
  const { d: dimension } = equilibrium.solid;
  const start = equilibrium.held(predicted);
  if (equilibrium.inverted(start)) return predicted;
  let state: State = { u: start, r: equilibrium.outOfBalance(start, f) };
  let best = start;
  let least = Infinity;
  let small = 0;
  let pairs: Pair[] = [];
  for (let count = 1; count <= MOST; count++) {
    if (!(await wanted())) return null;
    const { u, r } = state;
    const d = direction(compliance.at(u), r, pairs);
    const estimate = longest(d, dimension);
    if (estimate <= least) [best, least] = [u, estimate];
    small = estimate <= MARGIN * TOLERANCE * longest(u, dimension) ? small + 1 : 0;
    if (small >= (count === 1 ? 1 : IN_A_ROW)) {
      const last = plus(u, d);
      return equilibrium.inverted(last) ? u : last;
    }
    const next = step(equilibrium, f, state, d);
    if (!next && pairs.length === 0) return best;
    if (next) remember(pairs, plus(next.u, u, -1), plus(next.r, r, -1));
    else pairs = [];
    state = next ?? state;
  }
  return best;
}

/** −H r by the two loops of L-BFGS. */
function direction(
  carried: (force: Float64Array) => Float64Array,
  r: Float64Array,
  pairs: readonly Pair[],
): Float64Array {
  let q = r;
  const shares = pairs.map(() => 0);
  for (let i = pairs.length - 1; i >= 0; i--) {
    const { s, y, work } = pairs[i];
    shares[i] = dot(s, q) / work;
    q = plus(q, y, -shares[i]);
  }
  let found = carried(q);
  pairs.forEach(({ s, y, work }, i) => {
    found = plus(found, s, shares[i] - dot(y, found) / work);
  });
  return found.map((value) => -value);
}

/** Go along a direction; null if no part of it is good. */
function step(
  equilibrium: Equilibrium,
  f: Float64Array,
  state: State,
  d: Float64Array,
): State | null {
  const work = dot(d, state.r);
  let part = 1;
  for (let shortening = 0; shortening < SHORTENINGS; shortening++) {
    const u = plus(state.u, d, part);
    const r = equilibrium.outOfBalance(u, f);
    const after = dot(d, r);
    if (Number.isNaN(after) || norm(r) > GROWN * norm(state.r)) part /= 2;
    else if (after <= -TURNED * work) return { u, r };
    else part *= Math.max(LEAST, work / (work - after)); // no force along d there, if it is linear
  }
  return null;
}

function remember(pairs: Pair[], s: Float64Array, y: Float64Array): void {
  const work = dot(s, y);
  if (work > CURVED * norm(s) * norm(y)) pairs.push({ s, y, work });
  if (pairs.length > PAIRS) pairs.shift();
}
