/**
 * Which values of the actuators bring a node to a target, or near to it, as
 * `surrogate/mechanics/actuation/targets.py`:
 *
 *   min ‖y(v) − ŷ‖² + ε² L² Σ_i ((v_i − v_{i,0}) / V_i)²,  low ≤ v ≤ high
 */

import { complementary } from "../touch/complementarity";
import type { ActuatedModes } from "./actuated_modes";
import { combined, dot, norm, plus, times } from "./vectors";

const EFFORT = 1e-3; // ε
const STEPS = 1; // of Gauss and Newton's method at once
const SHORTEST = 1 / 32; // of a step
const SETTLED = 1e-3; // of the limits: the last step
const NO_LESS = 1e-3; // of what is least: a decrease that ends the search
const TINY = 1e-5; // of the size of the body: the same

/** A node, and where it shall be, d components in m. */
export interface Target {
  node: number;
  place: number[];
}

/**
 * Go some steps towards a target; whether the last one was small.
 *
 * @param way - from the node without its modes to the target in m
 */
export function approach(
  modes: ActuatedModes,
  node: number,
  way: Float64Array,
  work: Float64Array,
): boolean {
  const { first } = modes;
  const { sliders: ranges, size } = modes.of;
  const d = way.length;
  const units = ranges.map(({ low, high, rest }) => Math.max(high - rest, rest - low));
  const effort = EFFORT * size;
  const at = modes.fields.map((field) => field.subarray(node * d, node * d + d));
  /** What is squared: the distance, and efforts. */
  const left = (): Float64Array => {
    const apart = plus(combined(modes.at.q, at), way, -1);
    const efforts = ranges.map(
      ({ rest }, i) => (effort * (modes.at.given[first + i] - rest)) / units[i],
    );
    return Float64Array.from([...apart, ...efforts]);
  };
  for (let step = 0; step < STEPS; step++) {
    const before = modes.at;
    const values = before.given.subarray(first);
    const [start, cost] = [left(), norm(left()) ** 2];
    const changes = modes.changes().slice(first);
    const columns = changes.map((change, i) => {
      const efforts = units.map((_, j) => (i === j ? effort : 0));
      return Float64Array.from([...combined(change, at).map((y) => y * units[i]), ...efforts]);
    });
    const matrix = Float64Array.from(columns.flatMap((a) => columns.map((b) => dot(a, b))));
    const low = Float64Array.from(ranges, (range, i) => (range.low - values[i]) / units[i]);
    const widths = Float64Array.from(ranges, ({ low, high }, i) => (high - low) / units[i]);
    const slope = Float64Array.from(columns, (column) => dot(column, start));
    const inside = columns.map(() => true);
    const found = complementary(matrix, plus(times(matrix, low), slope), inside, widths);
    if (!found) return true;
    const wanted = plus(low, found).map((value, i) => value * units[i]);
    let share = 1;
    let after = Infinity;
    for (; share >= SHORTEST; share /= 2) {
      const trial = before.given.map((value, i) =>
        i < first ? value : value + share * wanted[i - first],
      );
      after = modes.move(trial, work) === 1 ? norm(left()) ** 2 : Infinity;
      if (after <= cost) break;
      modes.at = before;
    }
    if (share < SHORTEST) return true;
    const isSmall = wanted.every((value, i) => Math.abs(share * value) <= SETTLED * units[i]);
    if (isSmall || cost - after <= NO_LESS * cost + (TINY * size) ** 2) return true;
  }
  return false;
}
