/**
 * What forces on some loads do to the body, as far as predictions have told, as
 * `surrogate/mechanics/touch/loaded_body.py`:
 *
 *   δu = C δf,  C = K⁻¹ + Σ ± v vᵀ
 *
 * with updates that keep C symmetric and positive definite.
 */

import type { Loads, Part } from "../loads";
import { add, at, dot, norm, plus } from "../mechanics/vectors";

const UPDATES = 40; // changes that are kept
const RECENT = 8; // those that are kept when there are too many
const PARALLEL = 1e-6; // cosine below which nothing is learned

/** Displacements in m of all nodes under the unit components of a load; null while they are computed. */
export type Columns = (key: number) => Float64Array[] | null;

export class LinearBody {
  private vectors: { vector: Float64Array; sign: number }[] = [];
  private changes: [change: Float64Array, effect: Float64Array][] = [];

  constructor(
    private readonly parts: readonly Part[],
    private readonly loads: Loads,
    private readonly columns: Columns,
  ) {}

  /** Be the body at rest. */
  forget(): void {
    this.vectors = [];
    this.changes = [];
  }

  /** Displacements of components of the nodes by units of some of the loads, (dofs · units); null if unknown. */
  compliance(dofs: readonly number[], of: readonly number[]): Float64Array | null {
    const columns = of.map((place) => this.columns(this.parts[place].key));
    if (columns.includes(null)) return null;
    const units = columns.flat() as Float64Array[];
    const found = Float64Array.from(dofs.flatMap((dof) => units.map((column) => column[dof])));
    for (const { vector, sign } of this.vectors) {
      const right = of.flatMap((place) => this.loads.along(this.parts[place].key, vector));
      dofs.forEach((dof, row) => {
        const left = sign * vector[dof];
        for (let j = 0; j < right.length; j++) found[row * right.length + j] += left * right[j];
      });
    }
    return found;
  }

  /** Let a change of the forces, (loads · d) in N, have its effect in m, (nodes · d). */
  learn(change: Float64Array, effect: Float64Array): void {
    const work = this.work(effect, change);
    if (work <= PARALLEL * norm(effect) * norm(change)) return;
    const expected = this.moved(change, effect.length);
    if (!expected) return;
    this.changes.push([change, effect]);
    if (this.changes.length > UPDATES) {
      const recent = this.changes.slice(-RECENT);
      this.forget();
      for (const one of recent) this.learn(...one);
      return;
    }
    const lack = plus(effect, expected, -1);
    const slope = this.work(lack, change);
    if (slope > PARALLEL * norm(lack) * norm(change)) {
      this.add(lack, slope, 1);
    } else if (slope < 0) {
      this.add(effect, work, 1);
      this.add(expected, this.work(expected, change), -1);
    }
  }

  /** u · f */
  private work(u: Float64Array, force: Float64Array): number {
    return this.acting(force).reduce(
      (sum, [key, own]) => sum + dot(this.loads.along(key, u), own),
      0,
    );
  }

  /** C δf, of a size; null if columns are unknown. */
  private moved(change: Float64Array, size: number): Float64Array | null {
    const sum = new Float64Array(size);
    for (const [key, own] of this.acting(change)) {
      const columns = this.columns(key);
      if (!columns) return null;
      columns.forEach((column, i) => add(sum, column, own[i]));
    }
    for (const { vector, sign } of this.vectors) add(sum, vector, sign * this.work(vector, change));
    return sum;
  }

  /** Loads whose forces are not zero, with these. */
  private acting(force: Float64Array): [key: number, own: Float64Array][] {
    const d = force.length / this.parts.length;
    return this.parts
      .map(({ key }, place): [number, Float64Array] => [key, at(force, place, d)])
      .filter(([, own]) => own.some(Boolean));
  }

  private add(vector: Float64Array, square: number, sign: number): void {
    this.vectors.push({ vector: vector.map((value) => value / Math.sqrt(square)), sign });
  }
}
