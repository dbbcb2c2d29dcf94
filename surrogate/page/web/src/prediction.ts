/** Fields under the loads, by a network, a load series or time steps, and their estimated error. */

import { bytes } from "./content";
import { BODY, type Part } from "./loads";
import { Mechanics } from "./mechanics/mechanics";
import { Network, type Fields } from "./network";
import { Responses } from "./responses";
import type { State } from "./state";

const PROBE = 0.01; // of the training's largest force, under which a network shows responses

export class Prediction {
  /** Those of the body at rest, or in a time step; of the network, on a page without it. */
  responses!: Responses;
  /** Resolves when the network is there. */
  readonly ready: Promise<void>;
  private mechanics: Mechanics | null = null;
  private network: Network | null = null;
  /** Whether the last time step has come to its end. */
  isOver = false;

  /** @param arrived - called when more is known than before */
  constructor(
    private readonly state: State,
    private readonly arrived: () => void,
  ) {
    this.restart();
    this.ready = this.start();
  }

  /** Forget what is known, and begin a motion at the present displacement if the body moves. */
  restart(): void {
    const { loads, motion, displacement, content, stiffness } = this.state;
    this.responses = new Responses(loads, (units) => this.responsesTo(units), this.arrived);
    if (!motion.isOn) return;
    const start = Float64Array.from(displacement ?? new Float64Array(content.coordinates.length));
    this.mechanics?.begin(loads.loading(stiffness), start);
    motion.time = 0;
    this.isOver = false;
  }

  /** The time step is taken. */
  goOn(): void {
    this.isOver = true;
    this.state.motion.time += this.state.content.body!.motion!.step;
  }

  /** Start the workers, and the network if there is one. */
  private async start(): Promise<void> {
    const { responding, body, series, actuation } = this.state.content;
    if (responding) this.mechanics = new Mechanics(responding, body, actuation);
    if (document.readyState === "loading") {
      await new Promise((resolve) => {
        document.addEventListener("DOMContentLoaded", resolve, { once: true });
      });
    }
    if (series > 0) return;
    this.network = await Network.start(
      ...(await Promise.all([bytes("network"), bytes("runtime")])),
    );
  }

  /** Fields under the present loads; null for a body at rest, and while something is missing. */
  async fields(): Promise<Fields | null> {
    const { loads, stiffness, content, isLoaded, motion } = this.state;
    this.mechanics?.forget();
    if (motion.isOn) return this.mechanics && this.moved(this.mechanics);
    if (!isLoaded) this.state.actuated = null;
    if (!isLoaded) return null;
    if (content.actuation) return this.mechanics && this.actuated(this.mechanics);
    if (content.series === 0) return this.predicted(loads.parts(), stiffness);
    return this.mechanics && { displacement: this.nodal(await this.series(this.mechanics)) };
  }

  /** Estimate the error of the fields; the equilibrium takes the place of those of a series. */
  async estimate(): Promise<boolean> {
    const { state, mechanics } = this;
    const { displacement, content } = state;
    if (!mechanics || !content.certified || !displacement) return false;
    const points = content.series > 0 ? new Float32Array(displacement.buffer) : displacement;
    const loading = state.loads.loading(state.stiffness);
    if (state.actuated) loading.pressures = state.actuated.amplitudes;
    const certificate = await mechanics.estimate(loading, Float64Array.from(points));
    if (!certificate) return false;
    state.certificate = certificate;
    const { corrected } = certificate;
    if (content.series === 0 || !corrected) return true;
    const shown = this.nodal(Float32Array.from(corrected.displacement));
    const error = corrected.error.map((value, i) => value + shown[i] - corrected.displacement[i]); // with that of single precision
    state.fields = { displacement: shown };
    if (state.actuated) state.actuated.quantities = corrected.quantities;
    state.certificate = { ...certificate, error };
    return true;
  }

  /** At the end of a time step; null if there is none. */
  private async moved(mechanics: Mechanics): Promise<Fields | null> {
    const { loads, stiffness, content, motion } = this.state;
    const damping = 2 * motion.damping * content.body!.motion!.frequency * Math.sqrt(stiffness);
    const loading = loads.loading(stiffness);
    const found = await mechanics.step(loading, damping, stiffness, this.isOver);
    this.isOver = false;
    if (!found) return null;
    const error = this.nodal(found.error);
    this.state.certificate = { error, inverted: 0, settled: true, corrected: null };
    motion.way = found.way;
    return { displacement: Float32Array.from(this.nodal(found.displacement)) };
  }

  /** Under actuators, which a target moves. */
  private async actuated(mechanics: Mechanics): Promise<Fields> {
    const { state } = this;
    const { given } = state.loads;
    const loading = state.loads.loading(state.stiffness);
    const found = await mechanics.actuated(loading, given, state.target);
    if (state.target) given.splice(0, Infinity, ...found.given);
    state.actuated = found;
    return { displacement: this.nodal(found.displacement) };
  }

  private series(mechanics: Mechanics): Promise<Float32Array> {
    const { loads, stiffness, content } = this.state;
    return mechanics.series(loads.loading(stiffness), content.series);
  }

  /** What is drawn of displacements of all points: those of the nodes, which come first. */
  private nodal<T extends Float32Array | Float64Array>(points: T): T {
    const { nodes, d } = this.state.content;
    return points.subarray(0, nodes * d) as T;
  }

  /** Fields of the network; null while it or a response is missing. */
  private async predicted(parts: readonly Part[], stiffness: number): Promise<Fields | null> {
    const { loads, content } = this.state;
    const { places, nodes, d, needsResponse } = content;
    const softer = parts.map(({ key, force }) => ({ key, force: force.map((f) => f / stiffness) }));
    const response = needsResponse ? this.responses.sum(softer, nodes * d) : null;
    if (!this.network || (needsResponse && !response)) return null;
    if (places) {
      const known = content.volumes ? [BODY, ...places] : places;
      const load = new Float32Array(known.length * d);
      for (const { key, force } of softer) load.set(force, known.indexOf(key) * d);
      return this.network.predict({ load }, [1, load.length]);
    }
    const force = Float32Array.from(loads.nodal(softer));
    return this.network.predict({ force, ...(response && { response }) }, [1, nodes, d]);
  }

  private async responsesTo(units: readonly Part[]): Promise<Float64Array[]> {
    const { loads, content } = this.state;
    const forces = units.map((unit) => loads.nodal([unit]));
    if (this.mechanics) return this.mechanics.columns(forces, this.state.motion.isOn);
    await this.ready;
    const probe = PROBE * Math.max(...content.largest);
    const columns: Float64Array[] = [];
    for (const { key, force } of units) {
      const fields = await this.predicted([{ key, force: force.map((f) => f * probe) }], 1);
      columns.push(Float64Array.from(fields!.displacement, (u) => u / probe));
    }
    return columns;
  }
}
