/**
 * A body in motion by generalised-α, as `shared_schema/motion/scheme.py`: the end u' of a step from u, v, a
 * is an equilibrium with springs to where the body coasts,
 *
 *   f_int(u') − f + k M u' = M (k u* − g) − r R,  k = (1 − α_m) / (1 − α_f) / (β h²) + c γ / (β h)
 *
 * which Newton's method finds, with a tangent that is kept while it contracts.
 */

import type { Equilibrium, Tangent } from "./equilibrium";
import { combined, largest, norm, plus } from "./vectors";

const TOLERANCE = 1e-5; // of the displacement: estimated error of a step
const CONTRACTION = 0.3; // of steps of Newton's method with one tangent
const ITERATIONS = 40;
const SHORTEST = 1 / 64; // part of one

/** The end of a time step, at all points in m. */
export interface Moment {
  displacement: Float64Array;
  /** What the step adds, as Newton's method estimates it. */
  error: Float64Array;
  /** How far a point goes in a step. */
  way: number;
}

/** Displacement u in m, velocity v in m/s, acceleration a in m/s², forces out of balance R in N. */
type State = Record<"u" | "v" | "a" | "left", Float64Array>;

export class Motion {
  private at: State;
  private next: State;
  private tangent: Pick<Tangent, "solve">;

  /** @param u - where the body is at rest */
  constructor(
    private readonly equilibrium: Equilibrium,
    u: Float64Array,
  ) {
    const zero = new Float64Array(u.length);
    this.at = this.next = { u, v: zero, a: zero, left: zero };
    this.tangent = { solve: (r) => equilibrium.linearResponse(r) };
  }

  /** Begin the next step where the last one has ended. */
  goOn(): void {
    this.at = this.next;
  }

  /**
   * The end of a step; null if it is not found.
   *
   * @param f - forces in N over the stiffness
   * @param c - of the forces c M v in 1/s
   * @param stiffness - Young's modulus over that of the body
   */
  step(f: Float64Array, c: number, stiffness: number): Moment | null {
    const { u, v, a, left } = this.at;
    const { step: h, beta, gamma, fresh, former, carried } = this.equilibrium.solid.body.motion!;
    const slope = 1 / (beta * h * h);
    const k = (fresh + c * gamma * h) * slope;
    const onward = combined([1, h, h * h * (0.5 - beta)], [u, v, a]);
    const coasting = combined([1, h * (1 - gamma)], [v, a]);
    const goal = combined([k, -former, -c], [onward, a, coasting]);
    const pull = plus(this.equilibrium.massOf(goal), left, -carried).map((f) => f / stiffness);
    this.equilibrium.inertia = { spring: k / stiffness, pull };
    const found = this.settled(f, combined([1, h], [u, v]));
    if (!found) return null;
    const [end, error] = found;
    const after = combined([slope, -slope], [end, onward]);
    const velocity = plus(coasting, after, gamma * h);
    const inertia = this.equilibrium.massOf(combined([-fresh, -former], [after, a]));
    const out = this.equilibrium.held(plus(inertia, left, -carried));
    this.next = { u: end, v: velocity, a: after, left: out };
    return { displacement: end, error, way: h * largest(velocity) + h * h * largest(after) };
  }

  /** The equilibrium of a step, from where the body coasts, and what the last step of Newton's method leaves. */
  private settled(f: Float64Array, start: Float64Array): [Float64Array, Float64Array] | null {
    const { equilibrium } = this;
    let u = equilibrium.inverted(start) ? this.at.u : start;
    let r = equilibrium.outOfBalance(u, f);
    let before = Infinity;
    for (let iteration = 0; iteration < ITERATIONS; iteration++) {
      let step = this.tangent.solve(r);
      if (norm(step) > CONTRACTION * before) {
        this.tangent = equilibrium.tangent(u);
        step = this.tangent.solve(r);
      }
      const left = Math.min(1, norm(step) / before);
      if (norm(step) <= TOLERANCE * norm(u))
        return [plus(u, step, -1), step.map((way) => left * way)];
      before = norm(step);
      const from = u;
      for (let part = 1, isSound = false; !isSound; part /= 2) {
        if (part < SHORTEST) return null;
        u = plus(from, step, -part);
        r = equilibrium.outOfBalance(u, f);
        isSound = Number.isFinite(norm(r));
      }
    }
    return null;
  }
}
