/**
 * A solid of finite elements of any material, as `surrogate/mechanics/solids`:
 *
 *   F = I + Σ_a u_a ⊗ G_a,  f_a = Σ_q w_q P_q G_a,  K = Σ_q w_q Bᵀ D B
 *
 * with the derivative P of W(F, θ) + p (J − θ) at a point by F, and D the second ones. Elements with a
 * dilation of their own have θ = Π J and p = Π ∂W/∂θ, with the projection Π on functions φ that Python
 * tells, by their mass matrix. All of this is computed of power series in a parameter: order 0 is a
 * state, order 1 its change along a direction, and a load series has more.
 */

import type { Body, Elements } from "./body";
import { Profile, type Factor } from "./profile";
import { Series, type Law } from "./recording";
import { solve } from "./vectors";

const POINTS = 128; // of a block, about

/** What a tangent is of: a state as it is, without its p, or with θ = J at every point. */
export type Kind = "full" | "relaxed" | "pointwise";

/** ∇u of all blocks: (d · d, n) each. */
export type Slopes = Float64Array[];

/** Cells of one material, from the first to the one before the end. */
interface Block {
  law: Law;
  first: number;
  end: number;
  series: Series;
}

export class Solid<B extends Elements = Body> {
  /** Corners and quadrature points of a cell; rows of its matrix without θ and p. */
  readonly corners: number;
  readonly points: number;
  readonly size: number;
  readonly cellCount: number;
  private readonly blocks: Block[] = [];
  /** ∂N_a/∂x_j in 1/m, (cells, points, corners, d). */
  private readonly gradients: Float64Array;
  private readonly mass: { profile: Profile; factor: Factor } | null = null;

  constructor(readonly body: B) {
    const { d, gradients, dilation, parts } = body;
    this.size = gradients[0].length;
    this.corners = this.size / d;
    this.points = gradients.length;
    this.cellCount = parts.length;
    this.gradients = this.cellGradients();
    const most = Math.max(1, Math.floor(POINTS / this.points));
    for (let first = 0, end = 0; first < this.cellCount; first = end) {
      while (end < this.cellCount && end - first < most && parts[end] === parts[first]) end++;
      this.blocks.push(this.block(first, end));
    }
    if (!dilation) return;
    const width = dilation.shapes[0].length;
    const count = dilation.nodes.reduce((most, node) => Math.max(most, node + 1), 0);
    const profile = new Profile(dilation.nodes, width, Int32Array.from(Array(count).keys()), count);
    const mass = profile.zeros();
    for (let cell = 0; cell < this.cellCount; cell++) {
      const k = new Float64Array(width * width);
      dilation.shapes.forEach((shape, q) => {
        const w = body.volumes[cell * this.points + q];
        k.forEach((_, i) => (k[i] += w * shape[Math.floor(i / width)] * shape[i % width]));
      });
      profile.add(mass, dilation.nodes.subarray(cell * width, (cell + 1) * width), k);
    }
    this.mass = { profile, factor: profile.factor(mass)! };
  }

  get projects(): boolean {
    return this.mass !== null;
  }

  /** Compute the coefficients of order k, of those of ∇u; null for zeros. */
  set(k: number, slopes: Slopes | null): void {
    const square = this.body.d ** 2;
    this.blocks.forEach(({ law, series }, b) => {
      const f = series.at(k, 0, slopes !== null, square);
      if (slopes) f.set(slopes[b]);
      for (let i = 0; i < square && k === 0; i += this.body.d + 1)
        series.at(0, i, true).forEach((value, p, diagonal) => (diagonal[p] = value + 1));
      series.at(k, square, k === 0, law.inputs - square);
      series.run(k, 0);
    });
    if (!this.mass) return;
    this.project(k, (law) => law.volume, 2);
    for (const { series } of this.blocks) series.run(k, 1);
    this.project(k, (law) => law.slope!, 1);
    for (const { series } of this.blocks) series.run(k, 2);
  }

  /** ∇u at the points of displacements in m. */
  slopes(u: Float64Array): Slopes {
    const { gradients, corners, points, size } = this;
    const { d, cells } = this.body;
    const local = new Float64Array(size);
    return this.blocks.map(({ first, end, series }) => {
      const h = new Float64Array(d * d * series.n);
      for (let cell = first, p = 0; cell < end; cell++) {
        for (let a = 0; a < size; a++)
          local[a] = u[cells[cell * corners + Math.floor(a / d)] * d + (a % d)];
        for (let q = 0; q < points; q++, p++) {
          const g = (cell * points + q) * size;
          for (let i = 0; i < d; i++) {
            for (let j = 0; j < d; j++) {
              let sum = 0;
              for (let a = 0; a < size; a += d) sum += local[a + i] * gradients[g + a + j];
              h[(i * d + j) * series.n + p] = sum;
            }
          }
        }
      }
      return h;
    });
  }

  /** Forces Σ_q w_q P_q G_a in N of the stress of order k: (points · d). */
  forces(k: number): Float64Array {
    const { gradients, corners, points } = this;
    const { d, cells, volumes, coordinates } = this.body;
    const found = new Float64Array(coordinates.length);
    const local = new Float64Array(this.size);
    for (const { law, series, first, end } of this.blocks) {
      const stress = law.outputs.slice(0, d * d).map((slot) => series.at(k, slot));
      for (let cell = first; cell < end; cell++) {
        local.fill(0);
        for (let i = 0; i < d; i++) {
          for (let j = 0; j < d; j++) {
            const component = stress[i * d + j];
            for (let point = cell * points; point < (cell + 1) * points; point++) {
              const weighted = volumes[point] * component[point - first * points];
              const g = point * this.size + j;
              for (let a = 0; a < this.size; a += d) local[a + i] += weighted * gradients[g + a];
            }
          }
        }
        for (let a = 0; a < corners; a++) {
          const node = cells[cell * corners + a] * d;
          for (let i = 0; i < d; i++) found[node + i] += local[a * d + i];
        }
      }
    }
    return found;
  }

  /** w_q ∇u */
  weighted(slopes: Slopes): Slopes {
    return slopes.map((block, b) => {
      const { series, first } = this.blocks[b];
      const volumes = this.body.volumes.subarray(first * this.points);
      return block.map((value, i) => value * volumes[i % series.n]);
    });
  }

  /** The stress P of order k in Pa of all blocks, as `slopes`. */
  stress(k: number): Slopes {
    const square = this.body.d ** 2;
    return this.blocks.map(({ law, series }) => {
      const found = new Float64Array(square * series.n);
      for (let i = 0; i < square; i++) found.set(series.at(k, law.outputs[i]), i * series.n);
      return found;
    });
  }

  /** Number of cells with J ≤ 0, or θ ≤ 0, or no number, at a point of the state. */
  inverted(): number {
    let count = 0;
    for (const { law, series } of this.blocks) {
      const volumes = [series.at(0, law.volume)];
      if (this.mass) volumes.push(series.at(0, law.inputs - 2));
      for (let p = 0; p < series.n; p += this.points) {
        const isInside = volumes.every((values) =>
          values.subarray(p, p + this.points).every((value) => value > 0 && value < Infinity),
        );
        if (!isInside) count++;
      }
    }
    return count;
  }

  /** Strain energy of the state in J; infinite if it has none. */
  energy(): number {
    let sum = 0;
    for (const { law, series, first } of this.blocks) {
      series.run(0, law.ends.length - 1);
      series.at(0, law.energy).forEach((w, p) => {
        sum += this.body.volumes[first * this.points + p] * w;
      });
    }
    return this.inverted() > 0 || Number.isNaN(sum) ? Infinity : sum;
  }

  /**
   * Write the matrices of all cells of the state, in N/m: rows and columns of displacements, then, if
   * cells share them, of θ and p. Those of a cell alone are condensed, as in `mean_dilation.py`:
   *
   *   K + (c vᵀ + v cᵀ) / V + s v vᵀ / V²
   */
  tangents(kind: Kind, write: (cell: number, k: Float64Array) => void): void {
    const { corners, points, size } = this;
    const { d, volumes, dilation } = this.body;
    const square = d * d;
    const width = dilation ? dilation.shapes[0].length : 0;
    const rows = size + 2 * width;
    const m = square + (width && kind !== "pointwise" ? 2 : 0); // inputs whose derivatives matter
    const k = new Float64Array(rows * rows);
    const condensed = new Float64Array(size * size);
    const local = new Float64Array(m * m);
    const turned = new Float64Array(m * rows);
    for (const { law, series, first, end } of this.blocks) {
      const moduli = this.moduli(law, series, kind, m);
      for (let cell = first; cell < end; cell++) {
        k.fill(0);
        for (let point = cell * points; point < (cell + 1) * points; point++) {
          const g = this.gradients.subarray(point * size, (point + 1) * size);
          const shape = dilation?.shapes[point % points] ?? [];
          for (let i = 0; i < m * m; i++)
            local[i] = volumes[point] * moduli[i * series.n + point - first * points];
          for (let y = 0; y < m; y++) {
            const at = y * rows;
            for (let a = 0; a < corners; a++) {
              for (let i = 0; i < d; i++) {
                let sum = 0;
                for (let j = 0; j < d; j++) sum += local[y * m + i * d + j] * g[a * d + j];
                turned[at + a * d + i] = sum;
              }
            }
            for (let row = size; row < rows && m > square; row++) {
              const x = square + (row < size + width ? 0 : 1);
              turned[at + row] = local[y * m + x] * shape[(row - size) % width];
            }
          }
          for (let a = 0; a < corners; a++) {
            for (let i = 0; i < d; i++) {
              const row = (a * d + i) * rows;
              for (let j = 0; j < d; j++) {
                const slope = g[a * d + j];
                const from = (i * d + j) * rows;
                for (let c = 0; c < (a + 1) * d; c++) k[row + c] += slope * turned[from + c];
              }
            }
          }
          for (let row = size; row < rows && m > square; row++) {
            const from = (square + (row < size + width ? 0 : 1)) * rows;
            const value = shape[(row - size) % width];
            for (let c = 0; c <= row; c++) k[row * rows + c] += value * turned[from + c];
          }
        }
        for (let row = 0; row < rows; row++)
          for (let c = row + 1; c < rows; c++) k[row * rows + c] = k[c * rows + row];
        if (!dilation || dilation.joined) {
          write(cell, k);
          continue;
        }
        const [c, v] = [k.subarray(size * rows), k.subarray((size + 1) * rows)];
        const [s, volume] = [c[size], m > square ? -v[size] : 1];
        for (let i = 0; i < size; i++) {
          for (let j = 0; j < size; j++)
            condensed[i * size + j] =
              k[i * rows + j] +
              (c[i] * v[j] + v[i] * c[j]) / volume +
              (s * v[i] * v[j]) / volume ** 2;
        }
        write(cell, condensed);
      }
    }
  }

  /** D of a block, (m, m, n), by F and, if m is larger, by θ and p. */
  private moduli(law: Law, series: Series, kind: Kind, m: number): Float64Array {
    const { n } = series;
    const square = this.body.d ** 2;
    const beside = law.inputs - 2; // the input θ
    const found = new Float64Array(m * m * n);
    const pressure = this.mass ? series.at(0, beside + 1).slice() : null;
    if (pressure && kind === "relaxed") series.at(0, beside + 1).fill(0);
    for (let x = 0; x < m; x++) {
      series.at(1, 0, false, law.inputs);
      series.at(1, x < square ? x : beside + x - square, true).fill(1);
      series.run(1, 0);
      if (this.mass) {
        if (kind === "pointwise") series.at(1, beside, true).set(series.at(1, law.volume));
        series.run(1, 1);
        if (kind === "pointwise") series.at(1, beside + 1, true).set(series.at(1, law.slope!));
        series.run(1, 2);
      }
      for (let y = 0; y < m; y++) found.set(series.at(1, law.outputs[y]), (y * m + x) * n);
    }
    if (pressure) series.at(0, beside + 1).set(pressure);
    return found;
  }

  /** Π of a slot into an input, counted from the end of the inputs. */
  private project(k: number, from: (law: Law) => number, input: number): void {
    const { profile, factor } = this.mass!;
    const { shapes, nodes } = this.body.dilation!;
    const { points } = this;
    const width = shapes[0].length;
    const sums = new Float64Array(profile.size);
    for (const { law, series, first } of this.blocks) {
      series.at(k, from(law)).forEach((value, p) => {
        const at = (first + Math.floor(p / points)) * width;
        const weighted = this.body.volumes[first * points + p] * value;
        for (let a = 0; a < width; a++) sums[nodes[at + a]] += shapes[p % points][a] * weighted;
      });
    }
    const solved = profile.solve(factor, sums);
    for (const { law, series, first } of this.blocks) {
      const values = series.at(k, law.inputs - input, true);
      for (let p = 0; p < series.n; p++) {
        const at = (first + Math.floor(p / points)) * width;
        values[p] = 0;
        for (let a = 0; a < width; a++) values[p] += shapes[p % points][a] * solved[nodes[at + a]];
      }
    }
  }

  /** Gradients of the shape functions, of those in the reference cell: ∂x/∂ξᵀ G = ∂N/∂ξ. */
  private cellGradients(): Float64Array {
    const { corners, points, size } = this;
    const { d, coordinates, cells, gradients } = this.body;
    const found = new Float64Array(this.cellCount * points * size);
    const [jacobian, right] = [new Float64Array(d * d), new Float64Array(size)];
    for (let point = 0; point < this.cellCount * points; point++) {
      const slopes = gradients[point % points];
      jacobian.fill(0);
      for (let a = 0; a < corners; a++) {
        const node = cells[Math.floor(point / points) * corners + a] * d;
        for (let j = 0; j < d; j++) {
          right[j * corners + a] = slopes[a * d + j];
          for (let i = 0; i < d; i++)
            jacobian[j * d + i] += slopes[a * d + j] * coordinates[node + i];
        }
      }
      solve(jacobian, right, corners)!.forEach((value, i) => {
        found[point * size + (i % corners) * d + Math.floor(i / corners)] = value;
      });
    }
    return found;
  }

  /** Cells of one law, with the directions of its fibres. */
  private block(first: number, end: number): Block {
    const { d, laws, parts, fibres, dilation } = this.body;
    const law = laws[parts[first]];
    const series = new Series(law, (end - first) * this.points);
    const count = law.inputs - d * d - (dilation ? 2 : 0);
    const stride = fibres ? fibres.length / this.cellCount : 0;
    series.at(0, d * d, true, count).forEach((_, place, directions) => {
      const cell = first + Math.floor((place % series.n) / this.points);
      directions[place] = fibres![cell * stride + Math.floor(place / series.n)];
    });
    return { law, first, end, series };
  }
}
