/**
 * The worker: columns of K⁻¹ of loaded nodes, load series, directions towards the equilibrium, and
 * estimated errors of predictions.
 */

import { CarriedCompliance } from "./carried_compliance";
import { certify } from "./certificate";
import { descend } from "./descent";
import { Equilibrium } from "./equilibrium";
import type { Body, Reply, Request } from "./messages";
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
  return forces.map((force) => equilibrium.linearResponse(body.spread ? spread(force) : force));
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

self.onmessage = async ({ data }: MessageEvent<Request>) => {
  const request = ++requests;
  if (data.kind === "body") {
    body = data.body;
    const solid = new Solid(body.coordinates, body.cells, body.cellType, body.material);
    equilibrium = new Equilibrium(solid, body.order, body.coordinates.length);
  } else if (data.kind === "columns") {
    reply({ kind: "columns", key: data.key, columns: columns(data.forces) });
  } else if (data.kind === "series") {
    const displacement = loadSeries(equilibrium, data.force, data.order);
    reply({ kind: "series", displacement: Float32Array.from(displacement) });
  } else if (data.kind === "descent") {
    compliance ??= new CarriedCompliance(equilibrium);
    const { force, displacement } = data;
    const wanted = async (): Promise<boolean> => {
      await pause();
      return request === requests;
    };
    const found = await descend(equilibrium, compliance, force, displacement, wanted);
    if (!found) return;
    reply({ kind: "descent", number: data.number, displacement: Float32Array.from(found) });
  } else {
    latest = data.number;
    const wanted = async (): Promise<boolean> => {
      await pause();
      return latest === data.number;
    };
    const certificate = await certify(equilibrium, data.force, data.displacement, wanted);
    reply({ kind: "certificate", number: data.number, certificate });
  }
};
