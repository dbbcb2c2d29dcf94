/**
 * Symmetric matrices in the profile of their rows, and their factorisation A = L S Lᵀ with signs S,
 * all +1 where A is positive definite.
 *
 * Rows are stored in groups of four, each from the column where the first of the four begins; the
 * factor fills nothing outside this profile. Products of four rows by four rows keep 16 sums in
 * registers.
 */

const GROUP = 4;

/** Places of the entries of a symmetric matrix. */
export class Profile {
  readonly groups: number;
  /** First column of every group. */
  readonly starts: Int32Array;
  /** Place of every group's first entry. */
  readonly offsets: Int32Array;

  /** @param firsts - column of the first entry of every row */
  constructor(
    readonly size: number,
    firsts: Int32Array,
  ) {
    this.groups = Math.ceil(size / GROUP);
    this.starts = new Int32Array(this.groups);
    this.offsets = new Int32Array(this.groups + 1);
    for (let group = 0; group < this.groups; group++) {
      let first = group * GROUP;
      const end = Math.min(size, first + GROUP);
      for (let row = group * GROUP; row < end; row++) first = Math.min(first, firsts[row]);
      this.starts[group] = first - (first % GROUP);
      this.offsets[group + 1] = this.offsets[group] + GROUP * this.width(group);
    }
  }

  /** Number of columns of a group. */
  width(group: number): number {
    return (group + 1) * GROUP - this.starts[group];
  }

  /** Place of entry (row, column) with column ≤ row. */
  place(row: number, column: number): number {
    const group = row >> 2;
    return this.offsets[group] + (row & 3) * this.width(group) + column - this.starts[group];
  }

  /** A matrix of zeros, with ones on the diagonal beyond its size. */
  zeros(): Float64Array {
    const values = new Float64Array(this.offsets[this.groups]);
    for (let row = this.size; row < this.groups * GROUP; row++) values[this.place(row, row)] = 1;
    return values;
  }
}

/** The factor L of a symmetric matrix, and the signs S of its pivots. */
export class ProfileFactor {
  private constructor(
    private readonly profile: Profile,
    private readonly values: Float64Array,
    private readonly signs: Float64Array,
    /** Number of negative pivots, which is that of the negative eigenvalues. */
    readonly negative: number,
  ) {}

  /**
   * Factorise a matrix, which is overwritten.
   *
   * @param most - negative pivots; null if there are more, or one that is 0 or no number
   */
  static of(profile: Profile, values: Float64Array, most = 0): ProfileFactor | null {
    const sums = new Float64Array(GROUP * GROUP);
    const signs = new Float64Array(profile.groups * GROUP).fill(1);
    let negative = 0;
    for (let group = 0; group < profile.groups; group++) {
      for (let other = profile.starts[group] >> 2; other <= group; other++) {
        subtractProducts(profile, values, signs, group, other, sums);
        if (other < group) solveTile(profile, values, signs, group, other, sums);
      }
      negative += factoriseTile(profile, values, signs, group, sums);
      if (!(negative <= most)) return null;
    }
    return new ProfileFactor(profile, values, signs, negative);
  }

  /** A⁻¹ b, (n,) → (n,). */
  solve(right: Float64Array): Float64Array {
    const { profile, values, signs } = this;
    const { groups, starts } = profile;
    const x = new Float64Array(groups * GROUP);
    x.set(right);
    for (let row = 0; row < x.length; row++) {
      const first = starts[row >> 2];
      const place = profile.place(row, first);
      let sum = x[row];
      for (let k = 0; k < row - first; k++) sum -= values[place + k] * x[first + k];
      x[row] = sum / values[place + row - first];
    }
    for (let row = x.length - 1; row >= 0; row--) x[row] *= signs[row];
    for (let row = x.length - 1; row >= 0; row--) {
      const first = starts[row >> 2];
      const place = profile.place(row, first);
      const value = x[row] / values[place + row - first];
      x[row] = value;
      for (let k = 0; k < row - first; k++) x[first + k] -= values[place + k] * value;
    }
    return x.slice(0, profile.size);
  }
}

/** Sums a_rc − Σ_k l_rk s_k l_ck of the tile of two groups of rows, over all columns left of it. */
function subtractProducts(
  profile: Profile,
  values: Float64Array,
  signs: Float64Array,
  group: number,
  other: number,
  sums: Float64Array,
): void {
  const first = Math.max(profile.starts[group], profile.starts[other]);
  const end = other * GROUP;
  const width = profile.width(group);
  const step = profile.width(other);
  let p = profile.offsets[group] + first - profile.starts[group];
  let q = profile.offsets[other] + first - profile.starts[other];
  const tile = profile.offsets[group] + end - profile.starts[group];
  // prettier-ignore
  let s00 = 0, s01 = 0, s02 = 0, s03 = 0, s10 = 0, s11 = 0, s12 = 0, s13 = 0;
  // prettier-ignore
  let s20 = 0, s21 = 0, s22 = 0, s23 = 0, s30 = 0, s31 = 0, s32 = 0, s33 = 0;
  // prettier-ignore
  for (let k = first; k < end; k++, p++, q++) {
    const s = signs[k];
    const a0 = values[p], a1 = values[p + width];
    const a2 = values[p + 2 * width], a3 = values[p + 3 * width];
    const b0 = s * values[q], b1 = s * values[q + step];
    const b2 = s * values[q + 2 * step], b3 = s * values[q + 3 * step];
    s00 += a0 * b0; s01 += a0 * b1; s02 += a0 * b2; s03 += a0 * b3;
    s10 += a1 * b0; s11 += a1 * b1; s12 += a1 * b2; s13 += a1 * b3;
    s20 += a2 * b0; s21 += a2 * b1; s22 += a2 * b2; s23 += a2 * b3;
    s30 += a3 * b0; s31 += a3 * b1; s32 += a3 * b2; s33 += a3 * b3;
  }
  sums.set([s00, s01, s02, s03, s10, s11, s12, s13, s20, s21, s22, s23, s30, s31, s32, s33]);
  for (let r = 0; r < GROUP; r++) {
    for (let c = 0; c < GROUP; c++) {
      sums[r * GROUP + c] = values[tile + r * width + c] - sums[r * GROUP + c];
    }
  }
}

/** Solve for the tile of L right of the diagonal tile of `other`: X S L_otherᵀ = sums. */
function solveTile(
  profile: Profile,
  values: Float64Array,
  signs: Float64Array,
  group: number,
  other: number,
  sums: Float64Array,
): void {
  const width = profile.width(group);
  const tile = profile.offsets[group] + other * GROUP - profile.starts[group];
  const diagonal = profile.place(other * GROUP, other * GROUP);
  const step = profile.width(other);
  for (let r = 0; r < GROUP; r++) {
    for (let c = 0; c < GROUP; c++) {
      let sum = sums[r * GROUP + c];
      for (let t = 0; t < c; t++)
        sum -=
          signs[other * GROUP + t] * values[tile + r * width + t] * values[diagonal + c * step + t];
      values[tile + r * width + c] =
        (signs[other * GROUP + c] * sum) / values[diagonal + c * step + c];
    }
  }
}

/** Factorise a diagonal tile; the number of negative pivots, NaN if one is 0 or no number. */
function factoriseTile(
  profile: Profile,
  values: Float64Array,
  signs: Float64Array,
  group: number,
  sums: Float64Array,
): number {
  const width = profile.width(group);
  const tile = profile.place(group * GROUP, group * GROUP);
  let negative = 0;
  for (let r = 0; r < GROUP; r++) {
    for (let c = 0; c <= r; c++) {
      let sum = sums[r * GROUP + c];
      for (let t = 0; t < c; t++)
        sum -=
          signs[group * GROUP + t] * values[tile + r * width + t] * values[tile + c * width + t];
      const sign = signs[group * GROUP + c];
      if (c < r) values[tile + r * width + c] = (sign * sum) / values[tile + c * width + c];
      else if (sum === 0 || !Number.isFinite(sum)) return NaN;
      else {
        if (sum < 0) [signs[group * GROUP + r], negative] = [-1, negative + 1];
        values[tile + r * width + r] = Math.sqrt(Math.abs(sum));
      }
    }
  }
  return negative;
}
