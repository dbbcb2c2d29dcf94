/** Gradients of shape functions and volumes at the quadrature points, from those of the reference cell. */

import type { Body } from "./messages";

/** Shape functions of a reference cell or facet at its quadrature points. */
export interface Reference {
  /** ∂N_b/∂ξ_j of every point, (corners · dimensions of the reference). */
  gradients: number[][];
  weights: number[];
}

/** ∂N_b/∂x_j in 1/m, (cells, points, corners, d), and volumes in m^d, (cells, points). */
export function cellGradients({ d, coordinates, cells, reference }: Body): {
  gradients: Float64Array;
  volumes: Float64Array;
} {
  const corners = reference.gradients[0].length / d;
  const points = reference.weights.length;
  const count = cells.length / corners;
  const gradients = new Float64Array(count * points * corners * d);
  const volumes = new Float64Array(count * points);
  const jacobian = new Float64Array(d * d);
  const inverse = new Float64Array(d * d);
  for (let cell = 0; cell < count; cell++) {
    reference.gradients.forEach((slopes, q) => {
      jacobian.fill(0); // ∂x_i/∂ξ_j
      for (let b = 0; b < corners; b++) {
        const node = cells[cell * corners + b] * d;
        for (let i = 0; i < d; i++) {
          for (let j = 0; j < d; j++)
            jacobian[i * d + j] += coordinates[node + i] * slopes[b * d + j];
        }
      }
      const point = cell * points + q;
      volumes[point] = reference.weights[q] * Math.abs(invert(jacobian, d, inverse));
      for (let b = 0; b < corners; b++) {
        for (let i = 0; i < d; i++) {
          let sum = 0;
          for (let j = 0; j < d; j++) sum += slopes[b * d + j] * inverse[j * d + i];
          gradients[(point * corners + b) * d + i] = sum;
        }
      }
    });
  }
  return { gradients, volumes };
}

/** Inverse of a d × d matrix (by rows) into `out`; returns the determinant. */
function invert(m: Float64Array, d: number, out: Float64Array): number {
  if (d === 2) {
    const det = m[0] * m[3] - m[1] * m[2];
    out.set([m[3] / det, -m[1] / det, -m[2] / det, m[0] / det]);
    return det;
  }
  const cofactor = (i: number, j: number): number => {
    const [a, b] = [3 * ((i + 1) % 3), 3 * ((i + 2) % 3)];
    const [r, s] = [(j + 1) % 3, (j + 2) % 3];
    return m[a + r] * m[b + s] - m[a + s] * m[b + r];
  };
  const det = m[0] * cofactor(0, 0) + m[1] * cofactor(0, 1) + m[2] * cofactor(0, 2);
  for (let i = 0; i < 3; i++) {
    for (let j = 0; j < 3; j++) out[3 * j + i] = cofactor(i, j) / det;
  }
  return det;
}
