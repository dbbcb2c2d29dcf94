/** Points of elements between the nodes, as `surrogate/mechanics/equilibrium/quadratic.py`. */

import { searched } from "./certificate";
import { Equilibrium } from "./equilibrium";
import { gathered, norm, plus } from "./vectors";

const ITERATIONS = 20;
const SMALL = 1e-9; // of the displacement: a step after which the next one is a rounding error

/**
 * Displacements of all points: where those of the nodes alone are given, in m, points between them are
 * where they are in equilibrium with the forces on all in N; interpolated where cells are inverted.
 */
export function atPoints(
  equilibrium: Equilibrium,
  given: Float64Array,
  f: Float64Array,
): Float64Array {
  const { d, between, nodes } = equilibrium.solid.body;
  if (!between || given.length === equilibrium.size) return given;
  const start = new Float64Array(equilibrium.size);
  start.set(given);
  start.set(gathered(between, given, d), nodes * d);
  if (equilibrium.inverted(start)) return start;
  const held = new Equilibrium(
    equilibrium.solid,
    equilibrium.order.filter((dof) => dof >= nodes * d),
  );
  let u = held.relaxed(start, f);
  for (let iteration = 0; iteration < ITERATIONS; iteration++) {
    const acting = equilibrium.pressure ? plus(f, equilibrium.pressure.forces(u)) : f;
    const step = held
      .tangent(u)
      .solve(held.outOfBalance(u, acting))
      .map((value) => -value);
    const next = searched(held, acting, u, step);
    if (!next) break;
    const moved = norm(plus(next, u, -1));
    u = next;
    if (moved <= SMALL * norm(u)) break;
  }
  return u;
}
