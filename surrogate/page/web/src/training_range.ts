/** Loads unlike those of the training, as `surrogate/learning/inference/training_range.py` tells them. */

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
export function exceeded(forces: Float64Array, trained: TrainingRange): Map<Kind, string> {
  const found = new Map<Kind, string>();
  const { limit, loadable, loads } = trained;
  const d = limit.length;
  const sum = new Array<number>(d).fill(0);
  const rounding = ROUNDING * Math.max(...limit);
  let sizes = 0;
  let count = 0;
  let isLarge = false;
  let isElsewhere = false;
  for (let node = 0; node < loadable.length; node++) {
    const force = forces.subarray(node * d, (node + 1) * d);
    if (force.every((value) => value === 0)) continue;
    count++;
    isLarge ||= isBeyond(force, limit, rounding);
    isElsewhere ||= !loadable[node];
    for (let i = 0; i < d; i++) {
      sum[i] += force[i];
      sizes += Math.abs(force[i]);
    }
  }
  if (isLarge) {
    found.set(
      "range",
      `Force beyond the training range, ${plusMinus(limit)} a component of a node`,
    );
  }
  if (isElsewhere) found.set("places", "Load at a node that was never loaded in training");
  if (!loads || count === 0) return found;
  const { fewest, most, resultant } = loads;
  if (count > most || count < fewest) {
    const number = fewest === most ? `${fewest}` : `${fewest} to ${most}`;
    found.set("number", `${count} loaded nodes; ${number} in training`);
  }
  if (isBeyond(sum, resultant, ROUNDING * sizes)) {
    found.set("resultant", `Sum of the loads beyond that of the training, ${plusMinus(resultant)}`);
  }
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
