/** The page's side of its two workers: one answers at once, one may be long at an estimate. */

import script from "worker-script";
import type { Actuation } from "./actuated_modes";
import type { Body, Loading } from "./body";
import type { Certificate } from "./certificate";
import type { Moment } from "./motion";
import type { Target } from "./reach";
import type { Actuated, Answers } from "./worker";

/** A worker with a body of its own. */
class Helper {
  private readonly worker = new Worker(
    URL.createObjectURL(new Blob([script], { type: "text/javascript" })),
  );
  private readonly waiting = new Map<number, (answer: never) => void>();
  private asked = 0;

  constructor(body: Body, actuation: Actuation | null = null) {
    this.worker.onmessage = ({ data }: MessageEvent<{ number: number; answer: never }>) => {
      this.waiting.get(data.number)!(data.answer);
      this.waiting.delete(data.number);
    };
    void this.ask("body", body, actuation);
  }

  ask<K extends keyof Answers>(
    kind: K,
    ...given: Parameters<Answers[K]>
  ): Promise<Awaited<ReturnType<Answers[K]>>> {
    return new Promise((resolve) => {
      this.waiting.set(++this.asked, resolve); // the worker counts, too
      this.worker.postMessage({ kind, given });
    });
  }
}

export class Mechanics {
  private readonly responding: Helper;
  private readonly estimating: Helper | null;
  private latest = 0;

  /**
   * @param responding - body of linear responses and series
   * @param body - of estimates and motion; null for none
   * @param actuation - of the actuators; null for none
   */
  constructor(responding: Body, body: Body | null, actuation: Actuation | null) {
    this.responding = new Helper(responding, actuation);
    this.estimating = body && new Helper(body);
  }

  /** The load series in m, at all points, to some order. */
  series(loading: Loading, order: number): Promise<Float32Array> {
    return this.responding.ask("series", loading, order);
  }

  /** What actuators do beside loads, or on the way of a node to a target. */
  actuated(loading: Loading, given: number[], target: Target | null): Promise<Actuated> {
    return this.responding.ask("actuated", loading, given, target);
  }

  /** Responses in m to nodal forces in N; in the present time step, if the body moves. */
  columns(forces: Float64Array[], moves: boolean): Promise<Float64Array[]> {
    return (moves ? this.estimating! : this.responding).ask("columns", forces);
  }

  /** Begin a motion from rest at a displacement in m. */
  begin(loading: Loading, start: Float64Array): void {
    this.forget();
    void this.estimating!.ask("begin", loading, start);
  }

  /** The end of a time step, as the worker has it. */
  step(...given: Parameters<Answers["step"]>): Promise<Moment | null> {
    return this.estimating!.ask("step", ...given);
  }

  /** Estimate the error of a prediction; null if none is asked for, or it is forgotten meanwhile. */
  async estimate(loading: Loading, displacement: Float64Array): Promise<Certificate | null> {
    const number = ++this.latest;
    const found = await this.estimating?.ask("certificate", loading, displacement);
    return number === this.latest ? (found ?? null) : null;
  }

  /** Forget the estimate that was asked for last. */
  forget(): void {
    this.latest++;
  }
}
