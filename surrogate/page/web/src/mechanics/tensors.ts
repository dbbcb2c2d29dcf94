/**
 * Tensors and vectors at many points: arrays of components, each of the same number n of points, so
 * that component c of point p is entry c n + p; those of tensors are numbered row by row.
 */

/** Add s x A of a scalar x, (n), or a number, and components A. */
export function addProduct(
  total: Float64Array,
  x: Float64Array | number | null,
  a: Float64Array,
  scale = 1,
): void {
  if (x === null || x === 0) return;
  if (typeof x === "number") {
    for (let i = 0; i < a.length; i++) total[i] += scale * x * a[i];
    return;
  }
  const n = x.length;
  for (let first = 0; first < a.length; first += n) {
    for (let p = 0; p < n; p++) total[first + p] += scale * x[p] * a[first + p];
  }
}

/** Add s Σ A B over the components, to a scalar. */
export function addContraction(
  total: Float64Array,
  a: Float64Array,
  b: Float64Array,
  scale = 1,
): void {
  const n = total.length;
  for (let first = 0; first < a.length; first += n) {
    for (let p = 0; p < n; p++) total[p] += scale * a[first + p] * b[first + p];
  }
}

/** Add s A × B of tensors, A × A = 2 cof A; in the plane s ((tr B) I − Bᵀ). */
export function addCross(
  total: Float64Array,
  a: Float64Array,
  b: Float64Array,
  d: number,
  scale = 1,
): void {
  if (d === 2) {
    addTraceMinus(total, b, d, scale);
    return;
  }
  const n = a.length / 9;
  for (let i = 0; i < 3; i++) {
    const [k, l] = [3 * ((i + 1) % 3), 3 * ((i + 2) % 3)];
    for (let j = 0; j < 3; j++) {
      const [r, s] = [(j + 1) % 3, (j + 2) % 3];
      const [kr, ks, lr, ls] = [(k + r) * n, (k + s) * n, (l + r) * n, (l + s) * n];
      const at = (3 * i + j) * n;
      for (let p = 0; p < n; p++) {
        total[at + p] +=
          scale *
          (a[kr + p] * b[ls + p] -
            a[ks + p] * b[lr + p] +
            b[kr + p] * a[ls + p] -
            b[ks + p] * a[lr + p]);
      }
    }
  }
}

/** Add s ((tr A) I − Aᵀ), that is s I × A. */
export function addTraceMinus(total: Float64Array, a: Float64Array, d: number, scale = 1): void {
  const n = a.length / (d * d);
  for (let i = 0; i < d; i++) {
    for (let j = 0; j < d; j++) {
      for (let p = 0; p < n; p++) {
        total[(i * d + j) * n + p] -= scale * a[(j * d + i) * n + p];
        total[i * (d + 1) * n + p] += scale * a[j * (d + 1) * n + p];
      }
    }
  }
}

/** Trace of tensors. */
export function trace(a: Float64Array, d: number): Float64Array {
  const n = a.length / (d * d);
  const found = new Float64Array(n);
  for (let i = 0; i < d; i++) {
    for (let p = 0; p < n; p++) found[p] += a[i * (d + 1) * n + p];
  }
  return found;
}

/** A v of tensors and vectors. */
export function applied(a: Float64Array, v: Float64Array): Float64Array {
  const d = a.length / v.length;
  const n = v.length / d;
  const found = new Float64Array(v.length);
  for (let i = 0; i < d; i++) {
    const row = found.subarray(i * n, (i + 1) * n);
    addContraction(row, a.subarray(i * d * n, (i + 1) * d * n), v);
  }
  return found;
}

/** Add s v ⊗ w of vectors. */
export function addDyad(
  total: Float64Array,
  v: Float64Array,
  w: Float64Array,
  d: number,
  scale = 1,
): void {
  const n = v.length / d;
  for (let i = 0; i < d; i++) {
    addProduct(
      total.subarray(i * d * n, (i + 1) * d * n),
      v.subarray(i * n, (i + 1) * n),
      w,
      scale,
    );
  }
}

/** Unit tensors at n points. */
export function identity(d: number, n: number): Float64Array {
  const found = new Float64Array(d * d * n);
  for (let i = 0; i < d; i++) found.fill(1, i * (d + 1) * n, (i * (d + 1) + 1) * n);
  return found;
}
