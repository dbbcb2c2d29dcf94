/** The loads on the body: forces at nodes or on patches about them, and a body force. */

import type { Rows } from "./mechanics/messages";
import type { Sphere } from "./touch/sphere";

/** In place of a node, for the body force. */
export const BODY = -1;

export interface Load {
  readonly node: number;
  /** d components: in N, of the body force in N/m³. */
  force: number[];
  /** Displacement in m at which the node is held, by a force that is sought; null for a given force. */
  held: number[] | null;
}

/** Force of a tool on a node in N. */
export interface Contact {
  readonly node: number;
  readonly force: number[];
}

/** A load by what it acts on: a node, what is about it, or `BODY`; below that, a node alone. */
export interface Part {
  key: number;
  force: readonly number[];
}

/** What loads act on. */
export interface LoadedBody {
  nodes: number;
  d: number;
  /** (nodes, d), components that supports hold; they bear what would act on them. */
  held: Uint8Array;
  /** Nodes, with weights, that a force about a node reaches; null for forces on nodes. */
  patches?: Rows;
  /** What of the body belongs to each node, in m³. */
  volumes?: Float64Array;
  /** Surfaces that pressures follow, and forces in N of 1 Pa on each of them, (nodes · d) each. */
  pressed: readonly string[];
  pushes?: Float64Array;
}

export class Loads {
  /** Forces at nodes or about them, at most one a node. */
  readonly all: Load[] = [];
  readonly body: Load;
  /** Forces of the tool. */
  contacts: Contact[] = [];
  /** Pressures on the surfaces in Pa. */
  readonly pressures: number[];
  selected: Load | null = null;

  constructor(private readonly on: LoadedBody) {
    this.pressures = on.pressed.map(() => 0);
    this.body = { node: BODY, force: new Array<number>(on.d).fill(0), held: null };
  }

  /** The loads that are not zero, the body force among them. */
  get acting(): Load[] {
    return [...this.all, this.body].filter((load) => size(load.force) > 0);
  }

  /** The load at a node, added if there is none; it becomes the selected one. */
  at(node: number): Load {
    let load = this.all.find((other) => other.node === node);
    if (!load) {
      load = { node, force: new Array<number>(this.on.d).fill(0), held: null };
      this.all.push(load);
    }
    this.selected = load;
    return load;
  }

  remove(load: Load): void {
    const place = this.all.indexOf(load);
    if (place >= 0) this.all.splice(place, 1);
    if (this.selected === load) this.selected = this.all.at(-1) ?? null;
  }

  clear(): void {
    this.all.length = 0;
    this.body.force.fill(0);
    this.pressures.fill(0);
    this.selected = null;
  }

  /** All that acts, the tool and pressures, as on the undeformed body, among it. */
  parts(): Part[] {
    const pressures = this.pressures.map((pressure, i) => ({
      key: this.push(i),
      force: [pressure],
    }));
    return [...this.dead(), ...pressures.filter(({ force }) => force[0] !== 0)];
  }

  /** All that keeps its direction. */
  private dead(): Part[] {
    return [
      ...this.acting.map(({ node, force }) => ({ key: node, force })),
      ...this.contacts.map(({ node, force }) => ({ key: this.alone(node), force })),
    ];
  }

  /** What a force on a node alone acts on. */
  alone(node: number): number {
    return this.on.patches ? BODY - 1 - node : node;
  }

  /** What the pressure on a surface acts on. */
  private push(surface: number): number {
    return BODY - 1 - this.on.nodes - surface;
  }

  /** Nodal forces in N, (nodes · d), with those of pressures on the undeformed body or without. */
  nodal(withPressures = true): Float64Array {
    const force = new Float64Array(this.on.nodes * this.on.d);
    for (const part of withPressures ? this.parts() : this.dead()) this.add(part, force);
    return force;
  }

  /** Sizes of unit loads: of the body force, if the body has one, and about some places. */
  sizes(places: readonly number[]): Float32Array {
    const { d, volumes } = this.on;
    const known = volumes ? [BODY, ...places] : places;
    const found = new Float32Array(known.length * d);
    for (const { node, force } of this.acting) found.set(force, known.indexOf(node) * d);
    return found;
  }

  /** Nodal forces in N of the unit components of a load. */
  units(key: number): Float64Array[] {
    const { nodes, d } = this.on;
    const components = key <= this.push(0) ? 1 : d;
    return Array.from({ length: components }, (_, component) => {
      const force = new Float64Array(nodes * d);
      const unit = Array.from({ length: components }, (_, i) => Number(i === component));
      this.add({ key, force: unit }, force);
      return force;
    });
  }

  /** Add the nodal forces of a load. */
  private add({ key, force }: Part, sum: Float64Array): void {
    const { nodes, patches, volumes, pushes } = this.on;
    if (key <= this.push(0)) {
      const first = (this.push(0) - key) * sum.length;
      for (let i = 0; i < sum.length; i++) sum[i] += force[0] * pushes![first + i];
    } else if (key === BODY) {
      for (let other = 0; other < nodes; other++) this.addAt(other, volumes![other], force, sum);
    } else if (key < BODY) {
      this.addAt(BODY - 1 - key, 1, force, sum);
    } else if (patches) {
      for (let i = patches.starts[key]; i < patches.starts[key + 1]; i++) {
        this.addAt(patches.nodes[i], patches.weights[i], force, sum);
      }
    } else {
      this.addAt(key, 1, force, sum);
    }
  }

  private addAt(node: number, weight: number, force: readonly number[], sum: Float64Array): void {
    const { d, held } = this.on;
    for (let i = 0; i < d; i++) {
      if (!held[node * d + i]) sum[node * d + i] += weight * force[i];
    }
  }
}

export function size(vector: readonly number[]): number {
  return Math.hypot(...vector);
}

/** What a command says beside the loads. */
export interface Beside {
  tool: Sphere | null;
  /** Young's modulus in Pa; null for that of the training. */
  modulus: number | null;
  tolerance: number | null;
}

/** The command that predicts the same. */
export function predictCommand(
  run: string,
  loads: Loads,
  {
    coordinates,
    d,
    patch,
    passes,
    pressed,
  }: {
    coordinates: Float64Array;
    d: number;
    patch: number;
    passes: number | null;
    pressed: readonly string[];
  },
  { tool, modulus, tolerance }: Beside,
): string {
  const words = ["surrogate", "predict", quoted(run)];
  for (const { node, force } of loads.all) {
    const place = Array.from(coordinates.subarray(node * d, (node + 1) * d));
    if (patch > 0) place.push(patch);
    words.push(`--load="${place.join(",")}:${force.join(",")}"`);
  }
  loads.pressures.forEach((pressure, i) => {
    if (pressure !== 0) words.push(`--load=${quoted(`${pressed[i]}:${pressure}`)}`);
  });
  if (size(loads.body.force) > 0) words.push(`--body-force="${loads.body.force.join(",")}"`);
  if (tool) words.push(`--tool="sphere:${tool.centre.join(",")}:${tool.radius}"`);
  if (modulus !== null) words.push(`--young-modulus ${modulus}`);
  if (passes !== null) words.push(`--passes ${passes}`);
  if (tolerance !== null) words.push(`--tolerance ${tolerance}`);
  return [...words, "--out prediction.npz"].join(" ");
}

/** A word as a shell reads it. */
function quoted(word: string): string {
  return /^[\w./@%+=:,-]+$/.test(word) ? word : `'${word.replaceAll("'", "'\\''")}'`;
}
