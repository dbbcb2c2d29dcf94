/**
 * The compliance of the undeformed body, carried to a state, as `surrogate/descent/carried_compliance.py`:
 *
 *   P = T K(0)⁻¹ Tᵀ,  T y = L⁻¹ Σ_q w_q (F_q ∇y) ∇N
 *
 * with the Laplacian L of every component; the modulus of a body of one material cancels.
 */

import type { Equilibrium } from "./equilibrium";
import { Layout } from "./layout";
import type { ProfileCholesky } from "./profile_cholesky";

interface Laplacian {
  layout: Layout;
  factor: ProfileCholesky;
}

export class CarriedCompliance {
  private readonly laplacians: Laplacian[] = [];

  constructor(private readonly equilibrium: Equilibrium) {
    const { solid, order, size } = equilibrium;
    const { d, cells, corners } = solid;
    const alike = new Map<string, Laplacian>();
    for (let i = 0; i < d; i++) {
      const nodes = order.filter((dof) => dof % d === i).map((dof) => (dof - i) / d);
      const key = nodes.join();
      let found = alike.get(key);
      if (!found) {
        const layout = new Layout(cells, corners, 1, nodes, size / d);
        const factor = layout.factor(
          layout.assembled((cell, k) => {
            solid.cellLaplacian(cell, k);
          }),
        );
        if (!factor) throw new Error("the supports do not hold the body");
        found = { layout, factor };
        alike.set(key, found);
      }
      this.laplacians.push(found);
    }
  }

  /** P of a state: forces in N to displacements in m, (nodes · d). */
  at(u: Float64Array): (force: Float64Array) => Float64Array {
    const { solid } = this.equilibrium;
    const { d } = solid;
    const f = solid.slopes(u);
    for (let i = 0; i < f.length; i++) if ((i % (d * d)) % (d + 1) === 0) f[i] += 1;
    return (force) => {
      const back = solid.forcesOf(this.product(f, solid.slopes(this.poisson(force)), true));
      const response = this.equilibrium.linearResponse(back);
      return this.poisson(solid.forcesOf(this.product(f, solid.slopes(response), false)));
    };
  }

  /** F H, or Fᵀ H, at the quadrature points: (points, d, d). */
  private product(f: Float64Array, h: Float64Array, transposed: boolean): Float64Array {
    const { d } = this.equilibrium.solid;
    const found = new Float64Array(h.length);
    for (let point = 0; point < h.length; point += d * d) {
      for (let i = 0; i < d; i++) {
        for (let k = 0; k < d; k++) {
          const factor = f[point + (transposed ? k * d + i : i * d + k)];
          for (let j = 0; j < d; j++) found[point + i * d + j] += factor * h[point + k * d + j];
        }
      }
    }
    return found;
  }

  /** L⁻¹ of every component, zero where it is held. */
  private poisson(right: Float64Array): Float64Array {
    const { d } = this.equilibrium.solid;
    const found = new Float64Array(right.length);
    this.laplacians.forEach(({ layout, factor }, i) => {
      const component = layout.solve(
        factor,
        right.filter((_, dof) => dof % d === i),
      );
      component.forEach((value, node) => (found[node * d + i] = value));
    });
    return found;
  }
}
