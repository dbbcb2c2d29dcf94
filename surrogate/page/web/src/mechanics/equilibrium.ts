/**
 * Equilibrium of the body under nodal forces, as `surrogate/mechanics/out_of_balance.py`:
 *
 *   r(u) = f_int(u) − f,  Π(u) = E(u) − f·u,  δ(u) = −K(u)⁻¹ r(u)
 *
 * at the free degrees of freedom. Where K is not positive definite, K + τ K(0) takes its place,
 * with the first τ = 0.1 · 4^k that is sufficient.
 */

import { Layout } from "./layout";
import type { ProfileCholesky } from "./profile_cholesky";
import type { Solid } from "./solid";

const FIRST_SHIFT = 0.1;
const SHIFT_GROWTH = 4;

/** A factor of K(u), or of K(u) + τ K(0) where K(u) is not positive definite. */
export interface Tangent {
  factor: ProfileCholesky;
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
  private readonly layout: Layout;
  private undeformed: ProfileCholesky | null = null;
  private rounded: RoundOff | null = null;

  /**
   * @param solid - the body
   * @param order - free degrees of freedom, node · d + component, in the order of the profile
   * @param size - number of all degrees of freedom
   */
  constructor(
    readonly solid: Solid,
    readonly order: Int32Array,
    readonly size: number,
  ) {
    const { lambda, mu } = solid.material;
    this.rounding = 10 * Number.EPSILON * (lambda + mu) * solid.volume;
    this.layout = new Layout(solid.cells, solid.corners, solid.d, order, size);
  }

  /** r(u) in N, zero at clamped nodes. */
  outOfBalance(u: Float64Array, f: Float64Array): Float64Array {
    return this.solid
      .internalForces(u)
      .map((value, dof) => (this.layout.place[dof] < 0 ? 0 : value - f[dof]));
  }

  /** Π(u) in J. */
  potential(u: Float64Array, f: Float64Array): number {
    return this.solid.energy(u) - dot(u, f);
  }

  /** Displacements of the free nodes; zero at clamped ones. */
  held(u: ArrayLike<number>): Float64Array {
    return Float64Array.from(u, (value, dof) => (this.layout.place[dof] < 0 ? 0 : value));
  }

  /** Factorise K(u), or a positive definite matrix near it. */
  tangent(u: Float64Array): Tangent {
    const factor = this.layout.factor(this.assembled(u));
    if (factor) return { factor, stable: true };
    for (let shift = FIRST_SHIFT; shift < 1 / Number.EPSILON; shift *= SHIFT_GROWTH) {
      const values = this.assembled(u);
      const rest = this.assembled(new Float64Array(this.size));
      for (let i = 0; i < values.length; i++) values[i] += shift * rest[i];
      const shifted = this.layout.factor(values);
      if (shifted) return { factor: shifted, stable: false };
    }
    return { factor: this.rest(), stable: false };
  }

  /** K⁻¹ b with a factor, for b and the result at all degrees of freedom. */
  solve(factor: ProfileCholesky, right: Float64Array): Float64Array {
    return this.layout.solve(factor, right);
  }

  /** K(0)⁻¹ f in m; the factor is kept. */
  linearResponse(f: Float64Array): Float64Array {
    return this.solve(this.rest(), f);
  }

  /** Rounding error of ‖r‖, as `shared_schema/common/bodies/force_tolerance.py`; it is kept. */
  get roundOff(): RoundOff {
    if (!this.rounded) {
      const diagonal = this.layout.diagonal(this.assembled(new Float64Array(this.size)));
      const largest = diagonal.reduce((most, value) => Math.max(most, value), 0);
      const atRest = Number.EPSILON * this.solid.meanEdge * norm(diagonal);
      this.rounded = { atRest, perDisplacement: Number.EPSILON * largest };
    }
    return this.rounded;
  }

  private rest(): ProfileCholesky {
    this.undeformed ??= this.layout.factor(this.assembled(new Float64Array(this.size)));
    if (!this.undeformed) throw new Error("the supports do not hold the body");
    return this.undeformed;
  }

  private assembled(u: Float64Array): Float64Array {
    return this.layout.assembled((cell, k) => {
      this.solid.cellTangent(u, cell, k);
    });
  }
}

export function dot(a: Float64Array, b: Float64Array): number {
  let sum = 0;
  for (let i = 0; i < a.length; i++) sum += a[i] * b[i];
  return sum;
}

export function norm(a: Float64Array): number {
  return Math.sqrt(dot(a, a));
}

/** a + factor · b */
export function plus(a: Float64Array, b: Float64Array, factor = 1): Float64Array {
  return a.map((value, i) => value + factor * b[i]);
}
