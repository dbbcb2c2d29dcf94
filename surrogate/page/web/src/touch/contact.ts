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
import { near } from "./sphere";

const STRIDE = 0.25; // of the radius
const STEPS = 25; // of Newton's method
const SETTLED = 1e-4; // over the body's size: movement of the last step
const DEEP = 1e-6; // over the body's size: depth of a node
const REACH = 0.1; // over the body's size: distance of nodes that are looked at

/** A node of the surface: where it is in m, its force in N, the size λ of that along the normal. */
interface Place {
  k: number;
  x: Float64Array;
  force: Float64Array;
  size: number;
  bears: boolean;
}

export class Contact implements Condition {
  readonly parts: readonly Part[];
  readonly stride: number;

  /** @param surface - nodes of the surface that can move */
  constructor(
    private readonly state: State,
    private readonly tool: Tool,
    private readonly surface: readonly number[],
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
    const wrong = this.places(u, force).map(({ x, bears }) => {
      const { gap } = near(this.tool, x);
      return bears ? Math.abs(gap) : -gap;
    });
    return Math.max(0, ...wrong);
  }

  size(u: Float64Array): number {
    return largest(u);
  }

  /** Forces of the sphere on the linear body. */
  forces(body: LinearBody, u: Float64Array, force: Float64Array): Found {
    const { tool, surface } = this;
    const { extent } = this.state.content;
    const d = tool.centre.length;
    const all = this.places(u, force);
    const lowest = Math.min(0, ...all.map(({ x }) => near(tool, x).gap));
    let close = all.filter(({ x, bears }) => bears || near(tool, x).gap < REACH * extent);
    for (const place of close) {
      const { gap, normal } = near(tool, place.x);
      place.size = Math.max(0, dot(normal, place.force));
      place.bears ||= gap < lowest / 2;
    }
    let bearing: Place[] = []; // the first ones of those that are close
    let compliance: Float64Array | null = new Float64Array();
    for (let step = 0; step < STEPS; step++) {
      if (close.filter(({ bears }) => bears).length > bearing.length) {
        bearing = close.filter(({ bears }) => bears);
        close = [...bearing, ...close.filter(({ bears }) => !bears)];
        const dofs = close.flatMap(({ k, x }) => [...x.keys()].map((i) => surface[k] * d + i));
        const of = bearing.map(({ k }) => k);
        compliance = body.compliance(dofs, of);
        if (!compliance) return "missing";
      }
      if (bearing.length === 0) return force;
      const among = compliance.subarray(0, (bearing.length * d) ** 2);
      const found = newtonStep(among, tool, bearing);
      if (!found) return "none";
      bearing.forEach((place, i) => {
        place.size = found.sizes[i];
        add(place.force, at(found.change, i, d), 1);
      });
      const shift = times(compliance, found.change);
      close.forEach(({ x }, i) => add(x, at(shift, i, d), 1));
      const gap = close.map(({ x, bears }) => (bears ? 0 : near(tool, x).gap));
      const deepest = Math.min(...gap);
      if (deepest < -DEEP * extent) {
        close.forEach((place, i) => (place.bears ||= gap[i] <= deepest / 2));
      } else if (largest(shift) < SETTLED * extent) {
        return Float64Array.from(all.flatMap((place) => [...place.force]));
      }
    }
    return "none";
  }

  /** The nodes of the surface. */
  private places(u: Float64Array, force: Float64Array): Place[] {
    const { coordinates, d } = this.state.content;
    return this.surface.map((node, k) => {
      const [x, own] = [at(coordinates, node, d), at(force, k, d)];
      const bears = own.some(Boolean);
      return { k, x: plus(x, at(u, node, d)), force: own.slice(), size: 0, bears };
    });
  }
}

/**
 * Changes of the forces of some nodes in N, and the sizes of these forces after it; null without one.
 *
 * @param compliance - C, (n · d) rows and columns
 */
function newtonStep(
  compliance: Float64Array,
  tool: Tool,
  nodes: readonly Place[],
): { change: Float64Array; sizes: Float64Array } | null {
  const m = nodes.length;
  const d = tool.centre.length;
  const n = m * d;
  const sizes = nodes.map(({ size }) => size);
  const gaps = new Float64Array(m);
  const normals = new Float64Array(m * n);
  const bend = new Float64Array(n * n); // Λ H
  const right = new Float64Array(n * (m + 1)); // λ n − f, and n of every node
  nodes.forEach(({ x, force, size }, k) => {
    const { gap, normal, curvature } = near(tool, x);
    gaps[k] = gap;
    for (let i = 0, row = k * d; i < d; i++, row++) {
      normals[k * n + row] = right[row * (m + 1) + 1 + k] = normal[i];
      right[row * (m + 1)] = size * normal[i] - force[i];
      for (let j = 0; j < d; j++) bend[row * n + k * d + j] = size * curvature[i * d + j];
    }
  });
  const system = plus(unit(n), times(bend, compliance, n), -1);
  const change = solve(system, right, m + 1);
  if (!change) return null;
  const along = times(times(normals, compliance, n), change, m + 1);
  const slopes = along.filter((_, place) => place % (m + 1) > 0);
  const before = times(slopes, sizes);
  const offset = gaps.map((gap, k) => gap + along[k * (m + 1)] - before[k]);
  const begins = sizes.map((size) => size > 0);
  const found = complementary(slopes, offset, begins);
  if (!found?.every(Number.isFinite)) return null;
  const step = times(change, [1, ...found.map((size, k) => size - sizes[k])]);
  nodes.forEach(({ force }, k) => {
    if (!(found[k] > 0)) for (let i = 0; i < d; i++) step[k * d + i] = -force[i];
  });
  return { change: step, sizes: found };
}
