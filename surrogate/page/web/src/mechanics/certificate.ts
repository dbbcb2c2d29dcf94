/**
 * How wrong a prediction is, without the true displacement, as `surrogate/certify/full_certificate.py`:
 *
 *   u − u_true ≈ −(δ + δ̄),  δ = −K(u)⁻¹ r(u),  δ̄ = −K(u)⁻¹ r(u + δ)
 *
 * once Newton's method contracts; until then the state is improved by steps with line search, and
 * then δ itself has to be small.
 */

import { dot, norm, plus, type Equilibrium } from "./equilibrium";

const CONTRACTION = 0.25; // largest ‖δ̄‖/‖δ‖ of an estimate that is settled
const LAST_PART = 0.1; // largest part of δ̄ in it
const NEGLIGIBLE = 1e-9; // of the displacement
const ROUNDS = 20;
const HALVINGS = 40;
const SUFFICIENT = 1e-4; // of Armijo's rule

export interface Certificate {
  /** Predicted minus true displacement in m, (nodes · d); null if cells are inverted. */
  error: Float64Array | null;
  /** Number of inverted cells. */
  inverted: number;
  /** True if Newton's method contracts, so that the estimate is to be trusted. */
  settled: boolean;
}

/**
 * Estimate the error of a prediction.
 *
 * @param wanted - asked between the rounds; the result is null once it is no longer wanted
 */
export async function certify(
  equilibrium: Equilibrium,
  f: Float64Array,
  predicted: Float64Array,
  wanted: () => Promise<boolean>,
): Promise<Certificate | null> {
  let u = equilibrium.held(predicted);
  const start = u;
  const inverted = equilibrium.solid.inverted(u);
  if (inverted > 0) return { error: null, inverted, settled: false };
  let settled = false;
  for (let round = 0; round < ROUNDS && !settled; round++) {
    if (!(await wanted())) return null;
    const r = equilibrium.outOfBalance(u, f);
    const { factor, stable } = equilibrium.tangent(u);
    const step = equilibrium.solve(factor, r).map((value) => -value);
    const trial = plus(u, step);
    const simplified = equilibrium.solid.inverted(trial)
      ? null
      : equilibrium.solve(factor, equilibrium.outOfBalance(trial, f)).map((value) => -value);
    if (simplified && stable && contracts(start, u, step, simplified, round)) {
      u = plus(trial, simplified);
      settled = true;
    } else {
      u = searched(equilibrium, f, u, r, step) ?? u;
    }
  }
  return { error: plus(predicted, u, -1), inverted: 0, settled };
}

function contracts(
  start: Float64Array,
  u: Float64Array,
  step: Float64Array,
  simplified: Float64Array,
  round: number,
): boolean {
  const first = norm(step);
  const second = norm(simplified);
  const last = round === 0 ? second : first;
  const error = norm(plus(plus(start, u, -1), step, -1));
  const small = (first > 0 ? second / first : 0) <= CONTRACTION && last <= LAST_PART * error;
  return small || last <= NEGLIGIBLE * norm(u);
}

/** Search along a step by Armijo's rule, as `surrogate/certify/correction.py`; null if Π does not decrease. */
function searched(
  equilibrium: Equilibrium,
  f: Float64Array,
  u: Float64Array,
  r: Float64Array,
  step: Float64Array,
): Float64Array | null {
  const potential = equilibrium.potential(u, f);
  const slope = dot(r, step);
  for (let halving = 0; halving < HALVINGS; halving++) {
    const part = 0.5 ** halving;
    const trial = plus(u, step, part);
    const change = equilibrium.potential(trial, f) - potential;
    if (!(change <= equilibrium.rounding)) continue;
    if (change <= SUFFICIENT * part * slope) return trial;
    if (dot(equilibrium.outOfBalance(trial, f), step) <= (2 * SUFFICIENT - 1) * slope) return trial;
  }
  return null;
}
