/**
 * Linear complementarity problems by block principal pivoting, as `surrogate/mechanics/touch/condition.py`:
 *
 *   w = A λ + q,  w ≥ 0,  λ ≥ 0,  λ·w = 0
 *
 * and with upper limits, where w ≤ 0 beside λ = most.
 */

import { plus, solve, times } from "../mechanics/vectors";

const BLOCKS = 5; // exchanges of many unknowns that may bring no progress
const MOST = 300; // exchanges at all

/**
 * Find λ; null if no solution is found.
 *
 * @param matrix - A, (n · n)
 * @param offset - q
 * @param begins - unknowns that are at no limit at first
 * @param most - upper limits
 */
export function complementary(
  matrix: Float64Array,
  offset: Float64Array,
  begins: readonly boolean[],
  most?: Float64Array,
): Float64Array | null {
  const n = offset.length;
  const high = most ?? new Float64Array(n).fill(Infinity);
  /** Limits that unknowns are at; null inside. */
  const limits: (number | null)[] = begins.map((begin) => (begin ? null : 0));
  const slack = 1e-12 * Math.max(...offset.map(Math.abs), Number.MIN_VALUE);
  let best = n + 1;
  let left = BLOCKS;
  for (let exchange = 0; exchange < MOST; exchange++) {
    const found = Float64Array.from(limits, (limit) => limit ?? 0);
    const part = [...limits.keys()].filter((i) => limits[i] === null);
    const block = Float64Array.from(part.flatMap((i) => part.map((j) => matrix[i * n + j])));
    const beside = plus(times(matrix, found), offset);
    const values = solve(
      block,
      Float64Array.from(part, (i) => -beside[i]),
    );
    if (!values) return null;
    part.forEach((i, place) => (found[i] = values[place]));
    const apart = plus(times(matrix, found), offset);
    /** The limit that an unknown belongs at, or null. */
    const belongs = limits.map((limit, i) => {
      if (limit === null) return found[i] < 0 ? 0 : found[i] > high[i] ? high[i] : null;
      const isHeld = limit === 0 ? apart[i] >= -slack : apart[i] <= slack;
      return isHeld ? limit : null;
    });
    let wrong = [...limits.keys()].filter((i) => limits[i] !== belongs[i]);
    if (wrong.length === 0) return found;
    if (wrong.length < best) [best, left] = [wrong.length, BLOCKS];
    else if (left > 0) left--;
    else wrong = wrong.slice(-1);
    for (const i of wrong) limits[i] = belongs[i];
  }
  return null;
}
