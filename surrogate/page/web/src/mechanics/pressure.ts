/**
 * Pressures that follow the surface, as `shared_schema/common/bodies/distributed_loads.py`: forces on
 * the points of every facet, which Python has recorded as functions of their positions.
 */

import type { Surfaces } from "./body";
import { Series } from "./recording";

export class Pressure {
  private readonly series: Series;
  private readonly components: Int32Array;
  private readonly sizes: number[];

  /**
   * @param coordinates - positions of all points at rest in m
   * @param pressures - of every surface in Pa
   */
  constructor(
    d: number,
    private readonly coordinates: Float64Array,
    { facet, facets, surfaces }: Surfaces,
    pressures: readonly number[],
  ) {
    this.series = new Series(facet, surfaces.length);
    this.sizes = Array.from(surfaces, (surface) => pressures[surface]);
    // input by input, as slots are
    this.components = new Int32Array(facet.inputs * surfaces.length).map((_, i) => {
      const [input, number] = [Math.floor(i / surfaces.length), i % surfaces.length];
      const point = facets[number * (facet.inputs / d) + Math.floor(input / d)];
      return point * d + (input % d);
    });
  }

  /** Forces in N on the body at displacements Σ sᵏ u_k in m, the first one of order 0; of the last order. */
  forces(...terms: readonly Float64Array[]): Float64Array {
    const { series, components, sizes } = this;
    const { inputs, outputs } = series.recording;
    terms.forEach((u, k) => {
      series
        .at(k, 0, true, inputs)
        .forEach(
          (_, i, to) =>
            (to[i] = u[components[i]] + (k === 0 ? this.coordinates[components[i]] : 0)),
        );
      series.run(k, 0);
    });
    const found = new Float64Array(this.coordinates.length);
    outputs.forEach((slot, output) => {
      series
        .at(terms.length - 1, slot)
        .forEach(
          (force, facet) =>
            (found[components[output * sizes.length + facet]] += sizes[facet] * force),
        );
    });
    return found;
  }

  /** What the forces add to the tangent, −∂f/∂u: numbers of components, and a matrix of every facet. */
  tangents(u: Float64Array, use: (components: Int32Array, k: Float64Array) => void): void {
    const { series, components, sizes } = this;
    const { inputs, outputs } = series.recording;
    this.forces(u);
    const blocks = sizes.map(() => new Float64Array(inputs * inputs));
    for (let column = 0; column < inputs; column++) {
      series.at(1, 0, false, inputs);
      series.at(1, column, true).fill(1);
      series.run(1, 0);
      outputs.forEach((slot, row) => {
        series
          .at(1, slot)
          .forEach(
            (change, facet) => (blocks[facet][row * inputs + column] = -sizes[facet] * change),
          );
      });
    }
    blocks.forEach((k, facet) => {
      if (sizes[facet] !== 0)
        use(
          components.filter((_, i) => i % sizes.length === facet),
          k,
        );
    });
  }
}
