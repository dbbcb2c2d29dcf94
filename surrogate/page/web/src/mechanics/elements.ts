/**
 * Linear finite elements: gradients of the shape functions at quadrature points, as
 * `surrogate/mechanics/solids/elements.py`: 2 Gauss points along each axis of quadrilaterals and
 * hexahedra, one point in triangles and tetrahedra.
 */

export type CellType = "triangle" | "quad" | "tetra" | "hexahedron";

/** Corners of the reference cells, in VTK order. */
// prettier-ignore
const CORNERS: Record<CellType, number[][]> = {
  triangle: [[0, 0], [1, 0], [0, 1]],
  quad: [[0, 0], [1, 0], [1, 1], [0, 1]],
  tetra: [[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]],
  hexahedron: [
    [0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0],
    [0, 0, 1], [1, 0, 1], [1, 1, 1], [0, 1, 1],
  ],
};

/** Number of corners of a cell. */
export function cornersOf(cellType: CellType): number {
  return CORNERS[cellType].length;
}

const GAUSS = [0.5 - 0.5 / Math.sqrt(3), 0.5 + 0.5 / Math.sqrt(3)];

/** Gradients ∂N_b/∂x_j in 1/m, (cells, points, corners, d), and volumes in m^d, (cells, points). */
export interface CellGradients {
  corners: number;
  points: number;
  gradients: Float64Array;
  volumes: Float64Array;
}

/** Points of the reference cell, and the weight of each. */
function quadrature(corners: number[][]): { points: number[][]; weight: number } {
  const d = corners[0].length;
  if (corners.length === d + 1) {
    return { points: [new Array<number>(d).fill(1 / (d + 1))], weight: 1 / (d === 2 ? 2 : 6) };
  }
  let points: number[][] = [[]];
  for (let axis = 0; axis < d; axis++) {
    points = points.flatMap((point) => GAUSS.map((s) => [...point, s]));
  }
  return { points, weight: 1 / points.length };
}

/** Derivative ∂N_b/∂ξ_j at a point ξ of the reference cell. */
function shapeGradient(corners: number[][], b: number, j: number, point: number[]): number {
  const d = point.length;
  if (corners.length === d + 1) return b === 0 ? -1 : b - 1 === j ? 1 : 0;
  let product = corners[b][j] === 1 ? 1 : -1;
  for (let axis = 0; axis < d; axis++) {
    if (axis !== j) product *= corners[b][axis] === 1 ? point[axis] : 1 - point[axis];
  }
  return product;
}

/** Inverse of a d × d matrix (by rows) into `out`; returns the determinant. */
export function invert(m: Float64Array, d: number, out: Float64Array): number {
  if (d === 2) {
    const det = m[0] * m[3] - m[1] * m[2];
    out[0] = m[3] / det;
    out[1] = -m[1] / det;
    out[2] = -m[2] / det;
    out[3] = m[0] / det;
    return det;
  }
  const c0 = m[4] * m[8] - m[5] * m[7];
  const c1 = m[5] * m[6] - m[3] * m[8];
  const c2 = m[3] * m[7] - m[4] * m[6];
  const det = m[0] * c0 + m[1] * c1 + m[2] * c2;
  out[0] = c0 / det;
  out[1] = (m[2] * m[7] - m[1] * m[8]) / det;
  out[2] = (m[1] * m[5] - m[2] * m[4]) / det;
  out[3] = c1 / det;
  out[4] = (m[0] * m[8] - m[2] * m[6]) / det;
  out[5] = (m[2] * m[3] - m[0] * m[5]) / det;
  out[6] = c2 / det;
  out[7] = (m[1] * m[6] - m[0] * m[7]) / det;
  out[8] = (m[0] * m[4] - m[1] * m[3]) / det;
  return det;
}

/** Compute gradients and volumes from coordinates in m, (nodes, d), and cells. */
export function cellGradients(
  coordinates: Float64Array,
  cells: Int32Array,
  type: CellType,
): CellGradients {
  const reference = CORNERS[type];
  const corners = reference.length;
  const d = reference[0].length;
  const { points, weight } = quadrature(reference);
  const count = cells.length / corners;
  const gradients = new Float64Array(count * points.length * corners * d);
  const volumes = new Float64Array(count * points.length);
  const jacobian = new Float64Array(d * d);
  const inverse = new Float64Array(d * d);
  const shapes = points.map((point) =>
    reference.map((_, b) => point.map((_, j) => shapeGradient(reference, b, j, point))),
  );
  for (let cell = 0; cell < count; cell++) {
    shapes.forEach((shape, q) => {
      jacobian.fill(0); // ∂x_i/∂ξ_j
      for (let b = 0; b < corners; b++) {
        const node = cells[cell * corners + b] * d;
        for (let i = 0; i < d; i++) {
          for (let j = 0; j < d; j++) {
            jacobian[i * d + j] += coordinates[node + i] * shape[b][j];
          }
        }
      }
      const point = cell * points.length + q;
      volumes[point] = weight * Math.abs(invert(jacobian, d, inverse));
      for (let b = 0; b < corners; b++) {
        for (let i = 0; i < d; i++) {
          let sum = 0;
          for (let j = 0; j < d; j++) sum += shape[b][j] * inverse[j * d + i];
          gradients[(point * corners + b) * d + i] = sum;
        }
      }
    });
  }
  return { corners, points: points.length, gradients, volumes };
}
