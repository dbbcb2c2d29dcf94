/** Messages between the page and its worker. */

import type { CellType } from "./elements";
import type { Material } from "./solid";
import type { Certificate } from "./certificate";

/** Nodes with weights, of each node. */
export interface Rows {
  starts: Int32Array;
  nodes: Int32Array;
  weights: Float64Array;
}

/** The body of the page's mechanics. */
export interface Body {
  coordinates: Float64Array;
  cells: Int32Array;
  cellType: CellType;
  order: Int32Array;
  material: Material;
  /** Nodes, with weights, that a force at each node reaches by way of an embedded grid. */
  spread: Rows | null;
}

export type Request =
  | { kind: "body"; body: Body }
  | { kind: "columns"; key: number; forces: Float64Array[] }
  | { kind: "series"; force: Float64Array; order: number }
  | { kind: "descent"; force: Float64Array; displacement: Float64Array; number: number }
  | { kind: "certificate"; force: Float64Array; displacement: Float64Array; number: number };

export type Reply =
  | { kind: "columns"; key: number; columns: Float64Array[] }
  | { kind: "series"; displacement: Float32Array }
  | { kind: "descent"; number: number; displacement: Float32Array }
  | { kind: "certificate"; number: number; certificate: Certificate | null };
