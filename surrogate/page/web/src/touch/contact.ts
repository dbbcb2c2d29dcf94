/**
 * Contact of the body with a rigid sphere, as `surrogate/mechanics/touch/tool_contact.py`: around a
 * prediction, Newton's method around complementarity problems,
 *
 *   δf = (I − Λ H C)⁻¹ (λ n − f + n δλ),  0 ≤ λ + δλ ⊥ g + nᵀ C δf ≥ 0
 */

import type { Part } from "../loads";
import { add, at, dot, largest, plus, solve, times, unit } from "../mechanics/vectors";
import type { State, Tool } from "../state";
import { complementary } from "./complementarity";
import type { LinearBody } from "./linear_body";
import type { Condition, Found } from "./search";
import { near, type Near } from "./sphere";

const STRIDE = 0.25; // of the radius
const STEPS = 25; // of Newton's method
const SETTLED = 1e-4; // over the body's size: movement of the last step
const DEEP = 1e-6; // over the body's size: depth of a node
const REACH = 0.1; // over the body's size: distance of nodes that are looked at

export class Contact implements Condition {
  readonly parts: readonly Part[];
  readonly stride: number;

  /**
   * @param surface - nodes of the surface that can move
   * @param extent - of the body in m
   */
  constructor(
    private readonly state: State,
    private readonly tool: Tool,
    private readonly surface: readonly number[],
    private readonly extent: number,
  ) {
    const { loads, content } = state;
    const none = content.largest.map(() => 0);
    this.parts = loads.contacts = surface.map((node) => ({ key: loads.alone(node), force: none }));
    this.stride = STRIDE * tool.radius;
  }

  get at(): number[] {
    return this.tool.centre;
  }

  set at(centre: number[]) {
    this.tool.centre = centre;
  }

  get wanted(): number[] {
    return this.tool.wanted;
  }

  /** Largest depth of a node, or distance of one that bears a force. */
  wrong(u: Float64Array, force: Float64Array): number {
    const x = this.positions(u);
    return this.surface.reduce((most, _, k) => {
      const { gap } = near(this.tool, x, k);
      return Math.max(most, this.bears(force, k) ? Math.abs(gap) : -gap);
    }, 0);
  }

  size(u: Float64Array): number {
    return largest(u);
  }

  /** Forces of the sphere on the linear body. */
  forces(body: LinearBody, u: Float64Array, force: Float64Array): Found {
    const { tool, extent, surface } = this;
    const d = tool.centre.length;
    const x = this.positions(u);
    const axes = [...tool.centre.keys()];
    const distance = surface.map((_, k) => near(tool, x, k).gap);
    const lowest = Math.min(0, ...distance);
    const close = [...surface.keys()].filter(
      (k) => this.bears(force, k) || distance[k] < REACH * extent,
    );
    const isNear = close.map((k) => this.bears(force, k) || distance[k] < lowest / 2);
    const dofs = close.flatMap((k) => axes.map((i) => surface[k] * d + i));
    const of = (field: Float64Array, nodes: readonly number[]): Float64Array =>
      Float64Array.from(nodes.flatMap((k) => [...at(field, k, d)]));
    const [place, total] = [of(x, close), of(force, close)];
    const sizes = close.map((_, k) =>
      Math.max(0, dot(near(tool, place, k).normal, at(total, k, d))),
    );
    let rows: number[] = [];
    let compliance: Float64Array | null = new Float64Array();
    for (let step = 0; step < STEPS; step++) {
      if (isNear.filter(Boolean).length > rows.length) {
        rows = [...close.keys()].filter((k) => isNear[k]);
        const bearing = rows.map((k) => close[k]);
        compliance = body.compliance(dofs, bearing);
        if (!compliance) return "missing";
      }
      if (rows.length === 0) break;
      const width = d * d * rows.length; // entries of the rows of a node
      const among = rows.flatMap((k) => [...compliance!.subarray(k * width, (k + 1) * width)]);
      const found = newtonStep(
        Float64Array.from(among),
        rows.map((k) => near(tool, place, k)),
        rows.map((k) => sizes[k]),
        of(total, rows),
      );
      if (!found) return "none";
      rows.forEach((k, row) => {
        sizes[k] = found.sizes[row];
        add(at(total, k, d), at(found.change, row, d), 1);
      });
      const shift = times(compliance, found.change);
      add(place, shift, 1);
      const gap = close.map((_, k) => (isNear[k] ? 0 : near(tool, place, k).gap));
      const least = Math.min(...gap);
      if (least < -DEEP * extent) gap.forEach((value, k) => (isNear[k] ||= value <= least / 2));
      else if (largest(shift) < SETTLED * extent) break;
      if (step === STEPS - 1) return "none";
    }
    const forces = new Float64Array(force.length);
    close.forEach((k, row) => forces.set(at(total, row, d), k * d));
    return forces;
  }

  /** Positions of the surface in m. */
  private positions(u: Float64Array): Float64Array {
    const { content } = this.state;
    const x = plus(content.coordinates, u);
    return Float64Array.from(this.surface.flatMap((node) => [...at(x, node, content.d)]));
  }

  private bears(force: Float64Array, k: number): boolean {
    return at(force, k, this.tool.centre.length).some(Boolean);
  }
}

/**
 * Changes of the forces of some nodes in N, and the sizes of these forces after it; null without one.
 *
 * @param compliance - C, (n · d) rows and columns
 * @param seen - the sphere at the nodes
 * @param sizes - λ
 * @param total - f
 */
function newtonStep(
  compliance: Float64Array,
  seen: readonly Near[],
  sizes: readonly number[],
  total: Float64Array,
): { change: Float64Array; sizes: Float64Array } | null {
  const m = seen.length;
  const n = total.length;
  const d = n / m;
  const normals = new Float64Array(m * n);
  const bend = new Float64Array(n * n); // Λ H
  const right = new Float64Array(n * (m + 1)); // λ n − f, and n of every node
  seen.forEach(({ normal, curvature }, k) => {
    for (let i = 0, row = k * d; i < d; i++, row++) {
      normals[k * n + row] = right[row * (m + 1) + 1 + k] = normal[i];
      right[row * (m + 1)] = sizes[k] * normal[i] - total[row];
      for (let j = 0; j < d; j++) bend[row * n + k * d + j] = sizes[k] * curvature[i * d + j];
    }
  });
  const system = plus(unit(n), times(bend, compliance, n), -1);
  const change = solve(system, right, m + 1);
  if (!change) return null;
  const along = times(times(normals, compliance, n), change, m + 1);
  const slopes = along.filter((_, place) => place % (m + 1) > 0);
  const before = times(slopes, sizes);
  const gap = Float64Array.from(seen, (one, k) => one.gap + along[k * (m + 1)] - before[k]);
  const begins = sizes.map((value) => value > 0);
  const found = complementary(slopes, gap, begins);
  if (!found?.every(Number.isFinite)) return null;
  const step = times(change, [1, ...found.map((value, k) => value - sizes[k])]);
  const released = (row: number): boolean => !(found[Math.floor(row / d)] > 0);
  return { change: step.map((value, row) => (released(row) ? -total[row] : value)), sizes: found };
}
