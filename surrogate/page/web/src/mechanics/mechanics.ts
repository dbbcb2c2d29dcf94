/** The page's side of its two workers: one answers at once, one may be long at an estimate. */

import script from "worker-script";
import type { Part } from "../loads";
import type { Certificate } from "./certificate";
import type { Body, Loading, Reply, Request } from "./messages";

export class Mechanics {
  private readonly responding: Worker;
  private readonly estimating: Worker;
  private readonly columns = new Map<number, Float64Array[]>();
  private readonly requested = new Set<number>();
  private number = 0;
  private receive: (certificate: Certificate) => void = () => undefined;
  private receiveSeries: (displacement: Float32Array) => void = () => undefined;

  /**
   * @param responding - body of linear responses and series
   * @param body - of estimates; null for none
   * @param onColumns - called when responses to a load have arrived
   */
  constructor(responding: Body, body: Body | null, onColumns: () => void) {
    const url = URL.createObjectURL(new Blob([script], { type: "text/javascript" }));
    this.responding = new Worker(url);
    this.estimating = new Worker(url);
    this.responding.onmessage = ({ data }: MessageEvent<Reply>) => {
      if (data.kind === "series") this.receiveSeries(data.displacement);
      if (data.kind !== "columns") return;
      this.columns.set(data.key, data.columns);
      onColumns();
    };
    this.estimating.onmessage = ({ data }: MessageEvent<Reply>) => {
      if (data.kind !== "certificate" || data.number !== this.number || !data.certificate) return;
      this.receive(data.certificate);
    };
    this.send(this.responding, { kind: "body", body: responding });
    if (body) this.send(this.estimating, { kind: "body", body });
  }

  /** The load series in m, at all points, to some order; one is asked for at a time. */
  series(loading: Loading, order: number): Promise<Float32Array> {
    return new Promise((resolve) => {
      this.receiveSeries = resolve;
      this.send(this.responding, { kind: "series", loading, order });
    });
  }

  /** Ask for the responses to the unit components of a load, once. */
  request(key: number, forces: () => Float64Array[]): void {
    if (this.requested.has(key)) return;
    this.requested.add(key);
    this.send(this.responding, { kind: "columns", key, forces: forces() });
  }

  /** Responses in m to the unit components of a load; null until they are there. */
  columnsOf(key: number): Float64Array[] | null {
    return this.columns.get(key) ?? null;
  }

  /** The linear response in m to some loads; null until all of their columns are there. */
  response(loads: readonly Part[], size: number): Float64Array | null {
    const sum = new Float64Array(size);
    for (const { key, force } of loads) {
      const columns = this.columns.get(key);
      if (!columns) return null;
      columns.forEach((column, component) => {
        const newtons = force[component];
        if (newtons !== 0) for (let i = 0; i < size; i++) sum[i] += newtons * column[i];
      });
    }
    return sum;
  }

  /** Estimate the error of a prediction, and forget the estimates asked for before. */
  estimate(
    loading: Loading,
    displacement: Float64Array,
    receive: (certificate: Certificate) => void,
  ): void {
    this.receive = receive;
    this.number++;
    this.send(this.estimating, { kind: "certificate", loading, displacement, number: this.number });
  }

  /** Forget the estimate that was asked for last. */
  forget(): void {
    this.number++;
  }

  private send(worker: Worker, request: Request): void {
    worker.postMessage(request);
  }
}
