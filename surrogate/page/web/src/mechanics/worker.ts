/**
 * The worker: columns of K⁻¹ of loaded nodes, load series, directions towards the equilibrium, and
 * estimated errors of predictions.
 */

import { CarriedCompliance } from "./carried_compliance";
import { certify } from "./certificate";
import { descend } from "./descent";
import { Equilibrium } from "./equilibrium";
import type { Body, Reply, Request } from "./messages";
import { atPoints } from "./points_between";
import { loadSeries } from "./series";
import { Solid } from "./solid";

let body: Body;
let equilibrium: Equilibrium;
let compliance: CarriedCompliance | null = null;
let latest = 0;
let requests = 0;

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

/** Linear responses in m to nodal forces in N, each by way of the grid if there is one. */
function columns(forces: readonly Float64Array[]): Float64Array[] {
  return forces.map((force) =>
    equilibrium.linearResponse(onPoints(body.spread ? spread(force) : force)),
  );
}

/** Forces on the nodes that nodal forces reach by way of the grid. */
function spread(force: Float64Array): Float64Array {
  const { starts, nodes, weights } = body.spread!;
  const d = equilibrium.solid.d;
  const found = new Float64Array(force.length);
  for (let node = 0; node < starts.length - 1; node++) {
    for (let component = 0; component < d; component++) {
      const value = force[node * d + component];
      if (value === 0) continue;
      for (let i = starts[node]; i < starts[node + 1]; i++) {
        found[nodes[i] * d + component] += value * weights[i];
      }
    }
  }
  return found;
}

/** Whether what is computed is wanted, asked after messages have arrived. */
function whether(condition: () => boolean): () => Promise<boolean> {
  return async () => {
    await pause();
    return condition();
  };
}

self.onmessage = async ({ data }: MessageEvent<Request>) => {
  const request = ++requests;
  if (data.kind === "body") {
    body = data.body;
    equilibrium = new Equilibrium(new Solid(body));
    return;
  }
  if (data.kind === "columns") {
    reply({ kind: "columns", key: data.key, columns: columns(data.forces) });
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
  if (kind === "descent") {
    compliance ??= new CarriedCompliance(equilibrium);
    const u = atPoints(equilibrium, data.displacement, force);
    const wanted = whether(() => request === requests);
    const found = await descend(equilibrium, compliance, force, u, wanted);
    if (found) reply({ kind, number, displacement: Float32Array.from(found) });
  } else {
    latest = number;
    const u = atPoints(equilibrium, data.displacement, force);
    const wanted = whether(() => latest === number);
    const certificate = await certify(equilibrium, force, u, wanted);
    if (certificate?.error) certificate.error = certificate.error.slice(0, body.nodes * body.d);
    reply({ kind, number, certificate });
  }
};
