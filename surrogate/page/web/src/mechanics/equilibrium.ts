/**
 * Equilibrium of the body under forces and pressures, as `surrogate/mechanics/equilibrium/out_of_balance.py`:
 *
 *   r(u) = f_int(u) − f − f_p(u),  Π(u) = E(u) − f·u,  δ(u) = −K(u)⁻¹ r(u)
 *
 * at the free degrees of freedom. Where K is not positive definite, K + τ K(0) takes its place,
 * with the first τ = 0.1 · 4^k that is sufficient. Under loads that follow the body there is no Π, and δ
 * is always that of K itself: iterations solve with it, by the factor of its symmetric part without cables.
 */

import { Following, followingLoads, type FollowingLoad } from "./following";
import { Profile, type Factor } from "./profile";
import type { Kind, Solid } from "./solid";
import { dot, norm, plus } from "./vectors";

const FIRST_SHIFT = 0.1;
const SHIFT_GROWTH = 4;
const ITERATIONS = 100; // with a tangent that is not symmetric, or has cables
const EXACT = 1e-14; // of the right side: what iterations leave

/** What solves with K(u), or K(u) + τ K(0) where K(u) is not positive definite. */
export interface Tangent {
  solve: (right: Float64Array) => Float64Array;
  stable: boolean;
}

export class Equilibrium {
  /** Pressures, tensions and inertia, which follow the body; null if there are none. */
  pressure: Following | null = null;
  /** Number of the displacements' components. */
  readonly size: number;
  private readonly profile: Profile;
  /** Components of all cells, one cell after the other. */
  private readonly numbers: Int32Array;
  /** Number of the negative eigenvalues of tangents that are positive definite beside p. */
  private readonly negative: number;
  private undeformed: Factor | null = null;
  private known: FollowingLoad[] | null = null;

  /** @param order - free unknowns in the order of the profile; by default those of the body */
  constructor(
    readonly solid: Solid,
    readonly order: Int32Array = solid.body.order,
  ) {
    const { dilation, cells, coordinates, d } = solid.body;
    this.size = coordinates.length;
    const joined = dilation?.joined ? dilation : null;
    const width = joined ? joined.shapes[0].length : 0;
    this.negative = joined?.nodes.reduce((most, node) => Math.max(most, node + 1), 0) ?? 0;
    const rows = solid.size + 2 * width;
    this.numbers = new Int32Array(solid.cellCount * rows).map((_, i) => {
      const [cell, row] = [Math.floor(i / rows), i % rows];
      const beyond = row - solid.size;
      if (beyond < 0) return cells[cell * solid.corners + Math.floor(row / d)] * d + (row % d);
      const number = joined!.nodes[cell * width + (beyond % width)];
      return this.size + number + (beyond < width ? 0 : this.negative);
    });
    this.profile = new Profile(this.numbers, rows, order, this.size + 2 * this.negative);
  }

  /** Loads of unit amplitude that follow the body. */
  get following(): readonly FollowingLoad[] {
    return (this.known ??= followingLoads(this.solid.body));
  }

  /** Set their amplitudes in Pa or N. */
  under(amplitudes: readonly number[]): void {
    const acts = amplitudes.some((value) => value !== 0);
    this.pressure = acts ? new Following(this.following, amplitudes) : null;
  }

  /** r(u) in N, zero at clamped nodes; NaN where a cell is inverted, or a number is not finite. */
  outOfBalance(u: Float64Array, f: Float64Array): Float64Array {
    const acting = this.pressure ? plus(f, this.pressure.forces(u)) : f;
    this.solid.set(0, this.solid.slopes(u));
    const r = this.held(plus(this.solid.forces(0), acting, -1));
    const isSound = this.solid.inverted() === 0 && r.every(Number.isFinite);
    return isSound ? r : r.fill(NaN);
  }

  /** Number of inverted cells. */
  inverted(u: Float64Array): number {
    this.solid.set(0, this.solid.slopes(u));
    return this.solid.inverted();
  }

  /** Π(u) in J under dead forces. */
  potential(u: Float64Array, f: Float64Array): number {
    this.solid.set(0, this.solid.slopes(u));
    return this.solid.energy() - dot(u, f);
  }

  /** Displacements of the free nodes; zero at clamped ones. */
  held(u: Float64Array): Float64Array {
    return u.map((value, dof) => (this.profile.place[dof] < 0 ? 0 : value));
  }

  /** Factorise K(u), or a positive definite matrix near it. */
  tangent(u: Float64Array): Tangent {
    if (this.pressure) return this.underPressure(u, this.pressure);
    const factor = this.factor(this.assembled(u));
    if (factor) return { solve: this.solver(factor), stable: true };
    const rest = this.assembled(new Float64Array(this.size), "pointwise");
    for (let shift = FIRST_SHIFT; shift < 1 / Number.EPSILON; shift *= SHIFT_GROWTH) {
      const shifted = this.factor(plus(this.assembled(u), rest, shift));
      if (shifted) return { solve: this.solver(shifted), stable: false };
    }
    return { solve: this.solver(this.rest()), stable: false };
  }

  /** K(0)⁻¹ f in m; the factor is kept. */
  linearResponse(f: Float64Array): Float64Array {
    return this.profile.solve(this.rest(), f);
  }

  /** A step that makes the dilations of the cells right, if they are their own. */
  relaxed(u: Float64Array, f: Float64Array): Float64Array {
    if (!this.solid.projects) return u;
    const factor = this.factor(this.assembled(u, "relaxed"));
    if (!factor) return u;
    const trial = plus(u, this.profile.solve(factor, this.outOfBalance(u, f)), -1);
    return this.inverted(trial) ? u : trial;
  }

  private rest(): Factor {
    this.undeformed ??= this.factor(this.assembled(new Float64Array(this.size)));
    if (!this.undeformed) throw new Error("the supports do not hold the body");
    return this.undeformed;
  }

  private solver(factor: Factor): Tangent["solve"] {
    return (right) => this.profile.solve(factor, right);
  }

  /** The factor of a matrix that is positive definite, beside p; else null. */
  private factor(values: Float64Array): Factor | null {
    const factor = this.profile.factor(values, this.negative);
    return factor?.negative === this.negative ? factor : null;
  }

  /** K, or of θ = J where elements that are joined have their own: K(0) is then positive definite. */
  private assembled(u: Float64Array, kind: Kind = "full"): Float64Array {
    const values = this.profile.zeros();
    const rows = this.numbers.length / this.solid.cellCount;
    this.solid.set(0, this.solid.slopes(u));
    this.solid.tangents(kind === "pointwise" && !this.negative ? "full" : kind, (cell, k) =>
      this.profile.add(values, this.numbers.subarray(cell * rows, (cell + 1) * rows), k),
    );
    return values;
  }

  /** K of a state under pressures: K x = (S + A) x, by iterations with S⁻¹. */
  private underPressure(u: Float64Array, pressure: Following): Tangent {
    const values = this.assembled(u);
    const skew: [Int32Array, Float64Array][] = [];
    pressure.tangents(u, (components, k) => {
      this.profile.add(values, components, k);
      const n = components.length;
      const half = k.map((value, i) => (value - k[(i % n) * n + Math.floor(i / n)]) / 2);
      if (half.some((value) => value !== 0)) skew.push([components, half]);
    });
    const factor = this.profile.factor(values, Infinity);
    if (!factor) return { solve: this.solver(this.rest()), stable: false };
    const symmetric = this.solver(factor);
    const turned = (x: Float64Array): Float64Array => {
      const found = pressure.ofCables(u, x);
      for (const [components, k] of skew) {
        const n = components.length;
        const local = Float64Array.from(components, (i) => x[i]);
        components.forEach(
          (i, row) => (found[i] += dot(k.subarray(row * n, (row + 1) * n), local)),
        );
      }
      return found.some(Boolean) ? plus(x, symmetric(found)) : x;
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
