/**
 * Symmetric matrices in the profile of their rows, and their factorisation A = L S Lᵀ with signs S,
 * all +1 where A is positive definite.
 *
 * Rows are stored in groups of four, column by column, from that where the first of the four begins;
 * the factor fills nothing outside this profile. Products of four rows by four rows keep 16 sums in
 * registers.
 */

const GROUP = 4;

/** The factor L, the signs of its pivots, and the number of negative eigenvalues. */
export interface Factor {
  values: Float64Array;
  signs: Float64Array;
  negative: number;
}

export class Profile {
  /** Row of every component; -1 where it is held. */
  readonly place: Int32Array;
  private readonly groups: number;
  /** First column of every group. */
  private readonly starts: Int32Array;
  /** Place where column 0 of every group would stand; the last one is the number of entries. */
  private readonly bases: Int32Array;

  /**
   * @param numbers - components of every cell, (cells, width)
   * @param width - of the matrix of a cell
   * @param order - free components in the order of the profile
   * @param size - number of all components
   */
  constructor(
    numbers: Int32Array,
    width: number,
    readonly order: Int32Array,
    readonly size: number,
  ) {
    this.place = new Int32Array(size).fill(-1);
    order.forEach((component, row) => (this.place[component] = row));
    this.groups = Math.ceil(order.length / GROUP);
    this.starts = new Int32Array(this.groups).map((_, group) => group * GROUP);
    for (let start = 0; start < numbers.length; start += width) {
      const rows = numbers.subarray(start, start + width).map((i) => this.place[i]);
      const first = rows.reduce((least, row) => (row < 0 ? least : Math.min(least, row)), Infinity);
      for (const row of rows) {
        if (row >= 0 && first < this.starts[row >> 2]) this.starts[row >> 2] = first & -GROUP;
      }
    }
    this.bases = new Int32Array(this.groups + 1);
    let end = 0;
    for (let group = 0; group < this.groups; group++) {
      this.bases[group] = end - GROUP * this.starts[group];
      end += GROUP * ((group + 1) * GROUP - this.starts[group]);
    }
    this.bases[this.groups] = end;
  }

  /** A matrix of zeros, with ones on the diagonal beyond its size. */
  zeros(): Float64Array {
    const values = new Float64Array(this.bases[this.groups]);
    for (let row = this.order.length; row < this.groups * GROUP; row++)
      values[this.at(row, row)] = 1;
    return values;
  }

  /** Add the symmetric part of the matrix of some components. */
  add(values: Float64Array, components: Int32Array, k: Float64Array): void {
    const n = components.length;
    for (let a = 0; a < n; a++) {
      const row = this.place[components[a]];
      for (let b = 0; b < n && row >= 0; b++) {
        const column = this.place[components[b]];
        if (column >= 0 && column <= row)
          values[this.at(row, column)] += (k[a * n + b] + k[b * n + a]) / 2;
      }
    }
  }

  /**
   * Factorise a matrix, which is overwritten.
   *
   * @param most - negative eigenvalues; null if there are more, or one that is 0 or no number
   */
  factor(values: Float64Array, most = 0): Factor | null {
    const { groups, starts, bases } = this;
    const signs = new Float64Array(groups * GROUP).fill(1);
    const scaled = new Float64Array(groups * GROUP * GROUP); // L S of the rows of a group
    const sums = new Float64Array(GROUP * GROUP);
    let negative = 0;
    for (let group = 0; group < groups; group++) {
      const base = bases[group];
      for (let other = starts[group] >> 2; other <= group; other++) {
        const above = bases[other];
        const [first, end] = [Math.max(starts[group], starts[other]), other * GROUP];
        products(scaled, GROUP * first, values, above + GROUP * first, end - first, sums);
        for (let c = 0; c < GROUP; c++) {
          const column = end + c;
          for (let r = other < group ? 0 : c; r < GROUP; r++) {
            const at = base + GROUP * column + r;
            let sum = values[at] - sums[GROUP * r + c];
            for (let t = end; t < column; t++)
              sum -= scaled[GROUP * t + r] * values[above + GROUP * t + c];
            if (other < group || r > c) {
              sum /= values[above + GROUP * column + c];
              scaled[GROUP * column + r] = sum;
              values[at] = sum * signs[column];
            } else {
              if (sum < 0) [signs[column], negative] = [-1, negative + 1];
              if (sum === 0 || !Number.isFinite(sum) || negative > most) return null;
              values[at] = Math.sqrt(Math.abs(sum));
            }
          }
        }
      }
    }
    return { values, signs, negative };
  }

  /** A⁻¹ b with a factor, for b and the result at all components; beyond a shorter b there is 0. */
  solve({ values, signs }: Factor, right: Float64Array): Float64Array {
    const { order, starts, bases } = this;
    const x = new Float64Array(signs.length);
    order.forEach((component, row) => (x[row] = right[component] ?? 0));
    for (let row = 0; row < x.length; row++) {
      const [group, first] = [row >> 2, bases[row >> 2] + (row & 3)];
      let sum = x[row];
      for (let k = starts[group], at = first + GROUP * k; k < row; k++, at += GROUP)
        sum -= values[at] * x[k];
      x[row] = sum / values[first + GROUP * row];
    }
    for (let row = 0; row < x.length; row++) x[row] *= signs[row];
    for (let row = x.length - 1; row >= 0; row--) {
      const [group, first] = [row >> 2, bases[row >> 2] + (row & 3)];
      const value = (x[row] /= values[first + GROUP * row]);
      for (let k = starts[group], at = first + GROUP * k; k < row; k++, at += GROUP)
        x[k] -= values[at] * value;
    }
    const found = new Float64Array(right.length);
    order.forEach((component, row) => {
      if (component < right.length) found[component] = x[row];
    });
    return found;
  }

  /** Place of entry (row, column) with column ≤ row. */
  private at(row: number, column: number): number {
    return this.bases[row >> 2] + GROUP * column + (row & 3);
  }
}

/** Sums Σ_k a_rk b_ck of four rows by four rows over some columns, which begin at p and q. */
function products(
  a: Float64Array,
  p: number,
  b: Float64Array,
  q: number,
  columns: number,
  sums: Float64Array,
): void {
  // prettier-ignore
  let s00 = 0, s01 = 0, s02 = 0, s03 = 0, s10 = 0, s11 = 0, s12 = 0, s13 = 0;
  // prettier-ignore
  let s20 = 0, s21 = 0, s22 = 0, s23 = 0, s30 = 0, s31 = 0, s32 = 0, s33 = 0;
  // prettier-ignore
  for (const end = p + GROUP * columns; p < end; p += GROUP, q += GROUP) {
    const a0 = a[p], a1 = a[p + 1], a2 = a[p + 2], a3 = a[p + 3];
    const b0 = b[q], b1 = b[q + 1], b2 = b[q + 2], b3 = b[q + 3];
    s00 += a0 * b0; s01 += a0 * b1; s02 += a0 * b2; s03 += a0 * b3;
    s10 += a1 * b0; s11 += a1 * b1; s12 += a1 * b2; s13 += a1 * b3;
    s20 += a2 * b0; s21 += a2 * b1; s22 += a2 * b2; s23 += a2 * b3;
    s30 += a3 * b0; s31 += a3 * b1; s32 += a3 * b2; s33 += a3 * b3;
  }
  // prettier-ignore
  const found = [s00, s01, s02, s03, s10, s11, s12, s13, s20, s21, s22, s23, s30, s31, s32, s33];
  for (let i = 0; i < GROUP * GROUP; i++) sums[i] = found[i];
}
