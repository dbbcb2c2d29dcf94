/** The worker: columns of K⁻¹ of loaded nodes, load series, actuators, motion, and estimated errors of predictions. */

import { ActuatedModes, type Actuation } from "./actuated_modes";
import type { Body, Loading } from "./body";
import { certify, type Certificate } from "./certificate";
import { Equilibrium } from "./equilibrium";
import { loadSeries } from "./load_series";
import { Motion, type Moment } from "./motion";
import { atPoints } from "./points_between";
import { approach, type Target } from "./reach";
import { Solid } from "./solid";
import { at, gathered, norm, plus } from "./vectors";

let equilibrium: Equilibrium;
let modes: ActuatedModes;
let motion: Motion | null = null;
let latest = 0;

/** What actuators do. */
export interface Actuated {
  /** Of all points in m. */
  displacement: Float32Array;
  /** Amplitudes of all loads that follow the body in Pa or N, and lengths in m or volumes in m³. */
  amplitudes: number[];
  quantities: number[];
  /** What is given of the actuators. */
  given: number[];
  /** Whether that is all that was asked for, and a search has come to its end. */
  isWhole: boolean;
  /** Distance in m of a node from its target. */
  missed: number;
}

/** What the page asks for. */
const answers = {
  /** Become a body, with actuators if there are some. */
  body: (body: Body, actuation: Actuation | null): void => {
    equilibrium = new Equilibrium(new Solid(body));
    if (!actuation) return;
    modes = new ActuatedModes(actuation, equilibrium.following, equilibrium.size);
  },

  /** What actuators do beside forces and pressures; steps on the way of a node to a target. */
  actuated: (
    { force, pressures }: Loading,
    given: readonly number[],
    target: Target | null,
  ): Actuated => {
    const { coordinates, d } = equilibrium.solid.body;
    const onAll = onPoints(force);
    const work = modes.worksOf(onAll);
    const left = force.some(Boolean)
      ? modes.leftOut(equilibrium.linearResponse(onAll), work)
      : new Float64Array(equilibrium.size);
    const first = modes.first;
    const all = modes.at.given.map((_, i) => (i < first ? (pressures[i] ?? 0) : given[i - first]));
    let isWhole = modes.move(all, work) === 1;
    let missed = 0;
    if (target) {
      const { node, place } = target;
      const rest = plus(at(coordinates, node, d), at(left, node, d));
      const way = plus(Float64Array.from(place), rest, -1);
      isWhole = !isWhole || approach(modes, node, way, work);
      missed = norm(plus(at(modes.displacement(), node, d), way, -1));
    }
    return {
      displacement: Float32Array.from(plus(modes.displacement(), left)),
      amplitudes: [...modes.at.amplitudes],
      quantities: modes.quantities(),
      given: [...modes.at.given.subarray(first)],
      isWhole,
      missed,
    };
  },

  /** Responses in m to nodal forces in N. */
  columns: (forces: Float64Array[]): Float64Array[] => {
    const { spread, d } = equilibrium.solid.body;
    return forces
      .map((force) => (spread ? gathered(spread, force, d) : force))
      .map((force) => (motion ?? equilibrium).linearResponse(onPoints(force)));
  },

  /** The load series in m, at all points, to some order. */
  series: ({ force, pressures }: Loading, order: number): Float32Array => {
    equilibrium.under(pressures);
    return Float32Array.from(loadSeries(equilibrium, onPoints(force), order));
  },

  /** Be at rest at a displacement in m of the nodes. */
  begin: ({ force, pressures }: Loading, start: Float64Array): void => {
    equilibrium.under(pressures);
    motion = new Motion(equilibrium, atPoints(equilibrium, start, onPoints(force)));
  },

  /** The end of the next time step, or once more of the last one, as `Motion.step`. */
  step: (loading: Loading, c: number, stiffness: number, isNext: boolean): Moment | null => {
    if (isNext) motion!.goOn();
    const force = onPoints(loading.force);
    return motion!.step({ ...loading, force }, c, stiffness);
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
