/**
 * Contact of a linear body with a rigid sphere, as `surrogate/mechanics/touch/linear_contact.py`: Newton's
 * method around complementarity problems,
 *
 *   δf = (I − Λ H C)⁻¹ (λ n − f + n δλ),  0 ≤ λ + δλ ⊥ g + nᵀ C δf ≥ 0
 */

import { complementary } from "./complementarity";
import { solve, times, unit } from "../mechanics/vectors";
import type { LinearBody } from "./linear_body";
import { near, type Sphere } from "./sphere";

const STEPS = 25; // of Newton's method
const SETTLED = 1e-4; // over the body's size: movement of the last step
const DEEP = 1e-6; // over the body's size: depth of a node
const REACH = 0.1; // over the body's size: distance of nodes that are looked at

/** Forces, or why there are none: columns are being computed, or the body slips away. */
export type Found = Float64Array | "missing" | "none";

/**
 * Find the forces of a sphere in N, (nodes · d), on a linear body.
 *
 * @param surface - nodes of the surface that can move
 * @param x - positions of all nodes in m, (nodes · d)
 * @param force - forces of the sphere in N that act there, (nodes · d)
 * @param size - of the body in m
 */
export function linearContact(
  body: LinearBody,
  tool: Sphere,
  surface: readonly number[],
  x: Float64Array,
  force: Float64Array,
  size: number,
): Found {
  const d = tool.centre.length;
  const bears = (node: number): boolean => force.subarray(node * d, node * d + d).some(Boolean);
  const distance = new Map(surface.map((node) => [node, near(tool, x, node).gap]));
  const lowest = Math.min(0, ...distance.values());
  const close = surface.filter((node) => bears(node) || distance.get(node)! < REACH * size);
  const isNear = close.map((node) => bears(node) || distance.get(node)! < lowest / 2);
  const at = rowsOf(x, close, d);
  const total = rowsOf(force, close, d);
  const sizes = close.map((_, k) => {
    const { normal } = near(tool, at, k);
    return Math.max(
      0,
      normal.reduce((sum, n, i) => sum + n * total[k * d + i], 0),
    );
  });
  let rows: number[] = [];
  let compliance: Float64Array | null = new Float64Array();
  for (let step = 0; step < STEPS; step++) {
    if (isNear.filter(Boolean).length > rows.length) {
      rows = [...close.keys()].filter((k) => isNear[k]);
      const nodes = rows.map((k) => close[k]);
      compliance = body.compliance(close, nodes);
      if (!compliance) return "missing";
    }
    if (rows.length === 0) break;
    const found = newtonStep(compliance, tool, rows, at, total, sizes);
    if (!found) return "none";
    rows.forEach((k, place) => {
      sizes[k] = found.sizes[place];
      for (let i = 0; i < d; i++) total[k * d + i] += found.change[place * d + i];
    });
    const shift = times(compliance, found.change);
    let most = 0;
    shift.forEach((value, place) => {
      at[place] += value;
      most = Math.max(most, Math.abs(value));
    });
    const gap = close.map((_, k) => (isNear[k] ? 0 : near(tool, at, k).gap));
    const least = Math.min(...gap);
    if (least < -DEEP * size) {
      gap.forEach((value, k) => (isNear[k] ||= value <= least / 2));
    } else if (most < SETTLED * size) {
      break;
    }
    if (step === STEPS - 1) return "none";
  }
  const forces = new Float64Array(x.length);
  close.forEach((node, k) => {
    forces.set(total.subarray(k * d, k * d + d), node * d);
  });
  return forces;
}

/** Changes of the forces of some nodes in N, and the sizes of these forces after it; null without one. */
function newtonStep(
  compliance: Float64Array,
  tool: Sphere,
  rows: readonly number[],
  at: Float64Array,
  total: Float64Array,
  sizes: readonly number[],
): { change: Float64Array; sizes: Float64Array } | null {
  const d = tool.centre.length;
  const m = rows.length;
  const n = m * d;
  const seen = rows.map((k) => near(tool, at, k));
  const size = rows.map((k) => sizes[k]);
  const among = new Float64Array(n * n);
  rows.forEach((k, place) => {
    among.set(compliance.subarray(k * d * n, (k + 1) * d * n), place * d * n);
  });
  const system = unit(n);
  const right = new Float64Array(n * (m + 1));
  seen.forEach(({ normal, curvature }, place) => {
    for (let i = 0; i < d; i++) {
      const row = place * d + i;
      for (let j = 0; j < d; j++) {
        const bend = size[place] * curvature[i * d + j];
        const from = (place * d + j) * n;
        for (let c = 0; c < n; c++) system[row * n + c] -= bend * among[from + c];
      }
      right[row * (m + 1)] = size[place] * normal[i] - total[rows[place] * d + i];
      right[row * (m + 1) + 1 + place] = normal[i];
    }
  });
  const change = solve(system, right, m + 1);
  if (!change) return null;
  const column = (c: number): Float64Array =>
    Float64Array.from({ length: n }, (_, row) => change[row * (m + 1) + c]);
  const along = (moved: Float64Array, place: number): number =>
    seen[place].normal.reduce((sum, value, i) => sum + value * moved[place * d + i], 0);
  const moved = Array.from({ length: m + 1 }, (_, c) => times(among, column(c)));
  const slopes = Float64Array.from({ length: m * m }, (_, k) =>
    along(moved[1 + (k % m)], Math.floor(k / m)),
  );
  const before = times(slopes, size);
  const gap = Float64Array.from(
    seen,
    (one, place) => one.gap + along(moved[0], place) - before[place],
  );
  const found = complementary(
    slopes,
    gap,
    size.map((value) => value > 0),
  );
  if (!found?.every(Number.isFinite)) return null;
  const weights = Float64Array.from([1, ...found.map((value, place) => value - size[place])]);
  const step = times(change, weights);
  found.forEach((value, place) => {
    if (value > 0) return;
    for (let i = 0; i < d; i++) step[place * d + i] = -total[rows[place] * d + i];
  });
  return { change: step, sizes: found };
}

/** Rows of some nodes, (n · d). */
function rowsOf(values: Float64Array, nodes: readonly number[], d: number): Float64Array {
  return Float64Array.from(
    nodes.flatMap((node) => Array.from(values.subarray(node * d, node * d + d))),
  );
}
