/** What `surrogate page` has written into the file: the body, the network, onnxruntime's WebAssembly. */

import type { Body, Rows } from "./mechanics/messages";
import { readBody, readRows, type BodyText, type Find } from "./mechanics/read_body";
import type { TrainingRange } from "./training_range";

/** Plain data of the page (`surrogate/page/page.py`). */
interface Text {
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
  deviations: Record<string, "epistemic" | "aleatoric">;
  limit: number[];
  loads: TrainingRange["loads"];
  /** Largest components of a dragged force in N, which set the length of arrows. */
  largest: number[];
  /** Radius in m of the patch that a dragged force is spread over; 0 for a force on a node. */
  patch: number;
  /** Largest components of the body force in N/m³; null for a case without one. */
  density: number[] | null;
  /** Nodes of a large body that can be touched, whose unit loads its network knows; null for all. */
  places: number[] | null;
  /** Surfaces that pressures follow, by their groups, and the largest pressures of the case in Pa. */
  pressed: string[];
  largestPressures: number[];
  passes: number | null;
  /** Young's modulus at rest in Pa; null for a body of several materials, or of unknown ones. */
  youngModulus: number | null;
  /** Radius in m of the sphere that pushes the body, at first. */
  radius: number;
  arrays: Partial<Record<string, { type: string; shape: number[]; offset: number }>>;
}

/** Bodies as they are written. */
interface Written extends Text {
  body: BodyText | null;
  response: BodyText | null;
}

/** All that is known of the body before the network is read. */
export interface Content extends Text {
  d: number;
  nodes: number;
  /** (nodes, d) in m. */
  coordinates: Float64Array;
  cells: Int32Array;
  /** (nodes, d), components that supports hold. */
  held: Uint8Array;
  /** Nodes that do not move at all. */
  clamped: Uint8Array;
  loadable: Uint8Array;
  /** Node of every vertex of the triangles. */
  vertices: Int32Array;
  triangles: Int32Array;
  lines: Int32Array;
  features: Int32Array;
  supports: Int32Array;
  /** The body of the finite elements; null where no errors are estimated. */
  body: Body | null;
  /** That of the linear response, or of the series. */
  responding: Body | null;
  certified: boolean;
  /** Forces in N of 1 Pa on every surface of the undeformed body, (surfaces, nodes, d). */
  pushes: Float64Array | null;
  /** Nodes, with weights, that a force about a node reaches by way of its patch. */
  patches: Rows | null;
  /** What of the body belongs to each node, in m³. */
  volumes: Float64Array | null;
  trained: TrainingRange;
}

const VIEWS = { float64: Float64Array, int32: Int32Array, uint8: Uint8Array } as const;

/** Read text and arrays. */
export async function readContent(): Promise<Content> {
  const text = JSON.parse(element("content").textContent) as Written;
  const block = (await bytes("arrays")).buffer;
  const array: Find = (name) => {
    const entry = text.arrays[name];
    if (!entry) return null;
    const length = entry.shape.reduce((product, n) => product * n, 1);
    return new VIEWS[entry.type as keyof typeof VIEWS](block, entry.offset, length);
  };
  const [nodes, d] = text.arrays.coordinates!.shape;
  const loadable = array("loadable") as Uint8Array;
  const held = array("held") as Uint8Array;
  const clamped = loadable.map((_, node) =>
    Number(held.subarray(node * d, (node + 1) * d).every((value) => value === 1)),
  );
  const none = text.limit.map(() => Infinity);
  const body = text.body && readBody(text.body, array);
  const response =
    text.response &&
    readBody(text.response, (name) =>
      name.startsWith("spread") ? null : array(`response${name}`),
    );
  const spread = readRows("spread", array);
  const responding = response ?? body;
  return {
    ...text,
    body,
    responding: responding && { ...responding, spread },
    certified: body !== null,
    pushes: array("pushes") as Float64Array | null,
    nodes,
    d,
    coordinates: array("coordinates") as Float64Array,
    cells: array("cells") as Int32Array,
    held,
    clamped,
    loadable,
    trained: text.series
      ? { limit: none, largest: none, loadable: loadable.map(() => 1), loads: null }
      : { limit: text.limit, largest: text.largest, loadable, loads: text.loads },
    vertices: array("vertices") as Int32Array,
    triangles: array("triangles") as Int32Array,
    lines: array("lines") as Int32Array,
    features: array("features") as Int32Array,
    supports: array("supports") as Int32Array,
    patches: readRows("patch", array),
    volumes: array("volumes") as Float64Array | null,
  };
}

/** Read and unpack the bytes of an element, base64 of a gzip file. */
export async function bytes(id: string): Promise<Uint8Array<ArrayBuffer>> {
  const packed = fromBase64(element(id).textContent);
  const stream = new Blob([packed]).stream().pipeThrough(new DecompressionStream("gzip"));
  return new Uint8Array(await new Response(stream).arrayBuffer());
}

function element(id: string): Element & { textContent: string } {
  return document.getElementById(id) as unknown as Element & { textContent: string };
}

function fromBase64(text: string): Uint8Array<ArrayBuffer> {
  const modern = Uint8Array as unknown as {
    fromBase64?: (text: string) => Uint8Array<ArrayBuffer>;
  };
  if (modern.fromBase64) return modern.fromBase64(text);
  return Uint8Array.from(atob(text), (letter) => letter.charCodeAt(0));
}
