/**
 * Held loads: their forces g, under which places are displaced as is wanted, by Broyden's method as
 * in `surrogate/mechanics/touch/grip.py`, a step a frame:
 *
 *   r = ū − u_H(f + g),  g ← g + B r,  B ← B + (s − B y) (sᵀ B) / (sᵀ B y)
 *
 * B is measured where a grip begins, and where a step has not done what B tells.
 */

import { size, type Load } from "../loads";
import type { Fields } from "../network";
import type { State } from "../state";
import { solve, times, unit } from "../mechanics/vectors";
import type { Outcome } from "./outcome";

const TOLERANCE = 1e-4; // residual over the largest held displacement
const REST = 1e-7; // over the body's size: residual that will do
const STRIDE = 0.1; // over the body's size: movement of a frame
const ASTRAY = 0.5; // of a step, that B has not told, after which it is measured again
const PROBE = 0.01; // of the training's largest force, by which B is measured
const MOST = 60; // frames without another change

export class Grips {
  private inverse: Float64Array | null = null;
  private components: [Load, number][] = [];
  private last: { beside: string; u: number[]; change: Float64Array; wanted: Float64Array } | null =
    null;
  private left = MOST;

  /** @param extent - of the body in m */
  constructor(
    private readonly state: State,
    private readonly extent: number,
    private readonly predict: () => Promise<Fields | null>,
  ) {}

  /** Something else than the forces of grips has changed. */
  begin(): void {
    this.left = MOST;
  }

  /** Move the forces of the held loads, so that they go where they shall be. */
  async step(): Promise<Outcome> {
    const components = this.held();
    if (components.length === 0) return "there";
    const isSame =
      components.length === this.components.length &&
      components.every(([load], place) => load === this.components[place][0]);
    this.components = components;
    if (!isSame) this.inverse = this.last = null;
    const u = this.displaced();
    const wanted = components.map(([load, i], place) => load.held![i] - u[place]);
    const largest = Math.max(...components.map(([load]) => size(load.held!)), ...u.map(Math.abs));
    if (Math.max(...wanted.map(Math.abs)) <= TOLERANCE * largest + REST * this.extent) {
      return "there";
    }
    if (this.left-- === 0) return "lost";
    const beside = this.beside();
    this.learn(u, beside);
    if (!this.inverse && !(await this.measure(u))) return "missing";
    const part = Math.min(1, (STRIDE * this.extent) / Math.hypot(...wanted));
    const step = Float64Array.from(wanted, (value) => part * value);
    const change = times(this.inverse!, step);
    if (!change.every(Number.isFinite)) return "lost";
    components.forEach(([load, i], place) => (load.force[i] += change[place]));
    this.last = { beside, u, change, wanted: step };
    return "moves";
  }

  /** Learn from the last step, if nothing else has changed meanwhile. */
  private learn(u: readonly number[], beside: string): void {
    const { last, inverse } = this;
    this.last = null;
    if (!last || !inverse || last.beside !== beside) return;
    const effect = Float64Array.from(u, (value, place) => value - last.u[place]);
    const astray = effect.map((value, place) => value - last.wanted[place]);
    if (Math.hypot(...astray) > ASTRAY * Math.hypot(...last.wanted)) {
      this.inverse = null;
      return;
    }
    const n = u.length;
    const response = times(inverse, effect);
    const slope = last.change.reduce((sum, s, i) => sum + s * response[i], 0);
    const row = new Float64Array(n);
    last.change.forEach((s, i) => {
      for (let j = 0; j < n; j++) row[j] += s * inverse[i * n + j];
    });
    this.inverse = inverse.map(
      (value, place) =>
        value +
        ((last.change[Math.floor(place / n)] - response[Math.floor(place / n)]) * row[place % n]) /
          slope,
    );
  }

  /** Measure B by a small change of every component; false while a prediction has to wait. */
  private async measure(u: readonly number[]): Promise<boolean> {
    const { components } = this;
    const { content, stiffness } = this.state;
    const n = components.length;
    const probe = PROBE * Math.max(...content.largest) * stiffness;
    const slopes = new Float64Array(n * n);
    for (const [column, [load, i]] of components.entries()) {
      load.force[i] += probe;
      const fields = await this.predict();
      load.force[i] -= probe;
      if (!fields) return false;
      this.displaced(fields).forEach((value, row) => {
        slopes[row * n + column] = (value - u[row]) / probe;
      });
    }
    this.inverse = solve(slopes, unit(n), n) ?? slopes.fill(NaN);
    return true;
  }

  /** Held components that supports leave free. */
  private held(): [Load, number][] {
    const { loads, content } = this.state;
    const { d, held } = content;
    return loads.all
      .filter((load) => load.held)
      .flatMap((load) => load.force.map((_, i): [Load, number] => [load, i]))
      .filter(([{ node }, i]) => !held[node * d + i]);
  }

  private displaced(fields: Fields | null = this.state.fields): number[] {
    const { d } = this.state.content;
    return this.components.map(([{ node }, i]) => fields?.displacement[node * d + i] ?? 0);
  }

  /** What acts beside the grips. */
  private beside(): string {
    const { loads, stiffness } = this.state;
    const others = loads.acting.filter((load) => !load.held);
    return JSON.stringify([
      stiffness,
      loads.pressures,
      others.map(({ node, force }) => [node, force]),
    ]);
  }
}
