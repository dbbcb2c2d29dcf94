/**
 * A Neo-Hookean solid of finite elements, as `surrogate/mechanics/solids/solid.py` and `neo_hookean.py`:
 *
 *   F = I + Σ_a u_a ⊗ G_a,  P = μ (F − F^{-T}) + J U' F^{-T},  f_a = Σ_q w_q P_q G_a,
 *   K_ab = Σ_q w_q [μ (G_a·G_b) I + (μ − J U') g_b ⊗ g_a + (J U' + J² U'') g_a ⊗ g_b],
 *   g_a = F^{-T} G_a.
 */

import { cellGradients, invert, type CellGradients, type CellType } from "./elements";

/** Lamé parameters in Pa, and the name of the volumetric term U(J). */
export interface Material {
  lambda: number;
  mu: number;
  volumetric: "paper" | "quadratic";
  /** Whether the volume of a cell changes as a whole; the tangent is then that of the body at rest. */
  meanDilation: boolean;
}

/** J U' and J U' + J² U'' in Pa, by e = J − 1. */
export function volumetric({ lambda, volumetric }: Material, e: number): [number, number] {
  const j = 1 + e;
  if (volumetric === "paper") return [(lambda / 2) * e * (j + 1), lambda * j * j];
  return [lambda * j * e, lambda * j * (2 * j - 1)];
}

export class Solid {
  readonly d: number;
  readonly volume: number;
  readonly corners: number;
  /** Mean length in m of the first edge of the cells. */
  readonly meanEdge: number;
  private readonly nodes: number;
  private readonly parts: CellGradients;
  private readonly f: Float64Array;
  private readonly inverse: Float64Array;

  constructor(
    coordinates: Float64Array,
    readonly cells: Int32Array,
    type: CellType,
    readonly material: Material,
  ) {
    this.parts = cellGradients(coordinates, cells, type);
    this.corners = this.parts.corners;
    this.d = type === "triangle" || type === "quad" ? 2 : 3;
    this.nodes = coordinates.length / this.d;
    this.meanEdge = meanEdge(coordinates, cells, this.corners, this.d);
    this.volume = this.parts.volumes.reduce((sum, v) => sum + v, 0);
    this.f = new Float64Array(this.d * this.d);
    this.inverse = new Float64Array(this.d * this.d);
  }

  get cellCount(): number {
    return this.cells.length / this.corners;
  }

  /** Compute F − I at a quadrature point into `f`. */
  private slope(u: Float64Array, cell: number, point: number): void {
    const { d, f, corners } = this;
    const { gradients } = this.parts;
    f.fill(0);
    for (let a = 0; a < corners; a++) {
      const node = this.cells[cell * corners + a] * d;
      const g = (point * corners + a) * d;
      for (let i = 0; i < d; i++) {
        const value = u[node + i];
        for (let j = 0; j < d; j++) f[i * d + j] += value * gradients[g + j];
      }
    }
  }

  /** Compute F at a quadrature point, and its inverse; returns J. */
  private deform(u: Float64Array, cell: number, point: number): number {
    const { d, f } = this;
    this.slope(u, cell, point);
    for (let i = 0; i < d; i++) f[i * (d + 1)] += 1;
    return invert(f, d, this.inverse);
  }

  /** Volumes of the quadrature points in m³. */
  get volumes(): Float64Array {
    return this.parts.volumes;
  }

  /** Number of cells with J ≤ 0, or no number, at a point. */
  inverted(u: Float64Array): number {
    const { points } = this.parts;
    let count = 0;
    for (let cell = 0; cell < this.cellCount; cell++) {
      for (let q = 0; q < points; q++) {
        const j = this.deform(u, cell, cell * points + q);
        if (!(j > 0 && j < Infinity)) {
          count++;
          break;
        }
      }
    }
    return count;
  }

  /** Strain energy E(u) in J, infinite if a cell is inverted. */
  energy(u: Float64Array): number {
    const { points, volumes } = this.parts;
    let energy = 0;
    for (let point = 0; point < volumes.length; point++) {
      const j = this.deform(u, Math.floor(point / points), point);
      if (!(j > 0)) return Infinity;
      energy += volumes[point] * this.density(j);
    }
    return energy;
  }

  /** Strain energy per volume in Pa, of the F of the last point. */
  private density(j: number): number {
    const { lambda, mu, volumetric } = this.material;
    const logarithm = Math.log(j);
    const square = this.f.reduce((sum, value) => sum + value * value, 0);
    const bulk =
      volumetric === "paper"
        ? (lambda / 4) * (j * j - 1 - 2 * logarithm)
        : (lambda / 2) * (j - 1) ** 2;
    return (mu / 2) * (square - this.d - 2 * logarithm) + bulk;
  }

  /** ∂u_i/∂x_j at the quadrature points, (points, d, d). */
  slopes(u: Float64Array): Float64Array {
    const { points, volumes } = this.parts;
    const found = new Float64Array(volumes.length * this.f.length);
    for (let point = 0; point < volumes.length; point++) {
      this.slope(u, Math.floor(point / points), point);
      found.set(this.f, point * this.f.length);
    }
    return found;
  }

  /** Mean of F over every cell, (cells, d, d). */
  meanDeformation(u: Float64Array): Float64Array {
    const { points, volumes } = this.parts;
    const size = this.d * this.d;
    const found = new Float64Array(this.cellCount * size);
    for (let cell = 0; cell < this.cellCount; cell++) {
      const volume = volumes.subarray(cell * points, (cell + 1) * points).reduce((a, b) => a + b);
      for (let point = cell * points; point < (cell + 1) * points; point++) {
        this.deform(u, cell, point);
        const share = volumes[point] / volume;
        for (let i = 0; i < size; i++) found[cell * size + i] += share * this.f[i];
      }
    }
    return found;
  }

  /** f_int = ∂E/∂u in N, (nodes, d); no meaning if a cell is inverted. */
  internalForces(u: Float64Array): Float64Array {
    const { d } = this;
    const { points, volumes } = this.parts;
    const { mu } = this.material;
    const stress = new Float64Array(volumes.length * d * d);
    for (let point = 0; point < volumes.length; point++) {
      const j = this.deform(u, Math.floor(point / points), point);
      const [pressure] = volumetric(this.material, j - 1);
      for (let i = 0; i < d; i++) {
        for (let k = 0; k < d; k++) {
          stress[(point * d + i) * d + k] =
            mu * this.f[i * d + k] + (pressure - mu) * this.inverse[k * d + i];
        }
      }
    }
    return this.forcesOf(stress);
  }

  /** Forces Σ_q w_q P_q G_a in N of stresses in Pa: (points, d, d) to (nodes, d). */
  forcesOf(stress: Float64Array): Float64Array {
    const { d, corners } = this;
    const { points, gradients, volumes } = this.parts;
    const forces = new Float64Array(this.nodes * d);
    for (let point = 0; point < volumes.length; point++) {
      const cell = Math.floor(point / points);
      for (let a = 0; a < corners; a++) {
        const node = this.cells[cell * corners + a] * d;
        const g = (point * corners + a) * d;
        for (let i = 0; i < d; i++) {
          let sum = 0;
          for (let k = 0; k < d; k++) sum += stress[(point * d + i) * d + k] * gradients[g + k];
          forces[node + i] += volumes[point] * sum;
        }
      }
    }
    return forces;
  }

  /** Σ_q w_q G_a·G_b of one cell into `k`, (corners, corners). */
  cellLaplacian(cell: number, k: Float64Array): void {
    const { d, corners } = this;
    const { points, gradients, volumes } = this.parts;
    k.fill(0);
    for (let point = cell * points; point < (cell + 1) * points; point++) {
      const g = gradients.subarray(point * corners * d, (point + 1) * corners * d);
      for (let a = 0; a < corners; a++) {
        for (let b = 0; b < corners; b++) {
          let sum = 0;
          for (let j = 0; j < d; j++) sum += g[a * d + j] * g[b * d + j];
          k[a * corners + b] += volumes[point] * sum;
        }
      }
    }
  }

  /**
   * Change K of a cell at rest to that of `surrogate/mechanics/solids/mean_dilation.py`, which has the mean
   * of the volume strain in place of the strain itself:
   *
   *   K − (λ + 2μ/d) [Σ_q w_q G_q G_qᵀ − (Σ_q w_q G_q) (Σ_q w_q G_q)ᵀ / Σ_q w_q].
   */
  private averageDilation(cell: number, k: Float64Array): void {
    const { points, gradients, volumes } = this.parts;
    const size = this.corners * this.d;
    const { lambda, mu } = this.material;
    const modulus = lambda + (2 * mu) / this.d;
    const mean = new Float64Array(size);
    let volume = 0;
    for (let point = cell * points; point < (cell + 1) * points; point++) {
      const w = volumes[point];
      const g = gradients.subarray(point * size, (point + 1) * size);
      volume += w;
      for (let row = 0; row < size; row++) {
        mean[row] += w * g[row];
        for (let column = 0; column <= row; column++) {
          k[row * size + column] -= modulus * w * g[row] * g[column];
        }
      }
    }
    for (let row = 0; row < size; row++) {
      for (let column = 0; column <= row; column++) {
        k[row * size + column] += (modulus * mean[row] * mean[column]) / volume;
      }
    }
  }

  /** K of one cell in N/m into `k`, (corners · d)², rows and columns numbered corner · d + component. */
  cellTangent(u: Float64Array, cell: number, k: Float64Array): void {
    const { d, corners } = this;
    const { points, gradients, volumes } = this.parts;
    const size = corners * d;
    const g = new Float64Array(size);
    const { mu } = this.material;
    k.fill(0);
    for (let q = 0; q < points; q++) {
      const point = cell * points + q;
      const j = this.deform(u, cell, point);
      const w = volumes[point];
      const [pressure, squared] = volumetric(this.material, j - 1);
      const crossed = w * (mu - pressure);
      const direct = w * squared;
      const first = point * size;
      for (let a = 0; a < corners; a++) {
        for (let i = 0; i < d; i++) {
          let sum = 0;
          for (let m = 0; m < d; m++) sum += this.inverse[m * d + i] * gradients[first + a * d + m];
          g[a * d + i] = sum;
        }
      }
      for (let a = 0; a < corners; a++) {
        for (let b = 0; b <= a; b++) {
          let dot = 0;
          for (let m = 0; m < d; m++) {
            dot += gradients[first + a * d + m] * gradients[first + b * d + m];
          }
          dot *= w * mu;
          for (let i = 0; i < d; i++) {
            const row = (a * d + i) * size + b * d;
            const left = direct * g[a * d + i];
            const right = crossed * g[b * d + i];
            for (let m = 0; m < d; m++) k[row + m] += left * g[b * d + m] + right * g[a * d + m];
            k[row + i] += dot;
          }
        }
      }
    }
    if (this.material.meanDilation) this.averageDilation(cell, k);
    for (let row = 0; row < size; row++) {
      for (let column = row + 1; column < size; column++) {
        k[row * size + column] = k[column * size + row]!;
      }
    }
  }
}

function meanEdge(x: Float64Array, cells: Int32Array, corners: number, d: number): number {
  let sum = 0;
  for (let first = 0; first < cells.length; first += corners) {
    const [a, b] = [cells[first] * d, cells[first + 1] * d];
    sum += Math.hypot(...x.subarray(a, a + d).map((value, i) => x[b + i] - value));
  }
  return sum / (cells.length / corners);
}
