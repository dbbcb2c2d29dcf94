/**
 * A body under actuators in modes of its displacement, as `surrogate/mechanics/actuation`:
 *
 *   R(q) = Φᵀ f_int(Φ q) − Φᵀ f − Σ_i a_i Φᵀ g_i(Φ q) = 0,  h_i(a_i, q_i) = 0
 *
 * with the internal forces of a few weighted cells, and Newton's method for coefficients and amplitudes
 * together. Each search begins where the last one has ended.
 */

import type { Elements } from "./body";
import { equation, givesAmplitude, type Control, type Equation } from "./control";
import type { FollowingLoad } from "./following";
import { Galerkin } from "./galerkin";
import { Solid } from "./solid";
import { combined, dot, norm, plus, solve, times, unit } from "./vectors";

const ITERATIONS = 25;
const HALVINGS = 8;
const SETTLED = 1e-6; // of a step beside the state
const LEAST = 1e-12; // of the size of the body: a step that rounding errors make
const CONTRACTION = 0.4; // of steps with one tangent
const SHORTEST = 1 / 64; // part of the way

/** What is given of an actuator on a page: its limits, and its value at rest. */
export interface Slider {
  name: string;
  kind: Control["kind"];
  unit: string;
  low: number;
  high: number;
  rest: number;
  /** Names and units of amplitude and quantity. */
  readings: [name: string, unit: string][];
}

/** Actuators and modes of a body, as `surrogate/page/page_actuators.py` writes them. */
export interface Actuation {
  /** Of the actuators, which are the last loads that follow the body. */
  sliders: Slider[];
  /** Of all of these loads. */
  controls: Control[];
  /** Of the body in m. */
  size: number;
  /** The sampled cells, with weighted volumes. */
  elements: Elements;
  /** At all points of the body, and at those of the sampled cells, (modes, points, d). */
  modes: Float64Array;
  ofElements: Float64Array;
  /** Nodes of the corners of what bounds chambers: triangles, in the plane lines. */
  chambers: Int32Array;
}

/** A state in equilibrium: coefficients in m, amplitudes in Pa or N, what is given, work of dead loads in J. */
export interface Balanced {
  q: Float64Array;
  amplitudes: Float64Array;
  given: Float64Array;
  work: Float64Array;
}

/** Lack of balance of a state. */
interface Residual {
  /** Of the works on the modes in J. */
  forces: Float64Array;
  /** Works of the unit forces g on the modes, and lengths or volumes. */
  units: Float64Array[];
  quantities: number[];
}

type Step = Pick<Balanced, "q" | "amplitudes">;

export class ActuatedModes {
  /** Modes at all points. */
  readonly fields: readonly Float64Array[];
  at: Balanced;
  /** Number of the first actuator. */
  readonly first: number;
  private readonly controls: readonly Control[];
  private readonly galerkin: Galerkin;
  /** Components that each load acts on, and the modes there. */
  private readonly acted: readonly { components: Int32Array; fields: Float64Array[] }[];
  /** K⁻¹ of the body at rest, and of a state nearby, (modes · modes). */
  private readonly flexibility: Float64Array;
  private inverse: Float64Array;

  constructor(
    readonly of: Actuation,
    private readonly loads: readonly FollowingLoad[],
    points: number,
  ) {
    const { controls, sliders, elements, modes, ofElements } = of;
    const n = modes.length / points;
    this.controls = controls;
    this.first = controls.length - sliders.length;
    this.fields = rows(modes, n);
    this.galerkin = new Galerkin(new Solid(elements), rows(ofElements, n));
    this.acted = loads.map((load) => {
      const components = Int32Array.from(new Set(load.components));
      const fields = this.fields.map((field) => Float64Array.from(components, (i) => field[i]));
      return { components, fields };
    });
    const [q, amplitudes] = [new Float64Array(n), new Float64Array(controls.length)];
    const given = Float64Array.from(controls, ({ kind, rest }) =>
      kind === "length" || kind === "volume" ? rest : 0,
    );
    this.at = { q, amplitudes, given, work: new Float64Array(n) };
    this.flexibility = this.inverse = this.inverted(q, amplitudes);
  }

  /** Works of forces in N on the modes in J. */
  worksOf(force: Float64Array): Float64Array {
    return Float64Array.from(this.fields, (field) => dot(field, force));
  }

  /** Displacement in m of the state. */
  displacement(q = this.at.q): Float64Array {
    return combined(q, this.fields);
  }

  /** What of a linear response in m modes leave out, under dead loads of some work. */
  leftOut(response: Float64Array, work: Float64Array): Float64Array {
    return plus(response, this.displacement(times(this.flexibility, work)), -1);
  }

  /** Lengths in m and volumes in m³ of the state. */
  quantities(u = this.displacement()): number[] {
    return this.loads.map((load) => load.quantity(u));
  }

  /** Go to the equilibrium under what is given and dead loads of some work; the part that is reached. */
  move(given: ArrayLike<number>, work: Float64Array): number {
    const begun = this.at;
    let reached = 0;
    for (let step = 1; reached < 1 && step >= SHORTEST;) {
      const part = Math.min(1, reached + step);
      const towards = (from: Float64Array, to: ArrayLike<number>): Float64Array =>
        from.map((value, i) => (1 - part) * value + part * to[i]);
      const found = this.newton(towards(begun.given, given), towards(begun.work, work));
      if (found) [this.at, reached, step] = [found, part, 2 * step];
      else step /= 2;
    }
    return reached;
  }

  /** Derivatives of the coefficients by what is given of each load. */
  changes(): Float64Array[] {
    const { q, amplitudes, given, work } = this.at;
    const residual = this.residual(q, amplitudes, work)!;
    this.inverse = this.inverted(q, amplitudes);
    const { moved, matrix, equations } = this.bordered(residual, amplitudes, given);
    const n = given.length;
    const right = unit(n).map((value, place) => -value * equations[place % n][3]);
    const found = solve(matrix, right, n)!;
    return rows(found, n).map((_, of) =>
      combined(
        moved.map((_, i) => found[i * n + of]),
        moved,
      ),
    );
  }

  private residual(q: Float64Array, amplitudes: Float64Array, work: Float64Array): Residual | null {
    const forces = this.galerkin.works(q);
    if (!forces) return null;
    const u = this.displacement(q);
    const units = this.loads.map((load, i) => this.worksOn(i, load.forces(u)));
    const known = this.controls.every(givesAmplitude);
    const quantities = known ? units.map(() => 1) : this.quantities(u);
    return {
      forces: plus(plus(forces, work, -1), combined(amplitudes, units), -1),
      units,
      quantities,
    };
  }

  /** Works on the modes of forces at the points that a load acts on. */
  private worksOn(load: number, forces: Float64Array): Float64Array {
    const { components, fields } = this.acted[load];
    const own = new Float64Array(components.length);
    for (let i = 0; i < own.length; i++) own[i] = forces[components[i]];
    return Float64Array.from(fields, (field) => dot(field, own));
  }

  /** K⁻¹ of a state, whose works were asked last. */
  private inverted(q: Float64Array, amplitudes: Float64Array): Float64Array {
    this.galerkin.works(q);
    const matrix = this.galerkin.tangent();
    const u = this.displacement(q);
    const n = q.length;
    this.loads.forEach((load, i) => {
      if (amplitudes[i] === 0) return;
      this.fields.forEach((field, l) => {
        const works = this.worksOn(i, load.forces(u, field));
        for (let k = 0; k < n; k++) matrix[k * n + l] -= amplitudes[i] * works[k];
      });
    });
    return solve(matrix, unit(n), n) ?? this.inverse;
  }

  /** Responses to the units, the matrix of the equations h beside them, and these. */
  private bordered(
    { units, quantities }: Residual,
    amplitudes: Float64Array,
    given: Float64Array,
  ): { moved: Float64Array[]; matrix: Float64Array; equations: Equation[] } {
    const n = units.length;
    const moved = units.map((g) => times(this.inverse, g));
    const equations = this.controls.map((control, i) =>
      equation(control, given[i], amplitudes[i], quantities[i]),
    );
    const matrix = new Float64Array(n * n);
    equations.forEach(([, byAmplitude, byQuantity], i) => {
      moved.forEach((change, j) => {
        const along = this.loads[i].sign * byQuantity * dot(units[i], change);
        matrix[i * n + j] = along + (i === j ? byAmplitude : 0);
      });
    });
    return { moved, matrix, equations };
  }

  /** δq and δa with the present K⁻¹. */
  private step(residual: Residual, amplitudes: Float64Array, given: Float64Array): Step {
    const back = times(this.inverse, residual.forces);
    const { moved, matrix, equations } = this.bordered(residual, amplitudes, given);
    const right = Float64Array.from(equations, ([value, , byQuantity], i) => {
      return this.loads[i].sign * byQuantity * dot(residual.units[i], back) - value;
    });
    const change = solve(matrix, right) ?? right.fill(NaN);
    return { q: plus(combined(change, moved), back, -1), amplitudes: change };
  }

  /** Newton's method; null if it does not settle. */
  private newton(given: Float64Array, work: Float64Array): Balanced | null {
    let { q, amplitudes } = this.at;
    amplitudes = amplitudes.map((a, i) => (givesAmplitude(this.controls[i]) ? given[i] : a));
    let residual = this.residual(q, amplitudes, work);
    if (!residual) return null;
    let step = this.step(residual, amplitudes, given);
    let isRough = true;
    for (let iteration = 0; iteration < ITERATIONS; iteration++) {
      const size = norm(step.q);
      if (size <= Math.max(SETTLED * norm(q), LEAST * this.of.size))
        return { q: plus(q, step.q), amplitudes: plus(amplitudes, step.amplitudes), given, work };
      let after: Step | null = null;
      for (let halving = 0; halving < HALVINGS && !after; halving++) {
        const part = 0.5 ** halving;
        const [trial, other] = [plus(q, step.q, part), plus(amplitudes, step.amplitudes, part)];
        const there = this.residual(trial, other, work);
        const simplified = there && this.step(there, other, given);
        if (simplified && norm(simplified.q) <= (1 - part / 4) * size)
          [after, q, amplitudes, residual] = [simplified, trial, other, there];
      }
      if (!after && !isRough) return null;
      if (after && norm(after.q) <= CONTRACTION * size) {
        step = after; // with the same tangent
        continue;
      }
      this.inverse = this.inverted(q, amplitudes);
      isRough = false;
      step = this.step(residual, amplitudes, given);
    }
    return null;
  }
}

/** Rows of a matrix. */
function rows(matrix: Float64Array, count: number): Float64Array[] {
  const width = matrix.length / count;
  return Array.from({ length: count }, (_, i) => matrix.subarray(i * width, (i + 1) * width));
}
