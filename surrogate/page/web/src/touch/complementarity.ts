/**
 * Linear complementarity problems by block principal pivoting, as `surrogate/mechanics/touch/condition.py`:
 *
 *   w = A λ + q,  w ≥ 0,  λ ≥ 0,  λ·w = 0
 */

import { solve, times } from "../mechanics/vectors";

const BLOCKS = 5; // exchanges of many unknowns that may bring no progress
const MOST = 300; // exchanges at all

/**
 * Find λ; null if no solution is found.
 *
 * @param matrix - A, (n · n)
 * @param offset - q
 * @param begins - unknowns that are not 0 at first
 */
export function complementary(
  matrix: Float64Array,
  offset: Float64Array,
  begins: readonly boolean[],
): Float64Array | null {
  const n = offset.length;
  const inside = [...begins];
  const slack = 1e-12 * Math.max(...offset.map(Math.abs), Number.MIN_VALUE);
  let best = n + 1;
  let left = BLOCKS;
  for (let exchange = 0; exchange < MOST; exchange++) {
    const part = [...inside.keys()].filter((i) => inside[i]);
    const block = Float64Array.from(part.flatMap((i) => part.map((j) => matrix[i * n + j])));
    const right = Float64Array.from(part, (i) => -offset[i]);
    const values = solve(block, right);
    if (!values) return null;
    const found = new Float64Array(n);
    part.forEach((i, place) => (found[i] = values[place]));
    const apart = times(matrix, found).map((value, i) => value + offset[i]);
    let wrong = [...inside.keys()].filter((i) => (inside[i] ? found[i] < 0 : apart[i] < -slack));
    if (wrong.length === 0) return found;
    if (wrong.length < best) [best, left] = [wrong.length, BLOCKS];
    else if (left > 0) left--;
    else wrong = wrong.slice(-1);
    for (const i of wrong) inside[i] = !inside[i];
  }
  return null;
}
