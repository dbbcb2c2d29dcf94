/**
 * The compliance of the undeformed body, carried to a state, as `surrogate/descent/carried_compliance.py`:
 *
 *   P = T K(0)⁻¹ Tᵀ,  (T y)_a = Σ_b (L⁻¹)_ab Σ_c Σ_e k^c_be F_c y_e
 *
 * with the mean F of a cell, the Laplacian k of a cell, by its shear modulus, and that of every
 * component, L.
 */

import type { Equilibrium } from "./equilibrium";
import { Layout } from "./layout";
import type { ProfileFactor } from "./profile_factor";

interface Laplacian {
  layout: Layout;
  factor: ProfileFactor;
}

export class CarriedCompliance {
  private readonly laplacians: Laplacian[] = [];
  private readonly ofCells: Float64Array;

  constructor(private readonly equilibrium: Equilibrium) {
    const { solid, order, size } = equilibrium;
    const { d, corners, body } = solid;
    const entries = corners * corners;
    this.ofCells = new Float64Array(solid.cellCount * entries);
    for (let cell = 0; cell < solid.cellCount; cell++) {
      solid.cellLaplacian(cell, this.ofCells.subarray(cell * entries, (cell + 1) * entries));
    }
    const alike = new Map<string, Laplacian>();
    for (let i = 0; i < d; i++) {
      const nodes = order.filter((dof) => dof < size && dof % d === i).map((dof) => (dof - i) / d);
      const key = nodes.join();
      let found = alike.get(key);
      if (!found) {
        const layout = new Layout(body.cells, corners, nodes, size / d);
        const factor = layout.factor(
          layout.assembled((add) => {
            for (let cell = 0; cell < solid.cellCount; cell++)
              add(cell, this.ofCells.subarray(cell * entries, (cell + 1) * entries));
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
    const f = this.equilibrium.solid.meanDeformation(u);
    return (force) => {
      const back = this.laplaciansOfTurned(f, this.poisson(force), true);
      const response = this.equilibrium.linearResponse(back);
      return this.poisson(this.laplaciansOfTurned(f, response, false));
    };
  }

  /** Σ_c k_c F_c y, or that of Fᵀ: (nodes · d). */
  private laplaciansOfTurned(f: Float64Array, y: Float64Array, transposed: boolean): Float64Array {
    const { d, corners } = this.equilibrium.solid;
    const { cells } = this.equilibrium.solid.body;
    const found = new Float64Array(y.length);
    const turned = new Float64Array(corners * d);
    for (let first = 0, cell = 0; first < cells.length; first += corners, cell++) {
      turned.fill(0);
      for (let b = 0; b < corners; b++) {
        for (let i = 0; i < d; i++) {
          for (let j = 0; j < d; j++) {
            const factor = f[cell * d * d + (transposed ? j * d + i : i * d + j)];
            turned[b * d + i] += factor * y[cells[first + b] * d + j];
          }
        }
      }
      for (let a = 0; a < corners; a++) {
        for (let b = 0; b < corners; b++) {
          const k = this.ofCells[(first + a) * corners + b];
          for (let i = 0; i < d; i++) found[cells[first + a] * d + i] += k * turned[b * d + i];
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
