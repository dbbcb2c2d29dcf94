/** Vectors, and small dense matrices in rows. */

import type { Rows } from "./body";

export function dot(a: ArrayLike<number>, b: ArrayLike<number>): number {
  let sum = 0;
  for (let i = 0; i < a.length; i++) sum += a[i] * b[i];
  return sum;
}

export function norm(a: ArrayLike<number>): number {
  return Math.sqrt(dot(a, a));
}

/** a + factor · b */
export function plus(a: Float64Array, b: ArrayLike<number>, factor = 1): Float64Array {
  return a.map((value, i) => value + factor * b[i]);
}

/** a += factor · b */
export function add(a: Float64Array, b: ArrayLike<number>, factor: number): void {
  for (let i = 0; i < a.length; i++) a[i] += factor * b[i];
}

/** Σ c_k a_k */
export function combined(c: ArrayLike<number>, vectors: readonly Float64Array[]): Float64Array {
  const sum = new Float64Array(vectors[0].length);
  for (let k = 0; k < vectors.length; k++) add(sum, vectors[k], c[k]);
  return sum;
}

/** The vector of a node in a field, (n · d) → (d,). */
export function at<T extends Float32Array | Float64Array>(field: T, node: number, d: number): T {
  return field.subarray(node * d, node * d + d) as T;
}

/** Weighted sums of the vectors of some nodes, for every row: (rows · d). */
export function gathered(
  { starts, nodes, weights }: Rows,
  field: Float64Array,
  d: number,
): Float64Array {
  const sums = new Float64Array((starts.length - 1) * d);
  for (let row = 0; row < starts.length - 1; row++) {
    for (let i = starts[row]; i < starts[row + 1]; i++)
      add(at(sums, row, d), at(field, nodes[i], d), weights[i]);
  }
  return sums;
}

/** The lengths of the vectors of a field, (n · d) → (n,). */
export function lengths(field: ArrayLike<number>, d: number): Float64Array {
  const squares = new Float64Array(field.length / d);
  for (let i = 0; i < field.length; i++) squares[Math.floor(i / d)] += field[i] ** 2;
  return squares.map(Math.sqrt);
}

export function largest(values: Float64Array | readonly number[]): number {
  let most = 0;
  for (const value of values) most = Math.max(most, Math.abs(value));
  return most;
}

/**
 * Solve A X = B by elimination with row exchanges.
 *
 * @param matrix - A, (n · n)
 * @param right - B, (n · columns)
 * @returns X, (n · columns); null if A is singular
 */
export function solve(matrix: Float64Array, right: Float64Array, columns = 1): Float64Array | null {
  const n = Math.sqrt(matrix.length);
  const width = n + columns;
  const rows = new Float64Array(n * width); // of A and B
  for (let i = 0; i < n; i++) {
    for (let j = 0; j < width; j++)
      rows[i * width + j] = j < n ? matrix[i * n + j] : right[i * columns + j - n];
  }
  for (let k = 0; k < n; k++) {
    let pivot = k;
    for (let i = k + 1; i < n; i++) {
      if (Math.abs(rows[i * width + k]) > Math.abs(rows[pivot * width + k])) pivot = i;
    }
    if (rows[pivot * width + k] === 0) return null;
    for (let j = k, one = k * width, other = pivot * width; j < width && pivot !== k; j++)
      [rows[one + j], rows[other + j]] = [rows[other + j], rows[one + j]];
    for (let i = 0; i < n; i++) {
      const factor = rows[i * width + k] / rows[k * width + k];
      if (i === k || factor === 0) continue;
      for (let j = k; j < width; j++) rows[i * width + j] -= factor * rows[k * width + j];
    }
  }
  const x = new Float64Array(n * columns);
  for (let i = 0; i < n; i++) {
    for (let j = 0; j < columns; j++)
      x[i * columns + j] = rows[i * width + n + j] / rows[i * width + i];
  }
  return x.every(Number.isFinite) ? x : null;
}

/** A B of matrices in rows, (m · n) and (n · columns). */
export function times(a: Float64Array, b: ArrayLike<number>, columns = 1): Float64Array {
  const n = b.length / columns;
  const found = new Float64Array((a.length / n) * columns);
  for (let place = 0, row = 0; place < a.length; row += columns) {
    for (let j = 0; j < n; j++, place++) {
      for (let c = 0; c < columns; c++) found[row + c] += a[place] * b[j * columns + c];
    }
  }
  return found;
}

/** The unit matrix, (n · n). */
export function unit(n: number): Float64Array {
  return Float64Array.from({ length: n * n }, (_, place) => Number(place % (n + 1) === 0));
}
