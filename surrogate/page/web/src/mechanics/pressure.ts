/**
 * Pressures that follow the surface, as `shared_schema/common/bodies/facet_quadrature.py`:
 *
 *   f_a = −p ∫ N_a n dS,  n dS = t₁ × t₂
 *
 * with the tangents t of a facet; in the plane n dS is the tangent turned by 90°. Forces are
 * bilinear in the positions (in the plane linear), so that those of a power series are sums of
 * products.
 */

import type { Surfaces } from "./messages";

export class Pressure {
  /**
   * @param coordinates - positions of all points at rest in m
   * @param pressures - of every surface in Pa
   */
  constructor(
    private readonly d: number,
    private readonly coordinates: Float64Array,
    private readonly surfaces: Surfaces,
    private readonly pressures: readonly number[],
  ) {}

  /** Forces on the displaced body in N. */
  forces(u: Float64Array): Float64Array {
    return this.term([u]);
  }

  /** Forces of order k of the series of displacements s u₁ + … + sᵏ uₖ, which has some terms. */
  ofOrder(terms: readonly Float64Array[]): Float64Array {
    return this.term([new Float64Array(this.coordinates.length), ...terms]);
  }

  /** What the forces add to the tangent, −∂f/∂u: numbers of components, and a matrix of every facet. */
  tangents(u: Float64Array, use: (components: Int32Array, k: Float64Array) => void): void {
    const at = this.coordinates.map((x, i) => x + u[i]);
    this.forFacets((components, pressure) => {
      const n = components.length;
      const k = new Float64Array(n * n);
      const x = Float64Array.from(components, (component) => at[component]);
      for (let column = 0; column < n; column++) {
        const unit = new Float64Array(n);
        unit[column] = 1;
        const change = new Float64Array(n);
        this.add(change, pressure, unit, x);
        if (this.d === 3) this.add(change, pressure, x, unit);
        change.forEach((value, row) => (k[row * n + column] = -value));
      }
      use(components, k);
    });
  }

  /** Coefficient of the last order of the forces on a body at Σ sᵏ u_k, the first one at rest. */
  private term(u: readonly Float64Array[]): Float64Array {
    const total = new Float64Array(this.coordinates.length);
    const k = u.length - 1;
    this.forFacets((components, pressure) => {
      const local = u.map((one, order) =>
        Float64Array.from(components, (i) => one[i] + (order === 0 ? this.coordinates[i] : 0)),
      );
      const forces = new Float64Array(components.length);
      for (let i = this.d === 3 ? 0 : k; i <= k; i++)
        this.add(forces, pressure, local[i], local[k - i]);
      components.forEach((component, i) => (total[component] += forces[i]));
    });
    return total;
  }

  private forFacets(use: (components: Int32Array, pressure: number) => void): void {
    const { facets, surfaces, corners } = this.surfaces;
    surfaces.forEach((surface, facet) => {
      const pressure = this.pressures[surface];
      if (!pressure) return;
      const components = new Int32Array(corners * this.d).map(
        (_, i) => facets[facet * corners + Math.floor(i / this.d)] * this.d + (i % this.d),
      );
      use(components, pressure);
    });
  }

  /** Add −p Σ_q w_q N_a t₁(x) × t₂(y) of a facet; in the plane without y. */
  private add(forces: Float64Array, pressure: number, x: Float64Array, y: Float64Array): void {
    const { d } = this;
    const { values, gradients } = this.surfaces;
    values.forEach((shape, q) => {
      const [s, t] = [new Float64Array(3), new Float64Array(3)];
      shape.forEach((_, a) => {
        for (let i = 0; i < d; i++) {
          s[i] += gradients[q][a * (d - 1)] * x[a * d + i];
          if (d === 3) t[i] += gradients[q][a * 2 + 1] * y[a * d + i];
        }
      });
      if (d === 2) t[2] = 1;
      const normal = [0, 1, 2].map((i) => {
        const [j, k] = [(i + 1) % 3, (i + 2) % 3];
        return s[j] * t[k] - s[k] * t[j];
      });
      shape.forEach((value, a) => {
        for (let i = 0; i < d; i++) forces[a * d + i] -= pressure * value * normal[i];
      });
    });
  }
}
