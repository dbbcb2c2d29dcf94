/** Vectors, and small dense matrices in rows. */

export function dot(a: ArrayLike<number>, b: ArrayLike<number>): number {
  let sum = 0;
  for (let i = 0; i < a.length; i++) sum += a[i] * b[i];
  return sum;
}

export function norm(a: ArrayLike<number>): number {
  return Math.sqrt(dot(a, a));
}

/** a + factor · b */
export function plus(a: Float64Array, b: Float64Array, factor = 1): Float64Array {
  return a.map((value, i) => value + factor * b[i]);
}

/** a += factor · b */
export function add(a: Float64Array, b: Float64Array, factor: number): void {
  for (let i = 0; i < a.length; i++) a[i] += factor * b[i];
}

/** The lengths of the vectors of a field, (n · d) → (n,). */
export function lengths(field: ArrayLike<number>, d: number): Float64Array {
  return Float64Array.from({ length: field.length / d }, (_, node) => {
    let sum = 0;
    for (let i = 0; i < d; i++) sum += field[node * d + i] ** 2;
    return Math.sqrt(sum);
  });
}

export function largest(values: Float64Array): number {
  return values.reduce((most, value) => Math.max(most, Math.abs(value)), 0);
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
  const a = matrix.slice();
  const x = right.slice();
  for (let k = 0; k < n; k++) {
    let pivot = k;
    for (let i = k + 1; i < n; i++) {
      if (Math.abs(a[i * n + k]) > Math.abs(a[pivot * n + k])) pivot = i;
    }
    if (a[pivot * n + k] === 0) return null;
    exchange(a, n, k, pivot);
    exchange(x, columns, k, pivot);
    for (let i = k + 1; i < n; i++) {
      const factor = a[i * n + k] / a[k * n + k];
      if (factor === 0) continue;
      for (let j = k; j < n; j++) a[i * n + j] -= factor * a[k * n + j];
      for (let j = 0; j < columns; j++) x[i * columns + j] -= factor * x[k * columns + j];
    }
  }
  for (let k = n - 1; k >= 0; k--) {
    for (let j = 0; j < columns; j++) {
      let sum = x[k * columns + j];
      for (let i = k + 1; i < n; i++) sum -= a[k * n + i] * x[i * columns + j];
      x[k * columns + j] = sum / a[k * n + k];
    }
  }
  return x.every(Number.isFinite) ? x : null;
}

/** A x, of a matrix in rows. */
export function times(matrix: Float64Array, x: ArrayLike<number>): Float64Array {
  const n = x.length;
  return Float64Array.from({ length: matrix.length / n }, (_, row) =>
    dot(matrix.subarray(row * n, (row + 1) * n), x),
  );
}

/** The unit matrix, (n · n). */
export function unit(n: number): Float64Array {
  return Float64Array.from({ length: n * n }, (_, place) => Number(place % (n + 1) === 0));
}

function exchange(rows: Float64Array, length: number, i: number, j: number): void {
  if (i === j) return;
  const row = rows.slice(i * length, (i + 1) * length);
  rows.copyWithin(i * length, j * length, (j + 1) * length);
  rows.set(row, j * length);
}
