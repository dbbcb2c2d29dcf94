/**
 * Components of a field at nodes, in the order of a profile, as `surrogate/mechanics/matrices/band_matrix.py`.
 */

import { Profile, ProfileCholesky } from "./profile_cholesky";

export class Layout {
  /** Row of every component, node · components + component; -1 where it is held. */
  readonly place: Int32Array;
  private readonly profile: Profile;

  /**
   * @param cells - (cells, corners)
   * @param components - of the field at a node
   * @param order - free components in the order of the profile
   * @param size - number of all components
   */
  constructor(
    private readonly cells: Int32Array,
    private readonly corners: number,
    private readonly components: number,
    private readonly order: Int32Array,
    private readonly size: number,
  ) {
    this.place = new Int32Array(size).fill(-1);
    order.forEach((dof, row) => (this.place[dof] = row));
    const firsts = order.map((_, row) => row);
    this.forCells((rows) => {
      const first = rows.reduce(
        (least, row) => (row >= 0 ? Math.min(least, row) : least),
        Infinity,
      );
      for (const row of rows) if (row >= 0) firsts[row] = Math.min(firsts[row], first);
    });
    this.profile = new Profile(order.length, firsts);
  }

  /** Add matrices of the cells, which a function writes, rows and columns numbered corner by corner. */
  assembled(cellMatrix: (cell: number, k: Float64Array) => void): Float64Array {
    const values = this.profile.zeros();
    const size = this.corners * this.components;
    const k = new Float64Array(size * size);
    this.forCells((rows, cell) => {
      cellMatrix(cell, k);
      for (let a = 0; a < size; a++) {
        const row = rows[a];
        if (row < 0) continue;
        for (let b = 0; b < size; b++) {
          const column = rows[b];
          if (column >= 0 && column <= row)
            values[this.profile.place(row, column)] += k[a * size + b];
        }
      }
    });
    return values;
  }

  /** The diagonal of an assembled matrix, (free components). */
  diagonal(values: Float64Array): Float64Array {
    return Float64Array.from(this.order, (_, row) => values[this.profile.place(row, row)]);
  }

  /** Factorise a matrix, which is overwritten; null if it is not positive definite. */
  factor(values: Float64Array): ProfileCholesky | null {
    return ProfileCholesky.of(this.profile, values);
  }

  /** A⁻¹ b with a factor, for b and the result at all components. */
  solve(factor: ProfileCholesky, right: Float64Array): Float64Array {
    const found = factor.solve(Float64Array.from(this.order, (dof) => right[dof]));
    const u = new Float64Array(this.size);
    this.order.forEach((dof, row) => (u[dof] = found[row]!));
    return u;
  }

  /** Call a function with the rows of every cell's components, -1 where they are held. */
  private forCells(use: (rows: Int32Array, cell: number) => void): void {
    const { corners, components, cells } = this;
    const rows = new Int32Array(corners * components);
    for (let cell = 0; cell < cells.length / corners; cell++) {
      for (let a = 0; a < corners; a++) {
        for (let i = 0; i < components; i++)
          rows[a * components + i] = this.place[cells[cell * corners + a] * components + i]!;
      }
      use(rows, cell);
    }
  }
}
