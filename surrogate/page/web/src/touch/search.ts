/**
 * Unknown forces under which the body fulfils a condition: places held, or a sphere that is not
 * entered. As in `surrogate/mechanics/touch/search.py` the body is linear around a prediction, and the
 * prediction with the forces that the condition asks of this linear body is the next one; here one a
 * frame. Where a step makes it worse, a part of it is taken. The condition goes to where it shall be
 * in strides that the body can follow, in a motion one a time step.
 */

import type { Part } from "../loads";
import { at, plus } from "../mechanics/vectors";
import type { State } from "../state";
import { LinearBody, type Columns } from "./linear_body";

const TOLERANCE = 1e-4; // over the size of the condition: what may be wrong
const REST = 1e-7; // over the body's size: the same
const LARGER = 2; // of what is wrong, that a full step may leave
const SHORTEST = 1 / 8; // part of a step
const SMALLEST = 1 / 32; // part of a stride
const MOST = 30; // predictions without getting there

/** What is wanted of the body, by forces on some loads: (loads · d) in N. */
export interface Condition {
  /** The forces that are sought. */
  readonly parts: readonly Part[];
  /** Where it is, and where it shall be, in m. */
  at: number[];
  readonly wanted: number[];
  /** How far it goes at once in m. */
  readonly stride: number;
  /** How far a displacement of all nodes is from it in m, and what that is relative to. */
  wrong: (u: Float64Array, force: Float64Array) => number;
  size: (u: Float64Array) => number;
  /** Forces with which the linear body around a prediction fulfils it. */
  forces: (body: LinearBody, u: Float64Array, force: Float64Array) => Found;
}

/** Forces, or why there are none: columns are being computed, or the body slips away. */
export type Found = Float64Array | "missing" | "none";

/**
 * What a frame has done: the body is where it shall be; it moves there; responses are being computed; no
 * forces are found.
 */
export type Outcome = "there" | "moves" | "missing" | "lost";

/** A prediction, and the step from it. */
interface Step {
  beside: string;
  u: Float64Array;
  force: Float64Array;
  wanted: Float64Array;
  wrong: number;
  part: number;
}

export class Search<T> {
  private about: T[] = [];
  private condition: Condition | null = null;
  private body!: LinearBody;
  private stride = 1;
  private left = MOST;
  /** Where the condition could be fulfilled last, and by which forces. */
  private good: { at: number[]; force: Float64Array } | null = null;
  private last: Step | null = null;

  /**
   * @param columns - of K⁻¹
   * @param find - what a condition is about; nothing if there is none
   * @param make - the condition
   */
  constructor(
    private readonly state: State,
    private readonly columns: Columns,
    private readonly find: (state: State) => T[],
    private readonly make: (about: T[]) => Condition,
  ) {}

  /** Something else than the forces has changed. */
  begin(): void {
    this.left = MOST;
    this.stride = 1;
  }

  /** Forget the condition, and how the body answers. */
  forget(): void {
    this.about = [];
    this.condition = null;
  }

  /** Take the stride of a time step; false if the condition is where it shall be. */
  goOn(): boolean {
    return this.condition !== null && this.approach(this.condition);
  }

  /** Move the forces so that the condition is fulfilled. */
  step(): Outcome {
    this.renew(this.find(this.state));
    const { condition, last } = this;
    if (!condition) return "there";
    const { content, loads, stiffness } = this.state;
    const { parts } = condition;
    const force = Float64Array.from(parts.flatMap((part) => part.force.map((f) => f / stiffness)));
    const u = content.coordinates.map((_, i) => this.state.displacement?.[i] ?? 0);
    const others = loads.dead().filter((part) => !parts.includes(part));
    const beside = JSON.stringify([stiffness, loads.pressures, loads.given, others]);
    if (last?.beside === beside) {
      this.body.learn(plus(force, last.force, -1), plus(u, last.u, -1));
    } else {
      this.last = null;
    }
    const wrong = condition.wrong(u, force);
    if (wrong <= TOLERANCE * condition.size(u) + REST * content.extent) {
      return this.arrive(condition, force);
    }
    if (this.left-- === 0) return this.withdraw(condition);
    if (this.last && wrong > LARGER * this.last.wrong && this.last.part / 2 >= SHORTEST) {
      return this.take(condition, { ...this.last, part: this.last.part / 2 });
    }
    const wanted = condition.forces(this.body, u, force);
    if (wanted === "missing") return "missing";
    if (wanted === "none") return this.withdraw(condition);
    return this.take(condition, { beside, u, force, wanted, wrong, part: 1 });
  }

  /** Begin anew with a condition that is about something else. */
  private renew(about: T[]): void {
    if (about.length === this.about.length && about.every((one, i) => one === this.about[i]))
      return;
    this.about = about;
    this.good = this.last = null;
    this.condition = about.length > 0 ? this.make(about) : null;
    this.body = new LinearBody(this.condition?.parts ?? [], this.state.loads, this.columns);
  }

  /** The condition is fulfilled: go on to where it shall be. */
  private arrive(condition: Condition, force: Float64Array): Outcome {
    this.good = { at: condition.at, force };
    this.left = MOST;
    if (this.last) this.stride = Math.min(1, 2 * this.stride);
    this.last = null;
    return !this.state.motion.isOn && this.approach(condition) ? "moves" : "there";
  }

  /** Go back to where the condition could be fulfilled, and on from there in smaller strides. */
  private withdraw(condition: Condition): Outcome {
    this.last = null;
    this.left = MOST;
    this.stride /= 4;
    this.body.forget();
    condition.at = this.good?.at ?? condition.at;
    const none = new Float64Array(condition.parts.length * this.state.content.d);
    this.bear(condition, this.good?.force ?? none);
    if (!this.good || this.stride < SMALLEST) return "lost";
    this.approach(condition);
    return "moves";
  }

  /** Move the condition by a stride towards where it shall be; false if it is there. */
  private approach(condition: Condition): boolean {
    const { at, wanted, stride } = condition;
    const way = wanted.map((value, i) => value - at[i]);
    const length = Math.hypot(...way);
    if (length === 0) return false;
    const part = (this.stride * stride) / length;
    condition.at = part < 1 ? at.map((value, i) => value + part * way[i]) : [...wanted];
    return true;
  }

  /** Take a part of a step. */
  private take(condition: Condition, step: Step): Outcome {
    this.last = step;
    this.bear(condition, plus(step.force, plus(step.wanted, step.force, -1), step.part));
    return "moves";
  }

  /** Let forces act, which are those of the body of the training. */
  private bear({ parts }: Condition, force: Float64Array): void {
    const borne = force.map((value) => value * this.state.stiffness);
    parts.forEach((part, k) => (part.force = [...at(borne, k, this.state.content.d)]));
  }
}
