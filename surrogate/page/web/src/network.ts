/** The network: the file of `surrogate export`, run by onnxruntime-web on one thread. */

import { env, InferenceSession, Tensor } from "onnxruntime-web/wasm";

/** Nodal fields in m, (nodes · d), by the names of the network's outputs. */
export type Fields = Record<string, Float32Array>;

export class Network {
  private constructor(
    private readonly session: InferenceSession,
    private readonly nodes: number,
    private readonly d: number,
  ) {}

  /**
   * Start the runtime and read the network.
   *
   * @param model - ONNX file
   * @param runtime - onnxruntime-web's WebAssembly
   */
  static async start(
    model: Uint8Array,
    runtime: Uint8Array<ArrayBuffer>,
    nodes: number,
    d: number,
  ): Promise<Network> {
    env.wasm.numThreads = 1;
    env.wasm.wasmBinary = runtime.buffer;
    const session = await InferenceSession.create(model, { executionProviders: ["wasm"] });
    return new Network(session, nodes, d);
  }

  /** Predict fields from forces in N and, for a network that needs it, the linear response in m. */
  async predict(force: Float32Array, response: Float64Array | null): Promise<Fields> {
    const shape = [1, this.nodes, this.d];
    const inputs: Record<string, Tensor> = { force: new Tensor("float32", force, shape) };
    if (response) inputs.response = new Tensor("float64", response, shape);
    return this.run(inputs);
  }

  /** Predict fields from the sizes of unit loads, of a network that knows some of them. */
  predictSizes(load: Float32Array): Promise<Fields> {
    return this.run({ load: new Tensor("float32", load, [1, load.length]) });
  }

  private async run(inputs: Record<string, Tensor>): Promise<Fields> {
    const outputs = await this.session.run(inputs);
    return Object.fromEntries(
      Object.entries(outputs).map(([name, tensor]) => [name, tensor.data as Float32Array]),
    );
  }
}
