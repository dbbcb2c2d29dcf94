/** The network: the file of `surrogate export`, run by onnxruntime-web on one thread. */

import { env, InferenceSession, Tensor } from "onnxruntime-web/wasm";

/** Nodal fields in m, (nodes · d), by the names of the network's outputs. */
export type Fields = Record<string, Float32Array>;

export class Network {
  private constructor(private readonly session: InferenceSession) {}

  /**
   * Start the runtime and read the network.
   *
   * @param model - ONNX file
   * @param runtime - onnxruntime-web's WebAssembly
   */
  static async start(model: Uint8Array, runtime: Uint8Array<ArrayBuffer>): Promise<Network> {
    env.wasm.numThreads = 1;
    env.wasm.wasmBinary = runtime.buffer;
    return new Network(await InferenceSession.create(model, { executionProviders: ["wasm"] }));
  }

  /** Predict fields from inputs of one shape, by their names. */
  async predict(
    inputs: Record<string, Float32Array | Float64Array>,
    shape: number[],
  ): Promise<Fields> {
    const tensors = Object.entries(inputs).map(([name, values]) => [name, asTensor(values, shape)]);
    const outputs = await this.session.run(Object.fromEntries(tensors) as Record<string, Tensor>);
    return Object.fromEntries(
      Object.entries(outputs).map(([name, tensor]) => [name, tensor.data as Float32Array]),
    );
  }
}

function asTensor(values: Float32Array | Float64Array, shape: number[]): Tensor {
  if (values instanceof Float32Array) return new Tensor("float32", values, shape);
  return new Tensor("float64", values, shape);
}
