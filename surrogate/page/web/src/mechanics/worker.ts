/** The worker: columns of K⁻¹ of loaded nodes, load series, and estimated errors of predictions. */

import type { Body, Loading } from "./body";
import { certify, type Certificate } from "./certificate";
import { Equilibrium } from "./equilibrium";
import { loadSeries } from "./load_series";
import { atPoints } from "./points_between";
import { Solid } from "./solid";
import { gathered } from "./vectors";

let equilibrium: Equilibrium;
let latest = 0;

/** What the page asks for. */
const answers = {
  /** Become a body. */
  body: (body: Body): void => {
    equilibrium = new Equilibrium(new Solid(body));
  },

  /** Responses in m to nodal forces in N. */
  columns: (forces: Float64Array[]): Float64Array[] => {
    const { spread, d } = equilibrium.solid.body;
    return forces
      .map((force) => (spread ? gathered(spread, force, d) : force))
      .map((force) => equilibrium.linearResponse(onPoints(force)));
  },

  /** The load series in m, at all points, to some order. */
  series: ({ force, pressures }: Loading, order: number): Float32Array => {
    equilibrium.under(pressures);
    return Float32Array.from(loadSeries(equilibrium, onPoints(force), order));
  },

  /** The error of a displacement in m at the nodes; null once something else is asked for. */
  certificate: async (loading: Loading, given: Float64Array): Promise<Certificate | null> => {
    const asked = latest;
    equilibrium.under(loading.pressures);
    const force = onPoints(loading.force);
    const certificate = await certify(
      equilibrium,
      force,
      atPoints(equilibrium, given, force),
      async () => {
        await pause();
        return latest === asked;
      },
    );
    const { nodes, d } = equilibrium.solid.body;
    for (const field of [certificate, certificate?.corrected])
      if (field?.error) field.error = field.error.slice(0, nodes * d);
    return certificate;
  },
};

export type Answers = typeof answers;

self.onmessage = async ({ data }: MessageEvent<{ kind: keyof Answers; given: unknown[] }>) => {
  const number = ++latest;
  const answer = answers[data.kind] as (...given: unknown[]) => unknown;
  self.postMessage({ number, answer: await answer(...data.given) });
};

/** Forces on all points; they act at the nodes. */
function onPoints(force: Float64Array): Float64Array {
  const found = new Float64Array(equilibrium.size);
  found.set(force);
  return found;
}

/** Let messages arrive that wait. */
function pause(): Promise<void> {
  return new Promise((resolve) => setTimeout(resolve));
}
