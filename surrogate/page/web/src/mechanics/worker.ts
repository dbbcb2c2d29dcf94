/** The worker: columns of K⁻¹ of loaded nodes, load series, and estimated errors of predictions. */

import { certify } from "./certificate";
import { Equilibrium } from "./equilibrium";
import { loadSeries } from "./load_series";
import type { Body, Reply, Request } from "./messages";
import { atPoints } from "./points_between";
import { Solid } from "./solid";

let body: Body;
let equilibrium: Equilibrium;
let latest = 0;

function reply(message: Reply): void {
  self.postMessage(message);
}

/** Forces on all points; they act at the nodes. */
function onPoints(force: Float64Array): Float64Array {
  const found = new Float64Array(body.coordinates.length);
  found.set(force);
  return found;
}

/** Let messages arrive that wait. */
function pause(): Promise<void> {
  return new Promise((resolve) => {
    const { port1, port2 } = new MessageChannel();
    port1.onmessage = () => {
      port1.close();
      resolve();
    };
    port2.postMessage(null);
  });
}

/** Forces on the nodes that nodal forces reach by way of the grid, if there is one. */
function spread(force: Float64Array): Float64Array {
  if (!body.spread) return force;
  const { starts, nodes, weights } = body.spread;
  const { d } = body;
  const found = new Float64Array(force.length);
  force.forEach((value, dof) => {
    const node = Math.floor(dof / d);
    for (let i = starts[node]; value !== 0 && i < starts[node + 1]; i++)
      found[nodes[i] * d + (dof % d)] += value * weights[i];
  });
  return found;
}

self.onmessage = async ({ data }: MessageEvent<Request>) => {
  if (data.kind === "body") {
    body = data.body;
    equilibrium = new Equilibrium(new Solid(body));
    return;
  }
  if (data.kind === "columns") {
    const columns = data.forces.map((f) => equilibrium.linearResponse(onPoints(spread(f))));
    reply({ kind: "columns", key: data.key, columns });
    return;
  }
  equilibrium.under(data.loading.pressures);
  const force = onPoints(data.loading.force);
  if (data.kind === "series") {
    const displacement = loadSeries(equilibrium, force, data.order);
    reply({ kind: "series", displacement: Float32Array.from(displacement) });
    return;
  }
  const { number, kind } = data;
  latest = number;
  const u = atPoints(equilibrium, data.displacement, force);
  const certificate = await certify(equilibrium, force, u, async () => {
    await pause();
    return latest === number;
  });
  for (const field of [certificate, certificate?.corrected])
    if (field?.error) field.error = field.error.slice(0, body.nodes * body.d);
  reply({ kind, number, certificate });
};
