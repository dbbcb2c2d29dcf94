/** Nodes of the surface, and which way is out of the body there. */

import { Vector3 } from "three";
import type { Content } from "../content";

/** Nodes of the surface that can move. */
export function movableSurface({ d, vertices, features, clamped }: Content): number[] {
  const drawn = new Set(d === 2 ? features : vertices);
  return [...drawn].filter((node) => !clamped[node]).sort((a, b) => a - b);
}

/** Unit vector from the middle of the cells at a node of the surface to the node. */
export function outwardsAt(
  node: number,
  { cells, corners }: Content,
  at: (node: number) => Vector3,
): Vector3 {
  const around = new Vector3();
  for (let first = 0; first < cells.length; first += corners) {
    const cell = cells.subarray(first, first + corners);
    if (cell.includes(node)) for (const corner of cell) around.add(at(node).sub(at(corner)));
  }
  return around.normalize();
}
