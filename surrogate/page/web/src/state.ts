/** What the page shows at a moment: loads, predicted fields, the estimate of their error. */

import type { FieldName } from "./colours";
import type { Content } from "./content";
import { Loads, type Load } from "./loads";
import type { Certificate } from "./mechanics/certificate";
import type { Target } from "./mechanics/reach";
import type { Actuated } from "./mechanics/worker";
import { at, largest, lengths, norm } from "./mechanics/vectors";
import type { Fields } from "./network";
import type { Sphere } from "./touch/sphere";
import { exceeded, isBeyond, type Kind } from "./training_range";

const LARGE = 0.1; // of the displacement: an estimated error after which the prediction is wrong

/** What a drag on the body does: set a force, take hold, push with the sphere, set a target of the actuators. */
export type Gesture = "force" | "hold" | "push" | "reach";

/** A sphere on its way. */
export interface Tool extends Sphere {
  /** Where its centre shall be, d components in m. */
  wanted: number[];
}

export class State {
  readonly loads: Loads;
  /** Outputs of the network; null for a body at rest. */
  fields: Fields | null = null;
  /** What the actuators do there; null on a body without. */
  actuated: Actuated | null = null;
  /** Where they shall bring a node. */
  target: Target | null = null;
  /** Estimate of the error of `fields`; null while there is none. */
  certificate: Certificate | null = null;
  field: FieldName = "displacement";
  gesture: Gesture = "force";
  tool: Tool | null = null;
  /** Radius in m of a sphere that is put on the body. */
  radius: number;
  /** Young's modulus over that of the training. */
  stiffness = 1;
  /**
   * Whether the body moves over time, and since when in s; seconds of it in one of the clock; how far a
   * point goes in a step in m; damping ratio of the first vibration.
   */
  readonly motion = { isOn: false, time: 0, pace: 1, way: 0, damping: 0 };
  /** Node under the pointer, or under the keyboard's cursor. */
  node: number | null = null;

  constructor(readonly content: Content) {
    this.loads = new Loads(content);
    this.radius = content.radius;
    this.motion.damping = content.body?.motion?.damping ?? 0;
  }

  /** Colour fields that this page can show. */
  get choices(): FieldName[] {
    const kinds = Object.values(this.content.deviations);
    return ["displacement", ...kinds, ...(this.content.certified ? (["error"] as const) : [])];
  }

  /** Young's modulus in Pa; over that of the training, where this is unknown. */
  get modulus(): number {
    return (this.content.youngModulus ?? 1) * this.stiffness;
  }

  set modulus(modulus: number) {
    if (modulus > 0) this.stiffness = modulus / (this.content.youngModulus ?? 1);
  }

  /** Be stiffer than in the training by some decades. */
  stiffen(decades: number): void {
    const modulus = (this.content.youngModulus ?? 1) * 10 ** decades;
    this.modulus = decades === 0 ? modulus : Number(modulus.toPrecision(4));
  }

  /** Take the sphere away; the next one has another radius in m. */
  resize(radius: number): void {
    if (radius > 0) this.radius = radius;
    this.put(null);
  }

  get isLoaded(): boolean {
    return this.loads.parts().length > 0 || this.loads.isActuated || this.target !== null;
  }

  /** Put a tool on the body, where it bears no force yet, or take it away. */
  put(tool: Tool | null): void {
    this.tool = tool;
    this.loads.contacts = [];
  }

  /** Let nothing act. */
  unload(): void {
    this.loads.clear();
    this.put(null);
    this.target = null;
  }

  /** Resultant in N of the forces of the tool on the body, d components. */
  reaction(): number[] {
    const { contacts } = this.loads;
    return this.content.largest.map((_, i) =>
      contacts.reduce((sum, { force }) => sum + force[i], 0),
    );
  }

  get displacement(): Float32Array | null {
    return this.fields?.displacement ?? null;
  }

  /** Displacement of a node in m, d components. */
  displacementAt(node: number): number[] {
    return this.vectorAt("displacement", node) ?? this.content.largest.map(() => 0);
  }

  /** Nodal vectors behind a colour field; null while there are none. */
  vectors(name: FieldName): Float32Array | Float64Array | null {
    if (name === "displacement") return this.displacement;
    if (name === "error") return this.certificate?.error ?? null;
    const output = Object.entries(this.content.deviations).find(([, kind]) => kind === name);
    return (output && this.fields?.[output[0]]) ?? null;
  }

  /** That of a node in m. */
  vectorAt(name: FieldName, node: number): number[] | null {
    const vectors = this.vectors(name);
    return vectors && [...at(vectors, node, this.content.d)];
  }

  /** Lengths of the vectors of the chosen colour field in m, (nodes,). */
  values(): Float64Array | null {
    const vectors = this.vectors(this.field);
    return vectors && lengths(vectors, this.content.d);
  }

  /** Standard deviation in m of the displacement of a node along its direction; null without one. */
  deviationAlong(node: number): number | null {
    const kinds = Object.values(this.content.deviations);
    const u = this.displacementAt(node);
    const parts = kinds.flatMap((kind) =>
      (this.vectorAt(kind, node) ?? []).map((deviation, i) => u[i] * deviation),
    );
    return kinds.length > 0 ? norm(parts) / (norm(u) || 1) : null;
  }

  /** Largest estimated error in m, and its share of the largest displacement; null without one. */
  get estimate(): { most: number; share: number; isBad: boolean } | null {
    const { certificate, displacement, content } = this;
    if (!certificate?.error || !displacement) return null;
    const most = largest(lengths(certificate.error, content.d));
    const share = most / (largest(lengths(displacement, content.d)) || 1);
    return { most, share, isBad: !certificate.settled || share > LARGE };
  }

  /** How the loads leave the training data, as those under which its body moves as this one does. */
  warnings(): Map<Kind, string> {
    const { trained } = this.content;
    const forces = this.loads.nodal().map((force) => force / this.stiffness);
    return trained && !this.motion.isOn ? exceeded(forces, trained) : new Map<Kind, string>();
  }

  /** Whether a load is larger than those of the training, or elsewhere, and no estimate allays it. */
  isDoubtful({ key, force }: Load): boolean {
    const { trained } = this.content;
    if (!trained || (!isBeyond(force, trained.largest) && trained.loadable[key])) return false;
    return this.estimate?.isBad !== false;
  }
}
