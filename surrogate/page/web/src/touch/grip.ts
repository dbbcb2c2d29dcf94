/** Places that are held, as `Held` of `surrogate/mechanics/touch/condition.py`: f ← f + C⁻¹ (ū − u). */

import type { Load } from "../loads";
import { largest, plus, solve } from "../mechanics/vectors";
import type { State } from "../state";
import type { LinearBody } from "./linear_body";
import type { Condition, Found } from "./search";

const STRIDE = 0.25; // over the body's size
const SHORT = 0.02; // the same, in a time step

export class Grip implements Condition {
  readonly stride: number;
  at: number[];
  /** Components of the nodes, one node after the other. */
  private readonly dofs: readonly number[];

  constructor(
    private readonly state: State,
    readonly parts: readonly Load[],
  ) {
    const { d } = state.content;
    this.dofs = parts.flatMap(({ key, force }) => force.map((_, i) => key * d + i));
    this.stride = (state.motion.isOn ? SHORT : STRIDE) * state.content.extent;
    this.at = parts.flatMap(({ key }) => state.displacementAt(key));
  }

  get wanted(): number[] {
    return this.parts.flatMap((load) => load.held!);
  }

  wrong(u: Float64Array): number {
    return largest(this.left(u));
  }

  size(u: Float64Array): number {
    return Math.max(largest(this.at), largest(this.dofs.map((dof) => u[dof])));
  }

  forces(body: LinearBody, u: Float64Array, force: Float64Array): Found {
    const n = this.dofs.length;
    const compliance = body.compliance(this.dofs, [...this.parts.keys()]);
    if (!compliance) return "missing";
    this.dofs.forEach((dof, row) => {
      if (!this.state.content.held[dof]) return;
      compliance.fill(0, row * n, (row + 1) * n)[row * n + row] = 1; // borne by a support
    });
    const change = solve(compliance, this.left(u));
    return change ? plus(force, change) : "none";
  }

  /** Displacement in m that is left, of components that supports leave free. */
  private left(u: Float64Array): Float64Array {
    const { held } = this.state.content;
    return Float64Array.from(this.dofs, (dof, i) => (held[dof] ? 0 : this.at[i] - u[dof]));
  }
}
