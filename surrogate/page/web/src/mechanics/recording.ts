/**
 * What Python computes at a point, as a list of scalar operations, run at many points with truncated
 * power series, by the table of `surrogate/mechanics/energy/recording.py`: order 0 is the value, order 1 beside it a derivative.
 */

export interface Recording {
  /** Number of the inputs, the first slots. */
  inputs: number;
  /** Operation, slots that it takes, and constant of every result, the following slots. */
  codes: number[];
  left: number[];
  right: number[];
  constants: number[];
  /** Number of results up to the end of every stage: with F, with θ, with p; of the energy. */
  ends: number[];
  outputs: number[];
}

/** The law of a material: derivatives of W + p (J − θ) by its inputs, and slots of single numbers. */
export interface Law extends Recording {
  volume: number;
  energy: number;
  /** ∂W/∂θ, of elements that have a dilation of their own. */
  slope?: number;
}

const [SUM, SCALE, SHIFT, PRODUCT, POWER, EXP, LN, , STEP] = [0, 1, 2, 3, 4, 5, 6, 7, 8];
const ZERO = 1e-12; // numbers above −ZERO count as no less than 0, as in the energy itself

/** Coefficients of one order, n of every slot, one after the other; whether any is not zero. */
interface Order {
  values: Float64Array;
  known: Uint8Array;
}

export class Series {
  private readonly orders: Order[] = [];

  constructor(
    readonly recording: Recording,
    readonly n: number,
  ) {}

  /** Coefficients of some slots, to read; or to write, where they count as not zero, or as zero. */
  at(k: number, slot: number, known?: boolean, count = 1): Float64Array {
    const size = this.recording.inputs + this.recording.codes.length;
    this.orders[k] ??= {
      values: new Float64Array(size * this.n),
      known: new Uint8Array(size),
    };
    const { values, known: flags } = this.orders[k];
    const found = values.subarray(slot * this.n, (slot + count) * this.n);
    if (known !== undefined) flags.fill(Number(known), slot, slot + count);
    else if (!flags[slot]) found.fill(0);
    return found;
  }

  /** Results of a stage, of order k. */
  run(k: number, stage: number): void {
    const { inputs, codes, left, right, constants, ends } = this.recording;
    const { known } = this.orders[k];
    for (let row = stage === 0 ? 0 : ends[stage - 1]; row < ends[stage]; row++) {
      const y = inputs + row;
      const [code, a, b, c] = [codes[row], left[row], right[row], constants[row]];
      known[y] = 0;
      if (code === SUM) this.sum(k, y, a, b);
      else if (code === SCALE) this.add(k, y, c, a);
      else if (code === PRODUCT && k === 1 && known[a] && known[b]) this.change(y, a, b);
      else if (code === PRODUCT) for (let i = 0; i <= k; i++) this.multiply(k, y, 1, i, a, b);
      else if (k === 0) this.evaluate(code, y, a, c);
      else if (code === SHIFT) this.add(k, y, 1, a);
      else if (code === POWER) {
        for (let i = 1; i <= k; i++) this.multiply(k, y, (c * i - k + i) / k, i, a, y);
        this.divide(k, y, a);
      } else if (code === EXP) {
        for (let i = 1; i <= k; i++) this.multiply(k, y, i / k, i, a, y);
      } else if (code === LN) {
        this.add(k, y, 1, a);
        for (let i = 1; i < k; i++) this.multiply(k, y, -i / k, i, y, a);
        this.divide(k, y, a);
      }
    }
  }

  /** y₀ of a function of a₀. */
  private evaluate(code: number, y: number, a: number, c: number): void {
    const { n } = this;
    const { values, known } = this.orders[0];
    known[y] = 1;
    const [to, from] = [y * n, a * n];
    if (code === SHIFT) for (let p = 0; p < n; p++) values[to + p] = values[from + p] + c;
    else if (code === POWER && c === -1)
      for (let p = 0; p < n; p++) values[to + p] = 1 / values[from + p];
    else if (code === POWER) for (let p = 0; p < n; p++) values[to + p] = values[from + p] ** c;
    else if (code === EXP) for (let p = 0; p < n; p++) values[to + p] = Math.exp(values[from + p]);
    else if (code === LN) for (let p = 0; p < n; p++) values[to + p] = Math.log(values[from + p]);
    else if (code === STEP)
      for (let p = 0; p < n; p++) values[to + p] = values[from + p] > -ZERO ? 1 : 0;
  }

  private sum(k: number, y: number, a: number, b: number): void {
    const { n } = this;
    const { values, known } = this.orders[k];
    if (!known[a] || !known[b]) {
      this.add(k, y, 1, known[a] ? a : b);
      return;
    }
    known[y] = 1;
    const [to, one, other] = [y * n, a * n, b * n];
    for (let p = 0; p < n; p++) values[to + p] = values[one + p] + values[other + p];
  }

  /** Add c aₖ to yₖ. */
  private add(k: number, y: number, c: number, a: number): void {
    const { n } = this;
    const { values, known } = this.orders[k];
    if (!known[a]) return;
    const [to, from] = [y * n, a * n];
    if (known[y]) for (let p = 0; p < n; p++) values[to + p] += c * values[from + p];
    else for (let p = 0; p < n; p++) values[to + p] = c * values[from + p];
    known[y] = 1;
  }

  /** Add c aᵢ bₖ₋ᵢ to yₖ. */
  private multiply(k: number, y: number, c: number, i: number, a: number, b: number): void {
    const { n } = this;
    const { values, known } = this.orders[k];
    const [one, other] = [this.orders[i], this.orders[k - i]];
    if (!one.known[a] || !other.known[b]) return;
    const [to, from, by, u, v] = [y * n, a * n, b * n, one.values, other.values];
    if (known[y]) for (let p = 0; p < n; p++) values[to + p] += c * u[from + p] * v[by + p];
    else for (let p = 0; p < n; p++) values[to + p] = c * u[from + p] * v[by + p];
    known[y] = 1;
  }

  /** y₁ = a₀ b₁ + a₁ b₀ */
  private change(y: number, a: number, b: number): void {
    const { n } = this;
    const { values, known } = this.orders[1];
    const base = this.orders[0].values;
    const [to, one, other] = [y * n, a * n, b * n];
    for (let p = 0; p < n; p++)
      values[to + p] = base[one + p] * values[other + p] + values[one + p] * base[other + p];
    known[y] = 1;
  }

  /** Divide yₖ by a₀. */
  private divide(k: number, y: number, a: number): void {
    const { n } = this;
    const { values } = this.orders[k];
    const by = this.orders[0].values;
    const [to, from] = [y * n, a * n];
    for (let p = 0; p < n; p++) values[to + p] /= by[from + p];
  }
}
