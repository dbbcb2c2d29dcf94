/**
 * Equilibrium of the body under forces and pressures, as `surrogate/mechanics/out_of_balance.py`:
 *
 *   r(u) = f_int(u) − f − f_p(u),  Π(u) = E(u) − f·u,  δ(u) = −K(u)⁻¹ r(u)
 *
 * at the free degrees of freedom. Where K is not positive definite, K + τ K(0) takes its place,
 * with the first τ = 0.1 · 4^k that is sufficient. Under pressures there is no Π, and δ is always that
 * of K itself: iterations solve with it, by the factor of its symmetric part.
 */

import { Layout } from "./layout";
import { Pressure } from "./pressure";
import type { ProfileFactor } from "./profile_factor";
import type { Solid } from "./solid";
import { rowsOf, writeTangents, type Kind } from "./tangent";

const FIRST_SHIFT = 0.1;
const SHIFT_GROWTH = 4;
const ITERATIONS = 100; // with a tangent that is not symmetric
const EXACT = 1e-14; // of the right side: what iterations leave

/** What solves with K(u), or K(u) + τ K(0) where K(u) is not positive definite. */
export interface Tangent {
  solve: (right: Float64Array) => Float64Array;
  stable: boolean;
}

/** Rounding error of ‖r‖: at rest in N, and per ‖u‖ in N/m. */
interface RoundOff {
  atRest: number;
  perDisplacement: number;
}

export class Equilibrium {
  /** Bound of the rounding error of Π in J. */
  readonly rounding: number;
  /** Pressures that follow the surface; null if there are none. */
  pressure: Pressure | null = null;
  /** Number of the displacements' components. */
  readonly size: number;
  private readonly layout: Layout;
  /** Number of the negative eigenvalues of tangents that are positive definite beside p. */
  private readonly negative: number;
  private undeformed: ProfileFactor | null = null;
  private rounded: RoundOff | null = null;

  /** @param order - free unknowns in the order of the profile; by default those of the body */
  constructor(
    readonly solid: Solid,
    readonly order: Int32Array = solid.body.order,
  ) {
    const { laws, dilation, cells, coordinates } = solid.body;
    const { d, corners } = solid;
    this.size = coordinates.length;
    const moduli = Math.max(...laws.map(({ lambda, mu }) => lambda + mu));
    this.rounding = 10 * Number.EPSILON * moduli * solid.volume;
    const rows = rowsOf(solid);
    const numbers = new Int32Array(solid.cellCount * rows);
    const width = (rows - corners * d) / 2;
    this.negative = width ? dilation!.nodes.reduce((most, node) => Math.max(most, node + 1), 0) : 0;
    for (let cell = 0; cell < solid.cellCount; cell++) {
      for (let row = 0; row < rows; row++) {
        const beyond = row - corners * d;
        numbers[cell * rows + row] =
          beyond < 0
            ? cells[cell * corners + Math.floor(row / d)] * d + (row % d)
            : this.size +
              dilation!.nodes[cell * width + (beyond % width)] +
              (beyond < width ? 0 : this.negative);
      }
    }
    this.layout = new Layout(numbers, rows, order, this.size + 2 * this.negative);
  }

  /** Set the pressures of the surfaces in Pa. */
  under(pressures: readonly number[]): void {
    const { d, coordinates, surfaces } = this.solid.body;
    const acts = surfaces !== null && pressures.some((value) => value !== 0);
    this.pressure = acts ? new Pressure(d, coordinates, surfaces, pressures) : null;
  }

  /** r(u) in N, zero at clamped nodes; NaN where a cell is inverted, or a number is not finite. */
  outOfBalance(u: Float64Array, f: Float64Array): Float64Array {
    const states = this.solid.at(u);
    const pushed = this.pressure?.forces(u);
    const r = this.solid
      .internalForces(states)
      .map((value, dof) =>
        this.layout.place[dof] < 0 ? 0 : value - f[dof] - (pushed ? pushed[dof] : 0),
      );
    const isSound = this.solid.inverted(states) === 0 && r.every(Number.isFinite);
    return isSound ? r : r.fill(NaN);
  }

  /** Number of inverted cells. */
  inverted(u: Float64Array): number {
    return this.solid.inverted(this.solid.at(u));
  }

  /** Π(u) in J under dead forces. */
  potential(u: Float64Array, f: Float64Array): number {
    const energy = this.solid.energy(this.solid.at(u)) - dot(u, f);
    return Number.isNaN(energy) ? Infinity : energy;
  }

  /** Displacements of the free nodes; zero at clamped ones. */
  held(u: ArrayLike<number>): Float64Array {
    return Float64Array.from(u, (value, dof) => (this.layout.place[dof] < 0 ? 0 : value));
  }

  /** Factorise K(u), or a positive definite matrix near it. */
  tangent(u: Float64Array): Tangent {
    if (this.pressure) return this.underPressure(u, this.pressure);
    const factor = this.factor(this.assembled(u));
    if (factor) return { solve: this.solver(factor), stable: true };
    const rest = this.assembled(new Float64Array(this.size), "pointwise");
    for (let shift = FIRST_SHIFT; shift < 1 / Number.EPSILON; shift *= SHIFT_GROWTH) {
      const values = this.assembled(u);
      for (let i = 0; i < values.length; i++) values[i] += shift * rest[i];
      const shifted = this.factor(values);
      if (shifted) return { solve: this.solver(shifted), stable: false };
    }
    return { solve: this.solver(this.rest()), stable: false };
  }

  /** K(0)⁻¹ f in m; the factor is kept. */
  linearResponse(f: Float64Array): Float64Array {
    return this.layout.solve(this.rest(), f);
  }

  /** A step that makes the dilations of the cells right, if they are their own. */
  relaxed(u: Float64Array, f: Float64Array): Float64Array {
    if (!this.solid.projects) return u;
    const factor = this.factor(this.assembled(u, "relaxed"));
    if (!factor) return u;
    const trial = plus(u, this.layout.solve(factor, this.outOfBalance(u, f)), -1);
    return this.inverted(trial) ? u : trial;
  }

  /** Rounding error of ‖r‖, as `shared_schema/common/bodies/force_tolerance.py`; it is kept. */
  get roundOff(): RoundOff {
    if (!this.rounded) {
      const values = this.assembled(new Float64Array(this.size), "pointwise");
      const diagonal = this.layout.diagonal(values);
      const largest = diagonal.reduce((most, value) => Math.max(most, value), 0);
      const atRest = Number.EPSILON * this.solid.body.edge * norm(diagonal);
      this.rounded = { atRest, perDisplacement: Number.EPSILON * largest };
    }
    return this.rounded;
  }

  private rest(): ProfileFactor {
    this.undeformed ??= this.factor(this.assembled(new Float64Array(this.size)));
    if (!this.undeformed) throw new Error("the supports do not hold the body");
    return this.undeformed;
  }

  private solver(factor: ProfileFactor): Tangent["solve"] {
    return (right) => this.layout.solve(factor, right);
  }

  /** The factor of a matrix that is positive definite, beside p; else null. */
  private factor(values: Float64Array): ProfileFactor | null {
    const factor = this.layout.factor(values, this.negative);
    return factor?.negative === this.negative ? factor : null;
  }

  /** K, or of θ = J where elements that are joined have their own: K(0) is then positive definite. */
  private assembled(u: Float64Array, kind: Kind = "full"): Float64Array {
    const joined = this.negative > 0;
    return this.layout.assembled((add) => {
      const states = this.solid.at(u);
      writeTangents(this.solid, states, kind === "pointwise" && !joined ? "full" : kind, add);
    });
  }

  /** K of a state under pressures: K x = (S + A) x, by iterations with S⁻¹. */
  private underPressure(u: Float64Array, pressure: Pressure): Tangent {
    const values = this.assembled(u);
    const skew: [Int32Array, Float64Array][] = [];
    pressure.tangents(u, (components, k) => {
      this.layout.add(values, components, k);
      const n = components.length;
      const half = k.map((value, i) => (value - k[(i % n) * n + Math.floor(i / n)]) / 2);
      if (half.some((value) => value !== 0)) skew.push([components, half]);
    });
    const factor = this.layout.factor(values, Infinity);
    if (!factor) return { solve: this.solver(this.rest()), stable: false };
    const symmetric = this.solver(factor);
    const turned = (x: Float64Array): Float64Array => {
      const found = new Float64Array(x.length);
      for (const [components, k] of skew) {
        const n = components.length;
        const local = Float64Array.from(components, (i) => x[i]);
        components.forEach((i, row) => {
          found[i] += dot(k.subarray(row * n, (row + 1) * n), local);
        });
      }
      return plus(x, symmetric(found));
    };
    const solve = (right: Float64Array): Float64Array => solved(turned, symmetric(right));
    return { solve, stable: factor.negative === this.negative };
  }
}

/** Solve A x = b by minimal residuals (GCR), for an A near 1. */
function solved(a: (x: Float64Array) => Float64Array, b: Float64Array): Float64Array {
  const size = norm(b);
  const known: [direction: Float64Array, image: Float64Array][] = []; // images are orthonormal
  let left = b;
  let x: Float64Array = new Float64Array(b.length);
  while (known.length < ITERATIONS && norm(left) > EXACT * size) {
    let direction = left;
    let image = a(left);
    for (const [other, turned] of known) {
      const share = dot(image, turned);
      direction = plus(direction, other, -share);
      image = plus(image, turned, -share);
    }
    const length = norm(image);
    if (!(length > 0)) break;
    known.push([direction.map((value) => value / length), image.map((value) => value / length)]);
    const share = dot(left, image) / length;
    x = plus(x, direction, share / length);
    left = plus(left, image, -share / length);
  }
  return Number.isFinite(size) ? x : b;
}

export function dot(a: Float64Array, b: Float64Array): number {
  let sum = 0;
  for (let i = 0; i < a.length; i++) sum += a[i] * b[i];
  return sum;
}

export function norm(a: Float64Array): number {
  return Math.sqrt(dot(a, a));
}

/** Largest length of a node's vector in a field, (nodes · d). */
export function longest(field: ArrayLike<number>, d: number): number {
  let most = 0;
  for (let place = 0; place < field.length; place += d) {
    let sum = 0;
    for (let i = 0; i < d; i++) sum += field[place + i] ** 2;
    most = Math.max(most, sum);
  }
  return Math.sqrt(most);
}

/** a + factor · b */
export function plus(a: Float64Array, b: Float64Array, factor = 1): Float64Array {
  return a.map((value, i) => value + factor * b[i]);
}
