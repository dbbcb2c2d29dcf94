/**
 * Galerkin's equations of a body whose displacement is a combination of fields:
 *
 *   u = Σ_k c_k u_k,  g_k = u_k · f_int(u) = Σ_q w_q P(u) : ∇u_k,  ∂g_k/∂c_l
 */

import type { Elements } from "./body";
import type { Slopes, Solid } from "./solid";
import { combined, dot } from "./vectors";

export class Galerkin {
  /** ∇u_k, and w_q ∇u_k. */
  readonly slopes: readonly Slopes[];
  readonly weighted: readonly Slopes[];

  constructor(
    private readonly solid: Solid<Elements>,
    fields: readonly Float64Array[],
  ) {
    this.slopes = fields.map((field) => solid.slopes(field));
    this.weighted = this.slopes.map((h) => solid.weighted(h));
  }

  /** Works of the internal forces on the fields in J; null where cells are inverted. */
  works(c: ArrayLike<number>): Float64Array | null {
    const { solid, slopes, weighted } = this;
    const blocks = slopes[0].map((_, b) => slopes.map((h) => h[b]));
    solid.set(
      0,
      blocks.map((of) => combined(c, of)),
    );
    if (solid.inverted() > 0) return null;
    const stress = solid.stress(0);
    return Float64Array.from(weighted, (h) => product(stress, h));
  }

  /** Their derivatives by c, (n · n), where `works` was asked last. */
  tangent(): Float64Array {
    const { solid, slopes, weighted } = this;
    const n = slopes.length;
    const matrix = new Float64Array(n * n);
    const changes = slopes.map((direction) => {
      solid.set(1, direction);
      return solid.stress(1);
    });
    changes[0].forEach((_, b) => {
      for (let l = 0; l < n; l++) {
        for (let k = 0; k <= l; k++)
          matrix[l * n + k] = matrix[k * n + l] += dot(changes[l][b], weighted[k][b]);
      }
    }); // block by block, which a processor keeps at hand
    return matrix;
  }
}

/** Σ_q A : B of all blocks. */
export function product(a: Slopes, b: Slopes): number {
  return a.reduce((sum, block, i) => sum + dot(block, b[i]), 0);
}
