/** What `surrogate page` has written into the file: the body, the network, onnxruntime's WebAssembly. */

import type { Actuation } from "./mechanics/actuated_modes";
import type { Body, Rows } from "./mechanics/body";
import { at } from "./mechanics/vectors";
import type { TrainingRange } from "./training_range";

/** What `surrogate/page/page.py` has written: plain data, and arrays. */
interface Written {
  case: string;
  network: string;
  run: string;
  /** Labels of the units of the case. */
  units: { length: string; force: string };
  /** Number of corners of a cell. */
  corners: number;
  needsResponse: boolean;
  /** Order of the load series that predicts in place of a network; 0 if there is a network. */
  series: number;
  /** What predicts in place of both on a body with actuators. */
  actuation: Actuation | null;
  deviations: Record<string, "epistemic" | "aleatoric">;
  limit: number[];
  loads: TrainingRange["loads"];
  /** Largest components of a dragged force in N, which set the length of arrows. */
  largest: number[];
  /** Radius in m of the patch that a dragged force is spread over; 0 for a force on a node. */
  patch: number;
  /** Nodes of a large body that can be touched, whose unit loads its network knows; null for all. */
  places: number[] | null;
  /** Surfaces that pressures follow, by their groups. */
  pressed: string[];
  passes: number | null;
  /** Young's modulus at rest in Pa; null for a body of several materials, or of unknown ones. */
  youngModulus: number | null;
  /** Radius in m of the sphere that pushes the body, at first. */
  radius: number;
  /** Largest one of the body along an axis in m. */
  extent: number;
  /** Type, shape and place of every array, by its path in all of this. */
  arrays: Record<string, { type: keyof typeof VIEWS; shape: number[]; offset: number }>;
  /** (nodes, d) in m. */
  coordinates: Float64Array;
  cells: Int32Array;
  /** (nodes, d), components that supports hold. */
  held: Uint8Array;
  /** Nodes that do not move at all. */
  clamped: Uint8Array;
  /** Nodes that were loaded in training. */
  loadable: Uint8Array;
  /** Node of every vertex of the triangles. */
  vertices: Int32Array;
  triangles: Int32Array;
  lines: Int32Array;
  features: Int32Array;
  /** Nodes of the corners of what lies between two materials: triangles, in the plane lines. */
  seams: Int32Array;
  /** Marks of the supports in m: ends of lines, corners of triangles, and points, (n, 3) each. */
  marks: { lines: Float64Array; faces: Float64Array; points: Float64Array };
  /** The body of the finite elements; null where no errors are estimated. */
  body: Body | null;
  /** That of a linear response which is another one. */
  response: Body | null;
  /** Nodes, with weights, whose forces reach each node by way of an embedded grid. */
  spread?: Rows;
  /** Forces in N of 1 Pa on every surface of the undeformed body, (surfaces, nodes, d). */
  pushes?: Float64Array;
  /** Nodes, with weights, that a force about a node reaches by way of its patch. */
  patches?: Rows;
  /** What of the body belongs to each node, in m³. */
  volumes?: Float64Array;
}

/** All that is known of the body before the network is read. */
export interface Content extends Written {
  d: number;
  nodes: number;
  /** The body of the linear response, or of the series. */
  responding: Body | null;
  certified: boolean;
  /** The loads of the training; null for a series, which has none. */
  trained: TrainingRange | null;
  /** Coordinates of a node in m. */
  place: (node: number) => number[];
}

const VIEWS = { float64: Float64Array, int32: Int32Array, uint8: Uint8Array } as const;

/** Read text and arrays. */
export async function readContent(): Promise<Content> {
  const written = JSON.parse(element("content").textContent) as Written;
  const block = (await bytes("arrays")).buffer;
  for (const [path, { type, shape, offset }] of Object.entries(written.arrays)) {
    const length = shape.reduce((product, n) => product * n, 1);
    put(written, path, new VIEWS[type](block, offset, length));
  }
  const { body, coordinates, spread } = written;
  const [nodes, d] = written.arrays.coordinates.shape;
  const responding = written.response ?? body;
  return {
    ...written,
    nodes,
    d,
    responding: responding && { ...responding, ...(spread && { spread }) },
    certified: body !== null,
    trained: written.series > 0 ? null : written,
    place: (node) => [...at(coordinates, node, d)],
  };
}

/** Put a value where its path leads, below parts that are there or not. */
export function put(into: object, path: string, value: unknown): void {
  const names = path.split("/");
  const last = names.pop()!;
  let part = into as Record<string, object>;
  for (const name of names) part = (part[name] ??= {}) as Record<string, object>;
  Object.assign(part, { [last]: value });
}

/** Read and unpack the bytes of an element, base64 of a gzip file. */
export async function bytes(id: string): Promise<Uint8Array<ArrayBuffer>> {
  const packed = fromBase64(element(id).textContent);
  const stream = new Blob([packed]).stream().pipeThrough(new DecompressionStream("gzip"));
  return new Uint8Array(await new Response(stream).arrayBuffer());
}

function element(id: string): { textContent: string } {
  return document.getElementById(id) as unknown as { textContent: string };
}

function fromBase64(text: string): Uint8Array<ArrayBuffer> {
  const modern = Uint8Array as { fromBase64?: (text: string) => Uint8Array<ArrayBuffer> };
  if (modern.fromBase64) return modern.fromBase64(text);
  return Uint8Array.from(atob(text), (letter) => letter.charCodeAt(0));
}
