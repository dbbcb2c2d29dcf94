/** Loads unlike those of the training, as `surrogate/learning/inference/training_range.py` tells them. */

import { largest } from "./mechanics/vectors";
import { asForce } from "./units";

const ROUNDING = 1e-6; // of forces, which datasets hold in single precision

/** The loads of the training data. */
export interface TrainingRange {
  /** Largest absolute force component at a node, in N. */
  limit: number[];
  /** Largest components of a load, in N. */
  largest: number[];
  /** Nodes that were loaded. */
  loadable: Uint8Array;
  loads: { fewest: number; most: number; resultant: number[] } | null;
}

export type Kind = "range" | "places" | "number" | "resultant";

/** Say how nodal forces in N, (nodes · d), leave the training data. */
export function exceeded(
  forces: Float64Array,
  { limit, loadable, loads }: TrainingRange,
): Map<Kind, string> {
  const d = limit.length;
  const force = (node: number): Float64Array => forces.subarray(node * d, node * d + d);
  const loaded = [...loadable.keys()].filter((node) => force(node).some(Boolean));
  const rounding = ROUNDING * largest(limit);
  const found = new Map<Kind, string>();
  if (loaded.some((node) => isBeyond(force(node), limit, rounding))) {
    const range = `${plusMinus(limit)} a component of a node`;
    found.set("range", `Force beyond the training range, ${range}`);
  }
  if (loaded.some((node) => !loadable[node]))
    found.set("places", "Load at a node that was never loaded in training");
  if (!loads || loaded.length === 0) return found;
  const { fewest, most, resultant } = loads;
  if (loaded.length > most || loaded.length < fewest) {
    const number = fewest === most ? `${fewest}` : `${fewest} to ${most}`;
    found.set(
      "number",
      `${loaded.length} loaded node${loaded.length === 1 ? "" : "s"}; ${number} in training`,
    );
  }
  const sum = limit.map((_, i) => loaded.reduce((total, node) => total + force(node)[i], 0));
  const sizes = forces.reduce((total, value) => total + Math.abs(value), 0);
  if (isBeyond(sum, resultant, ROUNDING * sizes))
    found.set("resultant", `Sum of the loads beyond that of the training, ${plusMinus(resultant)}`);
  return found;
}

/** Whether a component is larger than allowed, by more than rounding. */
export function isBeyond(
  force: ArrayLike<number>,
  limit: readonly number[],
  rounding = 0,
): boolean {
  return limit.some((most, i) => Math.abs(force[i]) > most * (1 + ROUNDING) + rounding);
}

function plusMinus(limit: readonly number[]): string {
  const all = new Set(limit.map((value) => asForce(value)));
  return `±${[...all].join(", ")}`;
}
