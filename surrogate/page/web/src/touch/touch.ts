/**
 * A sphere that pushes the body: its forces, sought as in `surrogate/mechanics/touch/touch.py`, a prediction a
 * frame. The sphere goes to where it shall be in steps that the body can follow.
 */

import type { Contact } from "../loads";
import type { State, Tool } from "../state";
import { LinearBody, type Columns } from "./linear_body";
import { linearContact } from "./linear_contact";
import type { Outcome } from "./outcome";
import { near } from "./sphere";

const TOLERANCE = 1e-4; // depth, or distance of nodes that bear forces, over the largest displacement
const REST = 1e-7; // over the body's size: depth that will do
const LARGER = 2; // of depths and distances that a full step may leave
const SHORTEST = 1 / 8; // part of a step
const STRIDE = 0.25; // of the radius, that the sphere moves at once
const SMALLEST = 1 / 128; // of the radius
const MOST = 30; // predictions without getting there

export class Touch {
  private readonly body: LinearBody;
  private tool: Tool | null = null;
  private stride = STRIDE;
  private left = MOST;
  /** Forces and positions at which the sphere could be last. */
  private good: { centre: number[]; force: Float64Array } | null = null;
  private last: {
    beside: string;
    wrong: number;
    part: number;
    force: Float64Array;
    wanted: Float64Array;
    u: Float64Array;
  } | null = null;

  /**
   * @param surface - nodes of the surface that can move
   * @param extent - of the body in m
   * @param columns - of K⁻¹, by node
   */
  constructor(
    private readonly state: State,
    private readonly surface: readonly number[],
    private readonly extent: number,
    columns: Columns,
  ) {
    this.body = new LinearBody(columns, state.content.d);
  }

  /** Something else than the forces of the sphere has changed. */
  begin(): void {
    this.left = MOST;
    this.stride = STRIDE;
  }

  /** Move the forces of the sphere, so that no node is inside of it. */
  step(): Outcome {
    const { tool } = this.state;
    if (tool !== this.tool) {
      this.tool = tool;
      this.good = this.last = null;
      this.body.forget();
    }
    if (!tool) return "there";
    const force = this.force();
    const u = this.displacement();
    this.learn(force, u);
    const x = u.map((value, i) => value + this.state.content.coordinates[i]);
    const wrong = this.wrong(x, force);
    const largest = u.reduce((most, value) => Math.max(most, Math.abs(value)), 0);
    if (wrong <= TOLERANCE * largest + REST * this.extent) return this.arrive(force);
    if (this.left-- === 0) return this.withdraw();
    const { last } = this;
    if (last && wrong > LARGER * last.wrong && last.part / 2 >= SHORTEST) {
      this.set(last, last.part / 2);
      return "moves";
    }
    const wanted = linearContact(this.body, tool, this.surface, x, force, this.extent);
    if (wanted === "missing") return "missing";
    if (wanted === "none") return this.withdraw();
    this.set({ beside: this.beside(), wrong, force, wanted, u }, 1);
    return "moves";
  }

  /** The sphere is where no node is inside of it: go on to where it shall be. */
  private arrive(force: Float64Array): Outcome {
    const tool = this.state.tool!;
    this.good = { centre: tool.centre, force };
    this.left = MOST;
    if (this.last) this.stride = Math.min(STRIDE, 2 * this.stride);
    this.last = null;
    return this.approach() ? "moves" : "there";
  }

  /** Go back to where the sphere could be, and on from there in smaller steps. */
  private withdraw(): Outcome {
    this.last = null;
    this.left = MOST;
    this.stride /= 4;
    this.body.forget();
    const tool = this.state.tool!;
    tool.centre = this.good?.centre ?? tool.centre;
    this.state.loads.contacts = this.contacts(this.good?.force ?? this.force().fill(0));
    if (!this.good || this.stride < SMALLEST) return "lost";
    this.approach();
    return "moves";
  }

  /** Move the sphere by a step towards where it shall be; false if it is there. */
  private approach(): boolean {
    const tool = this.state.tool!;
    const way = tool.wanted.map((value, i) => value - tool.centre[i]);
    const length = Math.hypot(...way);
    if (length === 0) return false;
    const part = (this.stride * tool.radius) / length;
    const moved = tool.centre.map((value, i) => value + part * way[i]);
    tool.centre = part < 1 ? moved : [...tool.wanted];
    return true;
  }

  private set(step: Omit<NonNullable<typeof this.last>, "part">, part: number): void {
    this.last = { ...step, part };
    const { force, wanted } = step;
    this.state.loads.contacts = this.contacts(
      force.map((value, i) => value + part * (wanted[i] - value)),
    );
  }

  private learn(force: Float64Array, u: Float64Array): void {
    const { last } = this;
    if (!last) return;
    if (last.beside !== this.beside()) {
      this.last = null;
      return;
    }
    const change = force.map((value, i) => value - last.force[i]);
    const { d } = this.state.content;
    const nodes = this.surface.filter((node) =>
      change.subarray(node * d, node * d + d).some(Boolean),
    );
    this.body.learn(
      nodes,
      change,
      u.map((value, i) => value - last.u[i]),
    );
  }

  /** Largest depth of a node, or distance of one that bears a force, in m. */
  private wrong(x: Float64Array, force: Float64Array): number {
    const { d } = this.state.content;
    let most = 0;
    for (const node of this.surface) {
      const { gap } = near(this.state.tool!, x, node);
      const bears = force.subarray(node * d, node * d + d).some(Boolean);
      most = Math.max(most, bears ? Math.abs(gap) : -gap);
    }
    return most;
  }

  /** Forces of the sphere on the nodes of a body as stiff as that of the training, (nodes · d). */
  private force(): Float64Array {
    const { content, loads, stiffness } = this.state;
    const found = new Float64Array(content.nodes * content.d);
    for (const { node, force } of loads.contacts) {
      force.forEach((value, i) => (found[node * content.d + i] = value / stiffness));
    }
    return found;
  }

  private contacts(force: Float64Array): Contact[] {
    const { content, stiffness } = this.state;
    const at = (node: number): Float64Array =>
      force.subarray(node * content.d, (node + 1) * content.d);
    return this.surface
      .filter((node) => at(node).some(Boolean))
      .map((node) => ({ node, force: Array.from(at(node), (value) => value * stiffness) }));
  }

  private displacement(): Float64Array {
    const { content, displacement } = this.state;
    return displacement
      ? Float64Array.from(displacement)
      : new Float64Array(content.nodes * content.d);
  }

  /** What acts beside the sphere. */
  private beside(): string {
    const { loads, stiffness } = this.state;
    const acting = [...loads.all, loads.body].map(({ node, force }) => [node, force]);
    return JSON.stringify([stiffness, loads.pressures, acting]);
  }
}
