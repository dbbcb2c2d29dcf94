/**
 * How wrong a prediction is, without the true displacement, as `surrogate/mechanics/certify/full_certificate.py`:
 *
 *   u − u_true ≈ −(δ + δ̄),  δ = −K(u)⁻¹ r(u),  δ̄ = −K(u)⁻¹ r(u + δ)
 *
 * once Newton's method contracts, which a third step with the same tangent, δ̿ = −K(u)⁻¹ r(u + δ + δ̄),
 * has to show as well, or r is no more than rounding errors. Until then the state is improved by
 * steps with line search, and then δ itself has to be small.
 */

import type { Equilibrium, Tangent } from "./equilibrium";
import { dot, norm, plus } from "./vectors";

const CONTRACTION = 0.25; // largest ‖δ̄‖/‖δ‖ of an estimate that is settled
const LAST_PART = 0.1; // largest part of δ̄ in it
const SMALL_PART = 1e-3; // largest part in it of a third step that need not contract
const NEGLIGIBLE = 1e-9; // of the displacement
const ROUNDS = 20;
const HALVINGS = 40;
const SUFFICIENT = 1e-4; // of Armijo's rule

export interface Certificate {
  /** Predicted minus true displacement in m, (points · d); null if cells are inverted, or r is not finite. */
  error: Float64Array | null;
  /** Number of inverted cells. */
  inverted: number;
  /** True if Newton's method contracts, so that the estimate is to be trusted. */
  settled: boolean;
  /**
   * The displacement that is left if the estimate is taken away, and its own estimated error, in m;
   * lengths and volumes there.
   */
  corrected: { displacement: Float64Array; error: Float64Array; quantities: number[] } | null;
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
  const start = equilibrium.held(predicted);
  const inverted = equilibrium.inverted(start);
  const isSound = inverted === 0 && Number.isFinite(norm(equilibrium.outOfBalance(start, f)));
  if (!isSound) return { error: null, inverted, settled: false, corrected: null };
  let u = equilibrium.relaxed(start, f);
  for (let round = 0; round < ROUNDS; round++) {
    if (!(await wanted())) return null;
    const r = equilibrium.outOfBalance(u, f);
    const tangent = equilibrium.tangent(u);
    const from = (state: Float64Array): Float64Array =>
      tangent.solve(equilibrium.outOfBalance(state, f)).map((value) => -value);
    const step = tangent.solve(r).map((value) => -value);
    const simplified = from(plus(u, step));
    const twice = plus(plus(u, step), simplified);
    const further = from(twice);
    const { atRest, perDisplacement } = equilibrium.solid.body.rounding;
    const size = norm(u);
    const estimate = norm(plus(plus(start, u, -1), step, -1));
    const [first, second, third] = [step, simplified, further].map(norm);
    const improved = round > 0 || equilibrium.solid.projects; // improved states must be closer
    const last = improved ? first : second;
    const goesOn = third <= CONTRACTION * second || third <= SMALL_PART * estimate;
    const contracts =
      (second <= CONTRACTION * first && last <= LAST_PART * estimate && goesOn) ||
      norm(r) <= atRest + perDisplacement * size ||
      last <= NEGLIGIBLE * size;
    if (tangent.stable && contracts) {
      const quantities = equilibrium.following.map((load) => load.quantity(twice));
      const corrected = { displacement: twice, error: further.map((value) => -value), quantities };
      return { error: plus(predicted, twice, -1), inverted: 0, settled: true, corrected };
    }
    u = (equilibrium.pressure ? damped : searched)(equilibrium, f, u, step, tangent) ?? u;
  }
  return { error: plus(predicted, u, -1), inverted: 0, settled: false, corrected: null };
}

/** Search along a step by Armijo's rule, as `surrogate/mechanics/certify/correction.py`; null if Π does not decrease. */
export function searched(
  equilibrium: Equilibrium,
  f: Float64Array,
  u: Float64Array,
  step: Float64Array,
): Float64Array | null {
  const potential = equilibrium.potential(u, f);
  const slope = dot(equilibrium.outOfBalance(u, f), step);
  for (let halving = 0; halving < HALVINGS; halving++) {
    const part = 0.5 ** halving;
    const trial = plus(u, step, part);
    const change = equilibrium.potential(trial, f) - potential;
    if (!(change <= equilibrium.solid.body.rounding.energy)) continue;
    if (change <= SUFFICIENT * part * slope) return trial;
    if (dot(equilibrium.outOfBalance(trial, f), step) <= (2 * SUFFICIENT - 1) * slope) return trial;
  }
  return null;
}

/** Step to a state that is closer, by the simplified step from there; it needs no Π. */
function damped(
  equilibrium: Equilibrium,
  f: Float64Array,
  u: Float64Array,
  step: Float64Array,
  tangent: Tangent,
): Float64Array | null {
  for (let halving = 0; halving < HALVINGS; halving++) {
    const part = 0.5 ** halving;
    const trial = plus(u, step, part);
    const simplified = norm(tangent.solve(equilibrium.outOfBalance(trial, f)));
    if (simplified <= (1 - part / 4) * norm(step)) return trial;
  }
  return null;
}
