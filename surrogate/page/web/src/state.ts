/** What the page shows at a moment: loads, predicted fields, the estimate of their error. */

import type { FieldName } from "./colours";
import type { Content } from "./content";
import { Loads, size } from "./loads";
import type { Certificate } from "./mechanics/certificate";
import type { Loading } from "./mechanics/messages";
import { lengths } from "./mechanics/vectors";
import type { Fields } from "./network";
import type { Sphere } from "./touch/sphere";
import { exceeded, type Kind } from "./training_range";

/** What a drag on the body does: set a force, take hold of the body, push it with the sphere. */
export type Gesture = "force" | "hold" | "push";

/** A sphere on its way. */
export interface Tool extends Sphere {
  /** Where its centre shall be, d components in m. */
  wanted: number[];
}

export class State {
  readonly loads: Loads;
  /** Outputs of the network; null for a body at rest. */
  fields: Fields | null = null;
  /** Estimate of the error of `fields`; null while there is none. */
  certificate: Certificate | null = null;
  field: FieldName = "displacement";
  gesture: Gesture = "force";
  tool: Tool | null = null;
  /** Radius in m of a sphere that is put on the body. */
  radius: number;
  /** Young's modulus over that of the training. */
  stiffness = 1;
  /** Node under the pointer, or under the keyboard's cursor. */
  node: number | null = null;

  constructor(readonly content: Content) {
    this.loads = new Loads(content);
    this.radius = content.radius;
  }

  /** Colour fields that this page can show. */
  get choices(): FieldName[] {
    const kinds = Object.values(this.content.deviations);
    return ["displacement", ...kinds, ...(this.content.certified ? (["error"] as const) : [])];
  }

  get isLoaded(): boolean {
    return this.loads.parts().length > 0;
  }

  /** Put a tool on the body, where it bears no force yet, or take it away. */
  put(tool: Tool | null): void {
    this.tool = tool;
    this.loads.contacts = [];
  }

  /** Resultant in N of the forces of the tool on the body, d components. */
  reaction(): number[] {
    const { contacts } = this.loads;
    return Array.from({ length: this.content.d }, (_, i) =>
      contacts.reduce((sum, { force }) => sum + force[i], 0),
    );
  }

  /** Nodal forces in N under which the body of the training moves as this one does. */
  equivalent(): Float64Array {
    return this.loads.nodal().map((force) => force / this.stiffness);
  }

  /** The loads under which the body of the training moves as this one does. */
  loading(): Loading {
    const force = this.loads.nodal(false).map((value) => value / this.stiffness);
    return { force, pressures: this.loads.pressures.map((value) => value / this.stiffness) };
  }

  get displacement(): Float32Array | null {
    return this.fields?.displacement ?? null;
  }

  /** Displacement of a node in m, d components. */
  displacementAt(node: number): number[] {
    const { d } = this.content;
    const u = this.displacement;
    return u ? Array.from(u.subarray(node * d, node * d + d)) : new Array<number>(d).fill(0);
  }

  /** Nodal vectors behind a colour field; null while there are none. */
  vectors(name: FieldName): ArrayLike<number> | null {
    if (name === "displacement") return this.displacement;
    if (name === "error") return this.certificate?.error ?? null;
    const output = Object.entries(this.content.deviations).find(([, kind]) => kind === name);
    return (output && this.fields?.[output[0]]) ?? null;
  }

  /** Lengths of the vectors of the chosen colour field in m, (nodes,). */
  values(): Float64Array | null {
    const vectors = this.vectors(this.field);
    return vectors && lengths(vectors, this.content.d);
  }

  /** Standard deviation in m of the displacement of a node along its direction; null without one. */
  deviationAlong(node: number): number | null {
    const { d, deviations } = this.content;
    const u = this.displacementAt(node);
    const outputs = Object.keys(deviations).map((name) => this.fields?.[name]);
    if (outputs.length === 0) return null;
    const length = size(u) || 1;
    let variance = 0;
    for (const output of outputs) {
      for (let i = 0; i < d; i++)
        variance += ((u[i] / length) * (output?.[node * d + i] ?? 0)) ** 2;
    }
    return Math.sqrt(variance);
  }

  /** How the loads leave the training data. */
  warnings(): Map<Kind, string> {
    return exceeded(this.equivalent(), this.content.trained);
  }
}
