/** The body of the page's mechanics, from what `surrogate/page/body_data.py` has written. */

import type { Body, Rows } from "./messages";
import type { Recording } from "./recording";

/** Plain data of a body. */
export interface BodyText extends Pick<Body, "nodes" | "laws" | "gradients" | "rounding"> {
  dilation: Omit<NonNullable<Body["dilation"]>, "nodes"> | null;
  facet: Recording | null;
}

/** An array by its name; null if there is none. */
export type Find = (name: string) => Float64Array | Int32Array | Uint8Array | null;

export function readBody(text: BodyText, find: Find): Body {
  const integers = (name: string): Int32Array => find(name) as Int32Array;
  const { dilation, facet, gradients } = text;
  const parts = integers("parts");
  return {
    ...text,
    d: (gradients[0].length * parts.length) / integers("elements").length,
    coordinates: find("points") as Float64Array,
    cells: integers("elements"),
    parts,
    volumes: find("volumesOfPoints") as Float64Array,
    dilation: dilation && { ...dilation, nodes: integers("dilations") },
    fibres: find("fibres") as Float64Array | null,
    order: integers("order"),
    surfaces: facet && { facet, facets: integers("facets"), surfaces: integers("facetSurfaces") },
    between: readRows("between", find),
    spread: null,
  };
}

/** Weights of nodes, in rows. */
export function readRows(name: string, find: Find): Rows | null {
  const starts = find(`${name}Starts`) as Int32Array | null;
  const nodes = find(`${name}Nodes`) as Int32Array;
  return starts && { starts, nodes, weights: find(`${name}Weights`) as Float64Array };
}
