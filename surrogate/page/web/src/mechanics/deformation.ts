/**
 * Deformations at some points of one material, and what its law makes of them, as
 * `surrogate/mechanics/solids/deformation.py`:
 *
 *   P = Σ_a ψ_a ∂m_a/∂F,  ∂P/∂F : H = Σ_ab ψ_ab (∂m_b/∂F : H) ∂m_a/∂F + Σ_a ψ_a ∂²m_a/∂F² : H
 *
 * with the measures m_a of F, and where the element has a dilation θ of its own, p cof F in P.
 */

import { DILATION, FIBRES, FIRST, run, SECOND, VOLUME, type Law, type Values } from "./tape";
import { addContraction, addCross, addDyad, addProduct, applied } from "./tensors";

export class Deformation {
  /** cof F, and J as it is. */
  readonly cofactor: Float64Array;
  readonly j: Float64Array;
  /** Whether J, and θ, are positive and finite. */
  readonly inside: Uint8Array;
  /** p in Pa, if the element has a dilation. */
  pressure: Values = null;
  private readonly measures: Float64Array[];
  private readonly known = new Map<number, Float64Array>();
  private readonly stretched: Float64Array[];
  private readonly areas: Float64Array[];
  private outputs: Values[] | null = null;

  /**
   * @param f - F, (d, d)
   * @param fibres - unit directions of the families of the law, (d) each
   */
  constructor(
    readonly law: Law,
    readonly d: number,
    readonly f: Float64Array,
    readonly fibres: readonly Float64Array[],
  ) {
    const n = f.length / (d * d);
    this.cofactor = new Float64Array(f.length);
    addCross(this.cofactor, f, f, d, d === 3 ? 0.5 : 1);
    this.j = new Float64Array(n);
    addContraction(this.j, f.subarray(0, d * n), this.cofactor.subarray(0, d * n));
    this.inside = new Uint8Array(n).fill(1);
    const volume = this.positive(this.j);
    const first = new Float64Array(n).fill(3 - d);
    addContraction(first, f, f);
    const second = d === 3 ? squares(this.cofactor, n) : first;
    this.stretched = fibres.map((a) => applied(f, a));
    this.areas = fibres.map((a) => applied(this.cofactor, a));
    const ofFibres = fibres.flatMap((_, i) => [
      squares(this.stretched[i], n),
      squares(this.areas[i], n),
    ]);
    this.measures = [first, second, volume, volume, ...ofFibres];
  }

  /** Set θ of the element. */
  dilate(dilation: Float64Array): void {
    this.measures[DILATION] = this.positive(dilation);
  }

  /** W in J/m³. */
  energy(): Float64Array {
    const w = this.whole[0];
    return this.j.map((_, p) => {
      const value = w ? w[p] : 0;
      return this.inside[p] && Number.isFinite(value) ? value : Infinity;
    });
  }

  /** ∂W/∂θ in Pa. */
  slope(): Float64Array {
    return run(this.law.stress, this.measures)[DILATION] ?? this.zeros();
  }

  /** P in Pa. */
  stress(): Float64Array {
    return this.sum(this.withPressure(run(this.law.stress, this.measures)));
  }

  /** ∂²W/∂F∂θ in Pa, at fixed measures. */
  mixed(): Float64Array {
    return this.sum(this.measures.map((_, a) => this.second(a, DILATION)));
  }

  /** ∂²W/∂θ² in Pa. */
  curvature(): Float64Array {
    return this.second(DILATION, DILATION) ?? this.zeros();
  }

  /** Change of ∂W/∂θ with F by H, and with θ. */
  slopeChange(h: Float64Array, dilation: Float64Array): Float64Array {
    return this.changes(h, dilation)[DILATION] ?? this.zeros();
  }

  /** δP of H and, where θ changes as well, of δθ, at fixed p. */
  change(h: Float64Array, dilation: Values): Float64Array {
    const total = this.sum(this.changes(h, dilation));
    const { d, f, cofactor, fibres } = this;
    const first = this.withPressure(this.whole.slice(1, 1 + this.law.count));
    const cross = this.crossed(f, h);
    first.forEach((factor, number) => {
      if (!factor || number === DILATION) return;
      if (number === FIRST) addProduct(total, factor, h, 2);
      else if (number === VOLUME) addProduct(total, factor, cross);
      else if (number === SECOND) {
        const part = this.crossed(cross, f);
        addCross(part, cofactor, h, d);
        addProduct(total, factor, part, 2);
      } else {
        const a = fibres[(number - FIBRES) >> 1];
        const isArea = (number - FIBRES) % 2 === 1;
        const part = new Float64Array(f.length);
        addDyad(part, applied(isArea ? cross : h, a), a, d);
        if (!isArea) {
          addProduct(total, factor, part, 2);
          return;
        }
        const turned = this.crossed(f, part);
        if (d === 3) addCross(turned, h, this.areaDyad((number - FIBRES) >> 1), d);
        addProduct(total, factor, turned, 2);
      }
    });
    return total;
  }

  /**
   * ∂P/∂F in Pa: (d · d, d · d), entry (kl, ij) the change of P_ij with F_kl.
   *
   * @param pointwise - whether θ is J of the same point, and p its ∂W/∂θ, else both are fixed
   */
  moduli(pointwise: boolean): Float64Array[] {
    const n = this.j.length;
    return Array.from({ length: this.d ** 2 }, (_, place) => {
      const unit = new Float64Array(this.f.length);
      unit.fill(1, place * n, (place + 1) * n);
      if (!pointwise) return this.change(unit, null);
      const dilation = this.cofactor.subarray(place * n, (place + 1) * n);
      const found = this.change(unit, dilation);
      addProduct(found, this.slopeChange(unit, dilation), this.cofactor);
      return found;
    });
  }

  /** Energy, first and second derivatives. */
  private get whole(): Values[] {
    this.outputs ??= run(this.law.energy, this.measures);
    return this.outputs;
  }

  private second(a: number, b: number): Values {
    const { count } = this.law;
    const [first, last] = [Math.min(a, b), Math.max(a, b)];
    return this.whole[1 + count + first * count - (first * (first - 1)) / 2 + last - first];
  }

  /** δψ_a of H and δθ. */
  private changes(h: Float64Array, dilation: Values): Values[] {
    const by = new Map<number, Values>([[DILATION, dilation]]);
    return this.measures.map((_, a) => {
      let total: Values = null;
      this.measures.forEach((_, b) => {
        const factor = this.second(a, b);
        if (!factor) return;
        if (!by.has(b)) {
          const change = this.zeros();
          addContraction(change, this.derivative(b), h);
          by.set(b, change);
        }
        const change = by.get(b) ?? null;
        if (change) addProduct((total ??= this.zeros()), factor, change);
      });
      return total;
    });
  }

  /** Σ x_a ∂m_a/∂F. */
  private sum(factors: readonly Values[]): Float64Array {
    const total = new Float64Array(this.f.length);
    factors.forEach((factor, number) => {
      if (factor && number !== DILATION) addProduct(total, factor, this.derivative(number));
    });
    return total;
  }

  private derivative(number: number): Float64Array {
    if (number === VOLUME) return this.cofactor;
    let found = this.known.get(number);
    if (!found) {
      found = new Float64Array(this.f.length);
      const family = (number - FIBRES) >> 1;
      if (number === FIRST) addProduct(found, 2, this.f);
      else if (number === SECOND) addCross(found, this.cofactor, this.f, this.d, 2);
      else if ((number - FIBRES) % 2) addCross(found, this.f, this.areaDyad(family), this.d, 2);
      else addDyad(found, this.stretched[family], this.fibres[family], this.d, 2);
      this.known.set(number, found);
    }
    return found;
  }

  /** cof F a ⊗ a */
  private areaDyad(family: number): Float64Array {
    const found = new Float64Array(this.f.length);
    addDyad(found, this.areas[family], this.fibres[family], this.d);
    return found;
  }

  private crossed(a: Float64Array, b: Float64Array): Float64Array {
    const found = new Float64Array(a.length);
    addCross(found, a, b, this.d);
    return found;
  }

  private withPressure(first: readonly Values[]): Values[] {
    const found = [...first];
    const { pressure } = this;
    const ofVolume = found[VOLUME];
    if (pressure) found[VOLUME] = pressure.map((p, i) => p + (ofVolume ? ofVolume[i] : 0));
    return found;
  }

  /** Numbers that are positive and finite, 1 in place of others. */
  private positive(values: Float64Array): Float64Array {
    return values.map((value, p) => {
      if (value > 0 && value < Infinity) return value;
      this.inside[p] = 0;
      return 1;
    });
  }

  private zeros(): Float64Array {
    return new Float64Array(this.j.length);
  }
}

function squares(a: Float64Array, n: number): Float64Array {
  const found = new Float64Array(n);
  addContraction(found, a, a);
  return found;
}
