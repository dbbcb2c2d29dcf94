/**
 * Tangents of the cells of a solid. Those of elements with a dilation of their own have rows and
 * columns of θ and p after those of the displacements, as `surrogate/mechanics/solids/taylor_hood.py`,
 * or, where θ is of one cell alone, are condensed, as `mean_dilation.py`:
 *
 *   K + (c vᵀ + v cᵀ) / V + s v vᵀ / V²
 */

import type { Deformation } from "./deformation";
import type { Solid } from "./solid";

/** What a tangent is of: a state as it is, without its p, or with θ = J at every point. */
export type Kind = "full" | "relaxed" | "pointwise";

/** Number of rows of a cell's matrix. */
export function rowsOf(solid: Solid): number {
  const { dilation } = solid.body;
  return solid.corners * solid.d + (dilation?.joined ? 2 * dilation.shapes[0].length : 0);
}

/** Write the matrices of all cells, in N/m. */
export function writeTangents(
  solid: Solid,
  states: readonly Deformation[],
  kind: Kind,
  add: (cell: number, k: Float64Array) => void,
): void {
  const { d, corners, points, blocks } = solid;
  const size = corners * d;
  const square = d * d;
  const rows = rowsOf(solid);
  const k = new Float64Array(rows * rows);
  const local = new Float64Array(square * square);
  const turned = new Float64Array(square * size);
  blocks.forEach(({ first, end, start, n }, b) => {
    const state = states[b];
    const { pressure } = state;
    if (kind !== "full") state.pressure = null;
    const moduli = state.moduli(kind === "pointwise");
    state.pressure = pressure;
    const beside = solid.projects && kind !== "pointwise" ? new Beside(solid, state) : null;
    for (let cell = first; cell < end; cell++) {
      k.fill(0);
      for (let q = 0; q < points; q++) {
        const p = (cell - first) * points + q;
        const g = solid.gradientsAt(start + p);
        const w = solid.volumes[start + p];
        for (let kl = 0; kl < square; kl++) {
          for (let ij = 0; ij < square; ij++) local[ij * square + kl] = w * moduli[kl][ij * n + p];
        }
        for (let ij = 0; ij < square; ij++) {
          for (let a = 0; a < corners; a++) {
            for (let m = 0; m < d; m++) {
              let sum = 0;
              for (let l = 0; l < d; l++) sum += local[ij * square + m * d + l] * g[a * d + l];
              turned[ij * size + a * d + m] = sum;
            }
          }
        }
        for (let a = 0; a < corners; a++) {
          for (let i = 0; i < d; i++) {
            const row = (a * d + i) * rows;
            const last = (a + 1) * d;
            for (let j = 0; j < d; j++) {
              const slope = g[a * d + j];
              const from = (i * d + j) * size;
              for (let c = 0; c < last; c++) k[row + c] += slope * turned[from + c];
            }
          }
        }
      }
      beside?.add(cell, (cell - first) * points, k);
      for (let row = 0; row < rows; row++) {
        for (let column = row + 1; column < rows; column++) {
          k[row * rows + column] = k[column * rows + row];
        }
      }
      add(cell, k);
    }
  });
}

/** The part of θ and p in the tangents of a block: below the diagonal. */
class Beside {
  private readonly mixed: Float64Array;
  private readonly curvature: Float64Array;

  constructor(
    private readonly solid: Solid,
    private readonly state: Deformation,
  ) {
    this.mixed = state.mixed();
    this.curvature = state.curvature();
  }

  /** Add it to the matrix of a cell, whose first point has a number in the block. */
  add(cell: number, first: number, k: Float64Array): void {
    const { solid, state, curvature } = this;
    const { shapes, joined } = solid.body.dilation!;
    const { volumes, points } = solid;
    const width = shapes[0].length;
    const size = solid.corners * solid.d;
    const ofDilation = this.works(this.mixed, cell, first);
    const ofPressure = this.works(state.cofactor, cell, first);
    const mass = solid.cellMass(cell);
    const curved = new Float64Array(width * width);
    shapes.forEach((shape, q) => {
      const w = volumes[cell * points + q] * curvature[first + q];
      shape.forEach((x, a) => {
        shape.forEach((y, b) => (curved[a * width + b] += w * x * y));
      });
    });
    if (joined) {
      const rows = size + 2 * width;
      for (let a = 0; a < width; a++) {
        const [dilation, pressure] = [(size + a) * rows, (size + width + a) * rows];
        for (let c = 0; c < size; c++) {
          k[dilation + c] += ofDilation[c * width + a];
          k[pressure + c] += ofPressure[c * width + a];
        }
        for (let b = 0; b < width; b++) {
          k[dilation + size + b] += curved[a * width + b];
          k[pressure + size + b] -= mass[a * width + b];
        }
      }
      return;
    }
    const [volume] = mass;
    for (let row = 0; row < size; row++) {
      const [c, v] = [ofDilation[row] / volume, ofPressure[row] / volume];
      for (let column = 0; column <= row; column++) {
        const other = ofPressure[column];
        k[row * size + column] +=
          c * other + v * ofDilation[column] + curved[0] * v * (other / volume);
      }
    }
  }

  /** Works of a stress that a function φ multiplies, by the displacements: (corners · d, φ). */
  private works(stress: Float64Array, cell: number, first: number): Float64Array {
    const { d, corners, points, volumes, body } = this.solid;
    const { shapes } = body.dilation!;
    const width = shapes[0].length;
    const n = this.curvature.length;
    const found = new Float64Array(corners * d * width);
    shapes.forEach((shape, q) => {
      const g = this.solid.gradientsAt(cell * points + q);
      const w = volumes[cell * points + q];
      for (let a = 0; a < corners; a++) {
        for (let i = 0; i < d; i++) {
          let sum = 0;
          for (let j = 0; j < d; j++) sum += stress[(i * d + j) * n + first + q] * g[a * d + j];
          for (let m = 0; m < width; m++) found[(a * d + i) * width + m] += w * sum * shape[m];
        }
      }
    });
    return found;
  }
}
