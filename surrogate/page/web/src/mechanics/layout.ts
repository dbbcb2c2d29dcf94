/**
 * Sums of the matrices of cells over free components, in the order of a profile, as
 * `surrogate/mechanics/matrices/band_matrix.py`.
 */

import { Profile, ProfileFactor } from "./profile_factor";

export class Layout {
  /** Row of every component; -1 where it is held. */
  readonly place: Int32Array;
  private readonly profile: Profile;

  /**
   * @param numbers - components of every cell, (cells, width)
   * @param width - of the matrix of a cell
   * @param order - free components in the order of the profile
   * @param size - number of all components
   */
  constructor(
    private readonly numbers: Int32Array,
    private readonly width: number,
    private readonly order: Int32Array,
    readonly size: number,
  ) {
    this.place = new Int32Array(size).fill(-1);
    order.forEach((component, row) => (this.place[component] = row));
    const firsts = order.map((_, row) => row);
    for (let start = 0; start < numbers.length; start += width) {
      const rows = numbers
        .subarray(start, start + width)
        .map((component) => this.place[component])
        .filter((row) => row >= 0);
      const first = rows.reduce((least, row) => Math.min(least, row), Infinity);
      for (const row of rows) firsts[row] = Math.min(firsts[row], first);
    }
    this.profile = new Profile(order.length, firsts);
  }

  /** Add matrices of the cells, rows and columns as their components, which a function writes. */
  assembled(write: (add: (cell: number, k: Float64Array) => void) => void): Float64Array {
    const values = this.profile.zeros();
    const { numbers, width } = this;
    write((cell, k) => {
      this.add(values, numbers.subarray(cell * width, (cell + 1) * width), k);
    });
    return values;
  }

  /** Add the symmetric part of the matrix of some components. */
  add(values: Float64Array, components: Int32Array, k: Float64Array): void {
    const n = components.length;
    const rows = components.map((component) => this.place[component]);
    for (let a = 0; a < n; a++) {
      const row = rows[a];
      for (let b = 0; b < n && row >= 0; b++) {
        const column = rows[b];
        if (column >= 0 && column <= row)
          values[this.profile.place(row, column)] += (k[a * n + b] + k[b * n + a]) / 2;
      }
    }
  }

  /** The diagonal of an assembled matrix, (free components). */
  diagonal(values: Float64Array): Float64Array {
    return Float64Array.from(this.order, (_, row) => values[this.profile.place(row, row)]);
  }

  /** Factorise a matrix, which is overwritten; null if it has more negative eigenvalues. */
  factor(values: Float64Array, negative = 0): ProfileFactor | null {
    return ProfileFactor.of(this.profile, values, negative);
  }

  /** A⁻¹ b with a factor, for b and the result at all components; beyond a shorter b there is 0. */
  solve(factor: ProfileFactor, right: Float64Array): Float64Array {
    const found = factor.solve(Float64Array.from(this.order, (one) => right[one] ?? 0));
    const u = new Float64Array(right.length);
    this.order.forEach((one, row) => {
      if (one < u.length) u[one] = found[row];
    });
    return u;
  }
}
