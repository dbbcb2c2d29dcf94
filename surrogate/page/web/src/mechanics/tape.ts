/**
 * Laws of materials: energies and their derivatives as lists of scalar operations, *tapes*, which
 * Python has made (`surrogate/mechanics/energy`). They run on many points at once.
 */

import { addProduct } from "./tensors";

export interface Tape {
  /** Operation, slots that it takes, and constant of every result; slots begin with the inputs. */
  codes: number[];
  left: number[];
  right: number[];
  constants: number[];
  /** Slot of every output, −1 if it is the same number whatever the inputs are; these numbers. */
  outputs: number[];
  fixed: number[];
}

/** The law of a material: tapes of the measures I₁, I₂, J, θ, and I₄, K₄ of every family of fibres. */
export interface Law {
  count: number;
  /** Lamé parameters at rest in Pa. */
  lambda: number;
  mu: number;
  /** Derivatives by the measures; energy, first and second derivatives. */
  stress: Tape;
  energy: Tape;
  /** Slots of the stress tape of the undeformed body, and their derivatives by the measures. */
  rest: number[];
  slopes: number[][];
  /** Measures that a derivative depends on, or is one by. */
  used: number[];
}

/** Numbers at some points; null where all are zero. */
export type Values = Float64Array | null;

export const [FIRST, SECOND, VOLUME, DILATION, FIBRES] = [0, 1, 2, 3, 4];
const [SUM, SCALE, SHIFT, PRODUCT, POWER, EXP, LN, POSITIVE] = [0, 1, 2, 3, 4, 5, 6, 7];
const ZERO = 1e-12; // numbers above −ZERO count as no less than 0, as in the energy itself

/** Outputs of a tape. */
export function run(tape: Tape, inputs: readonly Float64Array[]): Values[] {
  const slots = [...inputs];
  const n = inputs[0].length;
  tape.codes.forEach((code, row) => {
    const a = slots[tape.left[row]];
    const b = slots[tape.right[row]];
    const c = tape.constants[row];
    const y = new Float64Array(n);
    if (code === SUM) for (let p = 0; p < n; p++) y[p] = a[p] + b[p];
    else if (code === SCALE) for (let p = 0; p < n; p++) y[p] = c * a[p];
    else if (code === SHIFT) for (let p = 0; p < n; p++) y[p] = a[p] + c;
    else if (code === PRODUCT) for (let p = 0; p < n; p++) y[p] = a[p] * b[p];
    else if (code === POWER && c === -1) for (let p = 0; p < n; p++) y[p] = 1 / a[p];
    else if (code === POWER) for (let p = 0; p < n; p++) y[p] = a[p] ** c;
    else if (code === EXP) for (let p = 0; p < n; p++) y[p] = Math.exp(a[p]);
    else if (code === LN) for (let p = 0; p < n; p++) y[p] = Math.log(a[p]);
    else if (code === POSITIVE) for (let p = 0; p < n; p++) y[p] = a[p] > -ZERO ? a[p] : 0;
    else for (let p = 0; p < n; p++) y[p] = a[p] > -ZERO ? 1 : 0;
    slots.push(y);
  });
  return tape.outputs.map((slot, output) => {
    const number = tape.fixed[output];
    if (slot >= 0) return slots[slot];
    return number === 0 ? null : new Float64Array(n).fill(number);
  });
}

/**
 * Add the coefficients of the next order of the power series of all results to the slots, which hold
 * those of the inputs.
 *
 * @param slots - of every order from 1 on
 */
export function runSeries({ stress, rest }: Law, slots: readonly Values[][]): void {
  const k = slots.length;
  const last = slots[k - 1];
  stress.codes.forEach((code, row) => {
    const left = stress.left[row];
    const right = stress.right[row];
    const c = stress.constants[row];
    const place = last.length;
    const a = last[left];
    const [first, value] = [rest[left], rest[place]];
    if (code === SHIFT) last.push(a);
    else if (code === POSITIVE) last.push(first > -ZERO ? a : null);
    else if (code > POSITIVE) last.push(null);
    else if (code === SUM) last.push(sum([1, a], [1, last[right]]));
    else if (code === SCALE) last.push(sum([c, a]));
    else {
      // Σ of products of coefficients of two slots, and what is linear in those of this order
      const linear: [number, Values][] =
        code === PRODUCT
          ? [
              [rest[right], a],
              [first, last[right]],
            ]
          : [[code === POWER ? (c * value) / first : code === EXP ? value : 1 / first, a]];
      const other = code === PRODUCT ? right : place;
      const factor = (j: number): number => {
        if (code === PRODUCT) return 1;
        if (code === POWER) return (c * j - k + j) / (k * first);
        return code === EXP ? j / k : (j - k) / (k * first);
      };
      let total = sum(...linear);
      for (let j = 1; j < k; j++) {
        const [x, y] = [slots[j - 1][left], slots[k - j - 1][other]];
        if (!x || !y) continue;
        total ??= new Float64Array(x.length);
        addProduct(total, x, y, factor(j));
      }
      last.push(total);
    }
  });
}

/** Coefficients of an output of the stress tape, from order 0, a number, on. */
export function outputSeries(
  { stress, rest }: Law,
  output: number,
  slots: readonly Values[][],
): [number, ...Values[]] {
  const slot = stress.outputs[output];
  if (slot < 0) return [stress.fixed[output], ...slots.map(() => null)];
  return [rest[slot], ...slots.map((each) => each[slot])];
}

/** Σ c x, a new array; null where all parts are. */
export function sum(...parts: [number, Values][]): Values {
  let total: Values = null;
  for (const [factor, x] of parts) {
    if (!x || factor === 0) continue;
    total ??= new Float64Array(x.length);
    for (let p = 0; p < x.length; p++) total[p] += factor * x[p];
  }
  return total;
}
