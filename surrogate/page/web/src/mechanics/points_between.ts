/** Points of elements between the nodes, as `surrogate/mechanics/quadratic.py`. */

import { Equilibrium, norm, plus } from "./equilibrium";

const ITERATIONS = 20;
const HALVINGS = 20;
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
  between.starts.slice(0, -1).forEach((first, point) => {
    for (let i = first; i < between.starts[point + 1]; i++) {
      for (let axis = 0; axis < d; axis++)
        start[(nodes + point) * d + axis] +=
          between.weights[i] * given[between.nodes[i] * d + axis];
    }
  });
  if (equilibrium.inverted(start)) return start;
  const held = new Equilibrium(
    equilibrium.solid,
    equilibrium.order.filter((dof) => dof >= nodes * d),
  );
  let u = held.relaxed(start, f);
  for (let iteration = 0; iteration < ITERATIONS; iteration++) {
    const lowered = lower(
      held,
      u,
      equilibrium.pressure ? plus(f, equilibrium.pressure.forces(u)) : f,
    );
    if (!lowered) break;
    const step = norm(plus(lowered, u, -1));
    const isLast = step <= SMALL * norm(u);
    u = lowered;
    if (isLast) break;
  }
  return u;
}

/** Newton step under dead forces, halved until Π is no higher; null if there is none. */
function lower(body: Equilibrium, u: Float64Array, f: Float64Array): Float64Array | null {
  const step = body.tangent(u).solve(body.outOfBalance(u, f));
  const potential = body.potential(u, f);
  for (let halving = 0; halving < HALVINGS; halving++) {
    const trial = plus(u, step, -(0.5 ** halving));
    if (body.potential(trial, f) <= potential + body.rounding) return trial;
  }
  return null;
}
