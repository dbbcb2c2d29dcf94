/**
 * Loads that follow the body, of one amplitude each, as `shared_schema/common/bodies/following_loads.py`:
 * pressures on surfaces, tensions of cables, with unit forces g = ± ∂q/∂x of a volume or a length q.
 */

import type { Body, Cables, Rows, Surfaces } from "./body";
import { Series } from "./recording";
import { add, at, dot, gathered, norm, plus } from "./vectors";

/** Take a matrix of some components. */
type Use = (components: Int32Array, k: Float64Array) => void;

export interface FollowingLoad {
  /** That of g = ± ∂q/∂x. */
  readonly sign: number;
  /** Components of the points that bear it, some of them repeatedly. */
  readonly components: Int32Array;
  /** g at displacements Σ sᵏ u_k in m, the first one of order 0; of the last order. */
  forces: (...terms: readonly Float64Array[]) => Float64Array;
  /** q in m or m³. */
  quantity: (u: Float64Array) => number;
  /** −∂g/∂u, facet by facet; none of a load that joins points of different cells. */
  tangents?: (u: Float64Array, use: Use) => void;
}

/** What acts, if nothing else is asked. */
export type Acting = Pick<FollowingLoad, "forces" | "tangents">;

/** A unit pressure: forces on the points of every facet, which Python has recorded. */
class Pressure implements FollowingLoad {
  readonly sign = 1;
  readonly components: Int32Array;
  private readonly series: Series;
  /** The displacement whose order 0 is there; no one changes it. */
  private done: Float64Array | null = null;

  constructor(
    private readonly d: number,
    private readonly coordinates: Float64Array,
    facet: Surfaces["facet"],
    facets: Int32Array,
  ) {
    const points = facet.inputs / d;
    const count = facets.length / points;
    this.series = new Series(facet, count);
    // input by input, as slots are
    this.components = new Int32Array(facet.inputs * count).map((_, i) => {
      const [input, number] = [Math.floor(i / count), i % count];
      return facets[number * points + Math.floor(input / d)] * d + (input % d);
    });
  }

  forces(...terms: readonly Float64Array[]): Float64Array {
    const { series, components } = this;
    const { inputs, outputs } = series.recording;
    terms.forEach((u, k) => {
      if (k === 0 && u === this.done) return;
      series
        .at(k, 0, true, inputs)
        .forEach(
          (_, i, to) =>
            (to[i] = u[components[i]] + (k === 0 ? this.coordinates[components[i]] : 0)),
        );
      series.run(k, 0);
    });
    this.done = terms[0];
    const found = new Float64Array(this.coordinates.length);
    outputs.forEach((slot, output) => {
      series
        .at(terms.length - 1, slot)
        .forEach((force, facet) => (found[components[output * series.n + facet]] += force));
    });
    return found;
  }

  quantity(u: Float64Array): number {
    return dot(plus(this.coordinates, u), this.forces(u)) / this.d;
  }

  tangents(u: Float64Array, use: Use): void {
    const { series, components } = this;
    const { inputs, outputs } = series.recording;
    this.forces(u);
    const blocks = Array.from({ length: series.n }, () => new Float64Array(inputs * inputs));
    for (let column = 0; column < inputs; column++) {
      series.at(1, 0, false, inputs);
      series.at(1, column, true).fill(1);
      series.run(1, 0);
      outputs.forEach((slot, row) => {
        series
          .at(1, slot)
          .forEach((change, facet) => (blocks[facet][row * inputs + column] = -change));
      });
    }
    blocks.forEach((k, facet) => {
      const own = components.filter((_, i) => i % series.n === facet);
      use(own, k);
    });
  }
}

/** A cable of unit tension, as `shared_schema/common/bodies/cables.py`; to the first order. */
class Cable implements FollowingLoad {
  readonly sign = -1;
  readonly components: Int32Array;
  /** Legs of the body at rest, from each place to the next one, in m. */
  private readonly rest: Float64Array[];

  constructor(
    private readonly d: number,
    coordinates: Float64Array,
    private readonly places: Rows,
    fixed: Float64Array,
  ) {
    this.rest = this.between(placesOf({ places, fixed }, coordinates, d));
    const [first, end] = [places.starts[0], places.starts.at(-1)!];
    this.components = this.of(places.nodes.subarray(first, end));
  }

  forces(u: Float64Array, change?: Float64Array): Float64Array {
    const { starts, nodes, weights } = this.places;
    const found = new Float64Array(u.length);
    const ways = change && this.moved(change);
    this.legs(u).forEach((e, leg) => {
      const length = norm(e);
      const n = e.map((value) => value / length);
      const way = ways?.[leg];
      const along = way ? plus(way, n, -dot(way, n)).map((value) => value / length) : n;
      for (let i = starts[leg]; i < starts[leg + 2]; i++)
        add(at(found, nodes[i], this.d), along, i < starts[leg + 1] ? weights[i] : -weights[i]);
    });
    return found;
  }

  quantity(u: Float64Array): number {
    return this.legs(u).reduce((sum, e) => sum + norm(e), 0);
  }

  private legs(u: Float64Array): Float64Array[] {
    return this.moved(u).map((change, leg) => plus(this.rest[leg], change));
  }

  /** How displacements move the legs. */
  private moved(u: Float64Array): Float64Array[] {
    return this.between(gathered(this.places, u, this.d));
  }

  private between(y: Float64Array): Float64Array[] {
    const { d } = this;
    const count = y.length / d - 1;
    return Array.from({ length: count }, (_, i) => plus(at(y, i + 1, d), at(y, i, d), -1));
  }

  private of(nodes: Int32Array): Int32Array {
    return new Int32Array(nodes.length * this.d).map(
      (_, i) => nodes[Math.floor(i / this.d)] * this.d + (i % this.d),
    );
  }
}

/** Where the places of cables are in m, (places · d), of the positions of all points. */
export function placesOf(
  { places, fixed }: Pick<Cables, "places" | "fixed">,
  x: Float64Array,
  d: number,
): Float64Array {
  return plus(gathered(places, x, d), fixed);
}

/** All of a body, of unit amplitude, in the order of their numbers. */
export function followingLoads({ d, coordinates, surfaces, cables }: Body): FollowingLoad[] {
  const found: FollowingLoad[] = [];
  for (const number of new Set(surfaces?.units)) {
    const { facet, facets, units } = surfaces!;
    const points = facets.length / units.length;
    const own = facets.filter((_, i) => units[Math.floor(i / points)] === number);
    found[number] = new Pressure(d, coordinates, facet, own);
  }
  for (const number of new Set(cables?.units)) {
    const { places, fixed, units } = cables!;
    const [first, end] = [units.indexOf(number), units.lastIndexOf(number) + 1];
    const rows = { ...places, starts: places.starts.subarray(first, end + 1) };
    found[number] = new Cable(d, coordinates, rows, fixed.subarray(first * d, end * d));
  }
  return found;
}

/** Some of them under amplitudes in Pa or N. */
export class Following {
  constructor(
    private readonly loads: readonly Acting[],
    private readonly amplitudes: readonly number[],
  ) {}

  /** Forces in N on the body at displacements Σ sᵏ u_k in m; of the last order. */
  forces(...terms: readonly Float64Array[]): Float64Array {
    const sum = new Float64Array(terms[0].length);
    this.each((load, amplitude) => add(sum, load.forces(...terms), amplitude));
    return sum;
  }

  /** What the forces add to the tangent, −∂f/∂u, facet by facet; cables are left out. */
  tangents(u: Float64Array, use: Use): void {
    this.each((load, a) =>
      load.tangents?.(u, (components, k) =>
        use(
          components,
          k.map((value) => a * value),
        ),
      ),
    );
  }

  /** What cables add to it, times a change of u. */
  ofCables(u: Float64Array, change: Float64Array): Float64Array {
    const sum = new Float64Array(u.length);
    this.each((load, a) => {
      if (!load.tangents) add(sum, load.forces(u, change), -a);
    });
    return sum;
  }

  private each(act: (load: Acting, amplitude: number) => void): void {
    this.loads.forEach((load, i) => {
      if (this.amplitudes[i]) act(load, this.amplitudes[i]);
    });
  }
}
