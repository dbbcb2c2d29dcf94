/** Small dense systems of equations, in rows. */

/**
 * Solve A X = B by elimination with row exchanges.
 *
 * @param matrix - A, (n · n)
 * @param right - B, (n · columns)
 * @returns X, (n · columns); null if A is singular
 */
export function solve(
  matrix: Float64Array,
  right: Float64Array,
  columns: number,
): Float64Array | null {
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
  const columns = x.length;
  return Float64Array.from({ length: matrix.length / columns }, (_, row) => {
    let sum = 0;
    for (let j = 0; j < columns; j++) sum += matrix[row * columns + j] * x[j];
    return sum;
  });
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
