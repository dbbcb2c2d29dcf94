/**
 * A body in motion by generalised-α, as `shared_schema/motion/scheme.py`: the end u' of a step from u, v, a
 * is an equilibrium with springs to where the body coasts, a load that follows the body,
 *
 *   M (k u* − g) − r R − k M u',  k = (1 − α_m) / (1 − α_f) / (β h²) + c γ / (β h)
 *
 * which Newton's method finds, with a tangent that is kept while it contracts.
 */

import type { Loading } from "./body";
import type { Equilibrium, Tangent } from "./equilibrium";
import { Following, type Acting } from "./following";
import { combined, gathered, largest, norm, plus } from "./vectors";

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
  /** Of the undeformed body, and the last one. */
  private rest: Tangent | null = null;
  private tangent: Tangent | null = null;

  /** @param u - where the body is at rest */
  constructor(
    private readonly equilibrium: Equilibrium,
    u: Float64Array,
  ) {
    const zero = new Float64Array(u.length);
    this.at = this.next = { u, v: zero, a: zero, left: zero };
  }

  /** Begin the next step where the last one has ended. */
  goOn(): void {
    this.at = this.next;
  }

  /** What forces in N do in a step of the undeformed body, in m. */
  linearResponse(f: Float64Array): Float64Array {
    return this.rest!.solve(f);
  }

  /**
   * The end of a step; null if it is not found.
   *
   * @param loading - over the stiffness
   * @param c - of the forces c M v in 1/s
   * @param stiffness - Young's modulus over that of the body
   */
  step({ force, pressures }: Loading, c: number, stiffness: number): Moment | null {
    const { u, v, a, left } = this.at;
    const { step: h, beta, gamma, fresh, former, carried } = this.equilibrium.solid.body.motion!;
    const slope = 1 / (beta * h * h);
    const k = (fresh + c * gamma * h) * slope;
    const onward = combined([1, h, h * h * (0.5 - beta)], [u, v, a]);
    const coasting = combined([1, h * (1 - gamma)], [v, a]);
    const goal = combined([k, -former, -c], [onward, a, coasting]);
    const pull = plus(this.massOf(goal), left, -carried).map((f) => f / stiffness);
    const springs = this.springs(k / stiffness, pull);
    const all = [springs, ...this.equilibrium.following];
    this.equilibrium.pressure = new Following(all, [1, ...pressures]);
    const found = this.settled(force, combined([1, h], [u, v]));
    if (!found) return null;
    const [end, error] = found;
    const after = combined([slope, -slope], [end, onward]);
    const velocity = plus(coasting, after, gamma * h);
    const inertia = this.massOf(combined([-fresh, -former], [after, a]));
    const out = this.equilibrium.held(plus(inertia, left, -carried));
    this.next = { u: end, v: velocity, a: after, left: out };
    return { displacement: end, error, way: h * largest(velocity) + h * h * largest(after) };
  }

  /** M u, in kg times the unit of u. */
  private massOf(u: Float64Array): Float64Array {
    const { motion, d } = this.equilibrium.solid.body;
    return gathered(motion!.mass, u, d);
  }

  private springs(k: number, pull: Float64Array): Acting {
    const { motion, d } = this.equilibrium.solid.body;
    const { starts, nodes, weights } = motion!.mass;
    return {
      forces: (u) => plus(pull, this.massOf(u), -k),
      tangents: (_, use) => {
        for (let row = 0; row < starts.length - 1; row++) {
          const others = nodes.subarray(starts[row], starts[row + 1]);
          const [n, own] = [others.length, others.indexOf(row)];
          const matrix = new Float64Array(n * n); // half of a row and of a column of k M
          others.forEach((_, i) => {
            const half = (k * weights[starts[row] + i]) / 2;
            matrix[own * n + i] += half;
            matrix[i * n + own] += half;
          });
          for (let j = 0; j < d; j++)
            use(
              others.map((node) => node * d + j),
              matrix,
            );
        }
      },
    };
  }

  /** The equilibrium of a step, from where the body coasts, and what the last step of Newton's method leaves. */
  private settled(f: Float64Array, start: Float64Array): [Float64Array, Float64Array] | null {
    const { equilibrium } = this;
    let tangent = (this.tangent ??= this.rest ??= equilibrium.tangent(new Float64Array(f.length)));
    const from = (u: Float64Array): Float64Array => tangent.solve(equilibrium.outOfBalance(u, f));
    let u = equilibrium.inverted(start) ? this.at.u : start;
    let [step, left, isFresh] = [from(u), 1, false];
    for (let iteration = 0; iteration < ITERATIONS; iteration++) {
      const size = norm(step);
      if (size <= TOLERANCE * norm(u)) return [plus(u, step, -1), step.map((way) => left * way)];
      let [next, after, part] = [u, step, 2];
      while (!(norm(after) <= (1 - part / 4) * size) && (part /= 2) >= SHORTEST) {
        next = plus(u, step, -part);
        after = from(next);
      }
      const isCloser = part >= SHORTEST;
      if (!isCloser && isFresh) return null;
      if (isCloser) [u, step, left] = [next, after, norm(after) / size];
      isFresh = !isCloser || left > CONTRACTION;
      if (!isFresh) continue;
      this.tangent = tangent = equilibrium.tangent(u);
      step = from(u);
    }
    return null;
  }
}
