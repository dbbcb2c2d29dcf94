/** The loads on the body: forces at nodes or on patches about them, a body force, pressures. */

import type { Content } from "./content";
import type { Loading } from "./mechanics/body";
import { add } from "./mechanics/vectors";

/** In place of a node, for the body force. */
export const BODY = -1;

/** A force on something: on a node, or what is about it, or `BODY`; below that, on a node alone. */
export interface Part {
  readonly key: number;
  /** d components: in N, of the body force in N/m³; the size in Pa of a pressure. */
  force: number[];
}

export interface Load extends Part {
  /** Displacement in m at which the node is held, by a force that is sought; null for a given force. */
  held: number[] | null;
}

/** What loads act on. */
type LoadedBody = Pick<
  Content,
  "nodes" | "d" | "held" | "patches" | "volumes" | "pressed" | "pushes" | "actuation"
>;

export class Loads {
  /** Forces at nodes or about them, at most one a node. */
  readonly all: Load[] = [];
  readonly body: Load;
  /** Forces of the tool in N, on all nodes that it may touch. */
  contacts: Part[] = [];
  /** Pressures on the surfaces in Pa. */
  readonly pressures: number[];
  /** What is given of the actuators. */
  readonly given: number[];
  selected: Load | null = null;

  constructor(private readonly on: LoadedBody) {
    this.pressures = on.pressed.map(() => 0);
    this.given = this.atRest();
    this.body = this.none(BODY);
  }

  /** The load at a node, added if there is none; it becomes the selected one. */
  at(node: number): Load {
    let load = this.all.find((other) => other.key === node);
    if (!load) this.all.push((load = this.none(node)));
    this.selected = load;
    return load;
  }

  remove(load: Load): void {
    this.all.splice(0, this.all.length, ...this.all.filter((other) => other !== load));
    if (this.selected === load) this.selected = this.all.at(-1) ?? null;
  }

  clear(): void {
    this.all.length = 0;
    this.body.force.fill(0);
    this.pressures.fill(0);
    this.given.splice(0, Infinity, ...this.atRest());
    this.selected = null;
  }

  /** Whether actuators do something. */
  get isActuated(): boolean {
    return this.atRest().some((value, i) => value !== this.given[i]);
  }

  /** All that keeps its direction. */
  dead(): Part[] {
    return [...this.all, this.body, ...this.contacts].filter(({ force }) => force.some(Boolean));
  }

  /** All that acts, the tool and pressures, as on the undeformed body, among it. */
  parts(): Part[] {
    const pressed = this.pressures.map((pressure, i) => ({ key: this.push(i), force: [pressure] }));
    return [...this.dead(), ...pressed.filter(({ force }) => force[0] !== 0)];
  }

  /** What a force on a node alone acts on. */
  alone(node: number): number {
    return this.on.patches ? BODY - 1 - node : node;
  }

  /** Nodal forces in N, (nodes · d), of some loads, by default all. */
  nodal(parts: readonly Part[] = this.parts()): Float64Array {
    const sum = new Float64Array(this.on.nodes * this.on.d);
    for (const { key, force } of parts) {
      const first = (this.push(0) - key) * sum.length;
      if (first >= 0) add(sum, this.on.pushes!.subarray(first, first + sum.length), force[0]);
      else this.reach(key, (dof, i, weight) => (sum[dof] += weight * force[i]));
    }
    return sum;
  }

  /** The loads in a solver's terms, on a body that is softer by a factor. */
  loading(stiffness: number): Loading {
    const force = this.nodal(this.dead()).map((value) => value / stiffness);
    return { force, pressures: this.pressures.map((pressure) => pressure / stiffness) };
  }

  /** The unit components of a load. */
  units(key: number): Part[] {
    const components = key <= this.push(0) ? 1 : this.on.d;
    return Array.from({ length: components }, (_, component) => ({
      key,
      force: Array.from({ length: components }, (_, i) => Number(i === component)),
    }));
  }

  /** Displacement along the unit components of a load: its work in a field, (nodes · d). */
  along(key: number, field: Float64Array): number[] {
    const sum = new Array<number>(this.on.d).fill(0);
    this.reach(key, (dof, i, weight) => (sum[i] += weight * field[dof]));
    return sum;
  }

  private atRest(): number[] {
    return this.on.actuation?.sliders.map(({ rest }) => rest) ?? [];
  }

  private none(key: number): Load {
    return { key, force: new Array<number>(this.on.d).fill(0), held: null };
  }

  /** What the pressure on a surface acts on. */
  private push(surface: number): number {
    return BODY - 1 - this.on.nodes - surface;
  }

  /** Free components of the nodes that a load reaches, with their axes and weights. */
  private reach(key: number, use: (dof: number, axis: number, weight: number) => void): void {
    const { nodes, d, held, patches, volumes } = this.on;
    const reached = (node: number, weight: number): void => {
      for (let i = 0; i < d; i++) if (!held[node * d + i]) use(node * d + i, i, weight);
    };
    if (key < BODY) reached(BODY - 1 - key, 1);
    else if (key === BODY) for (let node = 0; node < nodes; node++) reached(node, volumes![node]);
    else if (!patches) reached(key, 1);
    else
      for (let i = patches.starts[key]; i < patches.starts[key + 1]; i++)
        reached(patches.nodes[i], patches.weights[i]);
  }
}
