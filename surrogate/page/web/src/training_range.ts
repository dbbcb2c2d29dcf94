/** Loads unlike those of the training, as `surrogate/inference/training_range.py` tells them. */

import { size, type Load } from "./loads";
import { asForce } from "./units";

const MARGIN = 1 + 1e-6; // of rounding

/** The loads of the training data. */
export interface TrainingRange {
  /** Largest absolute force component at a node, in N. */
  limit: number[];
  /** Nodes that were loaded. */
  loadable: Uint8Array;
  loads: { fewest: number; most: number; resultant: number[] } | null;
}

export type Kind = "range" | "places" | "number" | "resultant";

/** Say how loads leave the training data. */
export function exceeded(loads: readonly Load[], trained: TrainingRange): Map<Kind, string> {
  const found = new Map<Kind, string>();
  const acting = loads.filter((load) => size(load.force) > 0);
  const beyond = (force: readonly number[], limit: readonly number[]): boolean =>
    force.some((value, i) => Math.abs(value) > limit[i] * MARGIN);
  if (acting.some((load) => beyond(load.force, trained.limit))) {
    found.set("range", `Force beyond the training range, ${plusMinus(trained.limit)} a component`);
  }
  if (acting.some((load) => !trained.loadable[load.node])) {
    found.set("places", "Load at a node that was never loaded in training");
  }
  if (!trained.loads || acting.length === 0) return found;
  const { fewest, most, resultant } = trained.loads;
  if (acting.length > most || acting.length < fewest) {
    const number = fewest === most ? `${fewest}` : `${fewest} to ${most}`;
    found.set("number", `${acting.length} loads at once; ${number} in training`);
  }
  const sum = resultant.map((_, i) => acting.reduce((total, load) => total + load.force[i], 0));
  if (beyond(sum, resultant)) {
    found.set("resultant", `Sum of the loads beyond that of the training, ${plusMinus(resultant)}`);
  }
  return found;
}

function plusMinus(limit: readonly number[]): string {
  const all = new Set(limit.map((value) => asForce(value)));
  return `±${[...all].join(", ")}`;
}
