/**
 * What forces do to the body, as far as predictions have told, as `surrogate/mechanics/touch/linear_body.py`:
 *
 *   δu = C δf,  C = K⁻¹ + Σ ± v vᵀ
 *
 * with updates that keep C symmetric and positive definite.
 */

import { dot, norm } from "../mechanics/vectors";

const UPDATES = 40; // changes that are kept
const RECENT = 8; // those that are kept when there are too many
const PARALLEL = 1e-6; // cosine below which nothing is learned

/** Displacements in m of all nodes under unit forces in N on a node; null while they are computed. */
export type Columns = (node: number) => Float64Array[] | null;

export class LinearBody {
  private vectors: { vector: Float64Array; sign: number }[] = [];
  private changes: { nodes: number[]; change: Float64Array; effect: Float64Array }[] = [];

  constructor(
    private readonly columns: Columns,
    private readonly d: number,
  ) {}

  /** Be the body at rest. */
  forget(): void {
    this.vectors = [];
    this.changes = [];
  }

  /** Displacements at some nodes by unit forces on others, (at · d) x (of · d); null if unknown. */
  compliance(at: readonly number[], of: readonly number[]): Float64Array | null {
    const { d } = this;
    const width = of.length * d;
    const found = new Float64Array(at.length * d * width);
    const known = of.map((node) => this.columns(node));
    for (const [place, columns] of known.entries()) {
      if (!columns) return null;
      columns.forEach((column, axis) => {
        at.forEach((node, row) => {
          for (let i = 0; i < d; i++) {
            found[(row * d + i) * width + place * d + axis] = column[node * d + i];
          }
        });
      });
    }
    for (const { vector, sign } of this.vectors) {
      const right = of.flatMap((node) => Array.from(vector.subarray(node * d, node * d + d)));
      at.forEach((node, row) => {
        for (let i = 0; i < d; i++) {
          const left = sign * vector[node * d + i];
          for (let j = 0; j < width; j++) found[(row * d + i) * width + j] += left * right[j];
        }
      });
    }
    return found;
  }

  /** Let a change of the forces in N on some nodes have its effect in m, both (nodes · d). */
  learn(nodes: number[], change: Float64Array, effect: Float64Array): void {
    const work = dot(effect, change);
    const size = norm(change);
    if (nodes.length === 0 || work <= PARALLEL * norm(effect) * size) return;
    const expected = this.moved(nodes, change);
    if (!expected) return;
    this.changes.push({ nodes, change, effect });
    if (this.changes.length > UPDATES) {
      const recent = this.changes.slice(-RECENT);
      this.forget();
      for (const one of recent) this.learn(one.nodes, one.change, one.effect);
      return;
    }
    const lack = effect.map((value, i) => value - expected[i]);
    const slope = dot(lack, change);
    if (slope > PARALLEL * norm(lack) * size) {
      this.add(lack, slope, 1);
    } else if (slope < 0) {
      this.add(effect, work, 1);
      this.add(expected, dot(expected, change), -1);
    }
  }

  /** C δf of forces on some nodes, (nodes · d); null if columns are unknown. */
  private moved(nodes: readonly number[], change: Float64Array): Float64Array | null {
    const sum = new Float64Array(change.length);
    for (const node of nodes) {
      const columns = this.columns(node);
      if (!columns) return null;
      columns.forEach((column, axis) => {
        plus(sum, column, change[node * this.d + axis]);
      });
    }
    for (const { vector, sign } of this.vectors) plus(sum, vector, sign * dot(vector, change));
    return sum;
  }

  private add(vector: Float64Array, square: number, sign: number): void {
    this.vectors.push({ vector: vector.map((value) => value / Math.sqrt(square)), sign });
  }
}

/** sum += factor · a */
function plus(sum: Float64Array, a: Float64Array, factor: number): void {
  for (let i = 0; i < sum.length; i++) sum[i] += factor * a[i];
}
