/**
 * A solid of finite elements of any material, as `surrogate/mechanics/solids`:
 *
 *   F = I + Σ_a u_a ⊗ G_a,  f_a = Σ_q w_q P_q G_a,  K_ab = Σ_q w_q G_a · ∂P/∂F · G_b
 *
 * Elements with a dilation of their own have θ = Π J and p = Π ∂W/∂θ, with the projection Π on
 * functions φ that Python tells, by their mass matrix. Fields at the quadrature points are arrays of
 * blocks of cells of one material.
 */

import { Deformation } from "./deformation";
import { cellGradients } from "./gradients";
import { Layout } from "./layout";
import type { Body } from "./messages";
import type { ProfileFactor } from "./profile_factor";
import type { Law } from "./tape";
import { addContraction, addProduct, identity } from "./tensors";

const POINTS = 512; // of a block, about

/** Cells of one material. */
interface Block {
  law: Law;
  /** First cell, and the one after the last. */
  first: number;
  end: number;
  /** First quadrature point, and number of the points. */
  start: number;
  n: number;
  /** Directions of the families of the law at the points, (d, n) each. */
  fibres: Float64Array[];
}

/** A field at the quadrature points: components of every block. */
export type Field = Float64Array[];

export class Solid {
  readonly d: number;
  readonly corners: number;
  readonly cellCount: number;
  readonly volume: number;
  /** (points). */
  readonly volumes: Float64Array;
  readonly blocks: Block[] = [];
  /** Points of a cell. */
  readonly points: number;
  private readonly gradients: Float64Array;
  private readonly mass: { layout: Layout; factor: ProfileFactor } | null = null;

  constructor(readonly body: Body) {
    const { d, cells, reference, dilation } = body;
    this.d = d;
    this.corners = reference.gradients[0].length / d;
    this.points = reference.weights.length;
    this.cellCount = cells.length / this.corners;
    const parts = cellGradients(body);
    this.gradients = parts.gradients;
    this.volumes = parts.volumes;
    this.volume = this.volumes.reduce((sum, v) => sum + v, 0);
    const most = Math.max(1, Math.floor(POINTS / this.points));
    for (let first = 0; first < this.cellCount;) {
      let end = first;
      while (end < this.cellCount && end - first < most && body.parts[end] === body.parts[first])
        end++;
      this.blocks.push(this.block(first, end));
      first = end;
    }
    if (dilation) {
      const size = dilation.nodes.reduce((most, node) => Math.max(most, node + 1), 0);
      const order = Int32Array.from({ length: size }, (_, node) => node);
      const layout = new Layout(dilation.nodes, dilation.shapes[0].length, order, size);
      const mass = layout.assembled((add) => {
        for (let cell = 0; cell < this.cellCount; cell++) add(cell, this.cellMass(cell));
      });
      this.mass = { layout, factor: layout.factor(mass)! };
    }
  }

  /** ∇u at the quadrature points, (d, d). */
  slopes(u: Float64Array): Field {
    const { d, corners, gradients, points, body } = this;
    return this.blocks.map(({ first, start, n }) => {
      const h = new Float64Array(d * d * n);
      for (let p = 0; p < n; p++) {
        const corner = (first + Math.floor(p / points)) * corners;
        const g = (start + p) * corners * d;
        for (let i = 0; i < d; i++) {
          for (let j = 0; j < d; j++) {
            let sum = 0;
            for (let a = 0; a < corners; a++)
              sum += u[body.cells[corner + a] * d + i] * gradients[g + a * d + j];
            h[(i * d + j) * n + p] = sum;
          }
        }
      }
      return h;
    });
  }

  /** The deformation of every block, with p, of displacements in m, (points · d). */
  at(u: Float64Array): Deformation[] {
    return this.deformed([[1, this.slopes(u)]]);
  }

  /** The same of Σ c ∇u. */
  deformed(terms: readonly (readonly [number, Field])[]): Deformation[] {
    const states = this.blocks.map(({ law, n, fibres }, b) => {
      const f = identity(this.d, n);
      for (const [c, slopes] of terms) addProduct(f, c, slopes[b]);
      return new Deformation(law, this.d, f, fibres);
    });
    if (this.mass) {
      const dilations = this.projected(states.map(({ j }) => j));
      states.forEach((state, b) => {
        state.dilate(dilations[b]);
      });
      const pressures = this.projected(states.map((state) => state.slope()));
      states.forEach((state, b) => (state.pressure = pressures[b]));
    }
    return states;
  }

  /** Π of scalars; as they are where elements have no dilation of their own. */
  projected(values: Field): Field {
    const { mass, points, volumes } = this;
    if (!mass) return values;
    const { shapes, nodes } = this.body.dilation!;
    const width = shapes[0].length;
    const sums = new Float64Array(mass.layout.size);
    const each = (use: (b: number, p: number, shape: readonly number[], at: number) => void) => {
      this.blocks.forEach(({ first, n }, b) => {
        for (let p = 0; p < n; p++)
          use(b, p, shapes[p % points], (first + Math.floor(p / points)) * width);
      });
    };
    each((b, p, shape, at) => {
      const value = volumes[this.blocks[b].start + p] * values[b][p];
      for (let m = 0; m < width; m++) sums[nodes[at + m]] += shape[m] * value;
    });
    const solved = mass.layout.solve(mass.factor, sums);
    const found = values.map((part) => new Float64Array(part.length));
    each((b, p, shape, at) => {
      for (let m = 0; m < width; m++) found[b][p] += shape[m] * solved[nodes[at + m]];
    });
    return found;
  }

  get projects(): boolean {
    return this.mass !== null;
  }

  /** Number of cells with J ≤ 0, or θ ≤ 0, or no number, at a point. */
  inverted(states: readonly Deformation[]): number {
    let count = 0;
    this.blocks.forEach(({ n }, b) => {
      for (let p = 0; p < n; p += this.points)
        if (states[b].inside.subarray(p, p + this.points).includes(0)) count++;
    });
    return count;
  }

  /** Strain energy in J, infinite if a cell is inverted. */
  energy(states: readonly Deformation[]): number {
    return this.integral(states.map((state) => state.energy()));
  }

  /** Σ w over all points, of scalars. */
  integral(values: Field): number {
    let sum = 0;
    this.blocks.forEach(({ start, n }, b) => {
      for (let p = 0; p < n; p++) sum += this.volumes[start + p] * values[b][p];
    });
    return sum;
  }

  /** f_int = ∂E/∂u in N, (points, d); no meaning if a cell is inverted. */
  internalForces(states: readonly Deformation[]): Float64Array {
    return this.forcesOf(states.map((state) => state.stress()));
  }

  /** Changes of the stress in Pa with ∇u by some H, as `surrogate/mechanics/solids/changes.py`. */
  changes(states: readonly Deformation[], slopes: readonly Field[]): Field[] {
    return slopes.map((h) => {
      if (!this.mass) return states.map((state, b) => state.change(h[b], null));
      const volumes = states.map(({ cofactor, j }, b) => contraction(cofactor, h[b], j.length));
      const dilations = this.projected(volumes);
      const pressures = this.projected(
        states.map((state, b) => state.slopeChange(h[b], dilations[b])),
      );
      return states.map((state, b) => {
        const found = state.change(h[b], dilations[b]);
        addProduct(found, pressures[b], state.cofactor);
        return found;
      });
    });
  }

  /** Forces Σ_q w_q P_q G_a in N of stresses in Pa: (points, d). */
  forcesOf(stress: Field): Float64Array {
    const { d, corners, gradients, volumes, points, body } = this;
    const forces = new Float64Array(body.coordinates.length);
    this.blocks.forEach(({ first, start, n }, b) => {
      const block = stress[b];
      for (let p = 0; p < n; p++) {
        const corner = (first + Math.floor(p / points)) * corners;
        const w = volumes[start + p];
        for (let a = 0; a < corners; a++) {
          const node = body.cells[corner + a] * d;
          const g = ((start + p) * corners + a) * d;
          for (let i = 0; i < d; i++) {
            let sum = 0;
            for (let k = 0; k < d; k++) sum += block[(i * d + k) * n + p] * gradients[g + k];
            forces[node + i] += w * sum;
          }
        }
      }
    });
    return forces;
  }

  /** Mean of F over every cell, (cells, d, d). */
  meanDeformation(u: Float64Array): Float64Array {
    const size = this.d ** 2;
    const found = new Float64Array(this.cellCount * size);
    const slopes = this.slopes(u);
    this.blocks.forEach(({ first, end, start, n }, b) => {
      for (let cell = first; cell < end; cell++) {
        const own = (cell - first) * this.points;
        const weights = this.volumes.subarray(start + own, start + own + this.points);
        const volume = weights.reduce((sum, w) => sum + w, 0);
        for (let i = 0; i < size; i++) {
          let sum = 0;
          weights.forEach((w, q) => (sum += w * slopes[b][i * n + own + q]));
          found[cell * size + i] = sum / volume + (i % (this.d + 1) === 0 ? 1 : 0);
        }
      }
    });
    return found;
  }

  /** Σ_q w_q μ_q G_a·G_b of one cell into `k`, (corners, corners). */
  cellLaplacian(cell: number, k: Float64Array): void {
    const { d, corners, points } = this;
    const { laws, parts } = this.body;
    k.fill(0);
    for (let point = cell * points; point < (cell + 1) * points; point++) {
      const g = this.gradientsAt(point);
      const w = this.volumes[point] * laws[parts[cell]].mu;
      for (let a = 0; a < corners; a++) {
        for (let b = 0; b < corners; b++) {
          let sum = 0;
          for (let j = 0; j < d; j++) sum += g[a * d + j] * g[b * d + j];
          k[a * corners + b] += w * sum;
        }
      }
    }
  }

  /** ∂N_a/∂x_j in 1/m at a quadrature point, (corners, d). */
  gradientsAt(point: number): Float64Array {
    const size = this.corners * this.d;
    return this.gradients.subarray(point * size, (point + 1) * size);
  }

  /** Σ_q w_q φ_a φ_b of a cell. */
  cellMass(cell: number): Float64Array {
    const { shapes } = this.body.dilation!;
    const width = shapes[0].length;
    const k = new Float64Array(width * width);
    shapes.forEach((shape, q) => {
      const w = this.volumes[cell * this.points + q];
      shape.forEach((x, a) => {
        shape.forEach((y, b) => (k[a * width + b] += w * x * y));
      });
    });
    return k;
  }

  private block(first: number, end: number): Block {
    const { d, points } = this;
    const { fibres, laws, parts } = this.body;
    const law = laws[parts[first]];
    const n = (end - first) * points;
    const families = fibres ? fibres.length / (this.cellCount * d) : 0;
    const directions = Array.from({ length: (law.count - 4) / 2 }, (_, family) => {
      const found = new Float64Array(d * n);
      for (let i = 0; i < d; i++) {
        for (let p = 0; p < n; p++) {
          const cell = first + Math.floor(p / points);
          found[i * n + p] = fibres![(cell * families + family) * d + i];
        }
      }
      return found;
    });
    return { law, first, end, start: first * points, n, fibres: directions };
  }
}

/** A : B at the points of a block. */
export function contraction(a: Float64Array, b: Float64Array, n: number): Float64Array {
  const found = new Float64Array(n);
  addContraction(found, a, b);
  return found;
}
