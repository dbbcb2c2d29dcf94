/** The loads on the body: forces at nodes, at most one a node. */

export interface Load {
  readonly node: number;
  /** d components in N. */
  force: number[];
}

export class Loads {
  readonly all: Load[] = [];
  selected: Load | null = null;

  constructor(private readonly d: number) {}

  /** The load at a node, added if there is none; it becomes the selected one. */
  at(node: number): Load {
    let load = this.all.find((other) => other.node === node);
    if (!load) {
      load = { node, force: new Array<number>(this.d).fill(0) };
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
    this.selected = null;
  }

  /** Nodal forces in N, (nodes · d). */
  nodal(nodes: number): Float64Array {
    const force = new Float64Array(nodes * this.d);
    for (const load of this.all) force.set(load.force, load.node * this.d);
    return force;
  }
}

export function size(vector: readonly number[]): number {
  return Math.hypot(...vector);
}

/** The command that predicts the same. */
export function predictCommand(
  run: string,
  loads: readonly Load[],
  coordinates: Float64Array,
  d: number,
  passes: number | null,
  tolerance: number | null,
): string {
  const words = ["surrogate", "predict", quoted(run)];
  for (const { node, force } of loads) {
    const place = Array.from(coordinates.subarray(node * d, (node + 1) * d));
    words.push(`--load="${place.join(",")}:${force.join(",")}"`);
  }
  if (passes !== null) words.push(`--passes ${passes}`);
  if (tolerance !== null) words.push(`--tolerance ${tolerance}`);
  return [...words, "--out prediction.npz"].join(" ");
}

/** A word as a shell reads it. */
function quoted(word: string): string {
  return /^[\w./@%+=:,-]+$/.test(word) ? word : `'${word.replaceAll("'", "'\\''")}'`;
}
