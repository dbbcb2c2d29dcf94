/** The body and its loads, as the workers get them. */

import type { Law, Recording } from "./recording";

/** Nodes with weights, of each node. */
export interface Rows {
  starts: Int32Array;
  nodes: Int32Array;
  weights: Float64Array;
}

/** Facets that pressures follow, seen from outside. */
export interface Surfaces {
  /** Forces of a unit pressure on a facet, of the positions of its points. */
  facet: Recording;
  /** Points of every facet, and the number of the load that presses it. */
  facets: Int32Array;
  units: Int32Array;
}

/** Places that cables run through, in their order. */
export interface Cables {
  /** Points of the body, with weights, whose sum each place is, with one that is fixed, in m. */
  places: Rows;
  fixed: Float64Array;
  /** Number of the load of each place. */
  units: Int32Array;
}

/** Elements of a body, or some of them. */
export interface Elements {
  d: number;
  /** Of all points of the elements in m, (points, d). */
  coordinates: Float64Array;
  cells: Int32Array;
  /** Number of every cell's law; cells are sorted by it. */
  parts: Int32Array;
  laws: Law[];
  /** ∂N_b/∂ξ_j at the quadrature points of the reference cell, (corners · d) each. */
  gradients: number[][];
  /** Of the quadrature points in m^d, (cells, points). */
  volumes: Float64Array;
  /** Functions of a dilation θ that elements have in place of J: at the quadrature points, and their
   * numbers in every cell; whether cells share them. */
  dilation?: { shapes: number[][]; nodes: Int32Array; joined: boolean };
  /** Unit directions of fibres, (cells, families, d). */
  fibres?: Float64Array;
}

/** What a body with a density needs to move, as `surrogate/page/page_motion.py` writes it. */
export interface Moving {
  /** Step h in s; β, γ; (1 − α_m), α_m and α_f over (1 − α_f). */
  step: number;
  beta: number;
  gamma: number;
  fresh: number;
  former: number;
  carried: number;
  /** Of the first vibration ω in 1/s, and its damping ratio at first. */
  frequency: number;
  damping: number;
  /** M of a component of the displacement in kg. */
  mass: Rows;
}

/** The body of the page's mechanics, as `surrogate/page/body.py` writes it. */
export interface Body extends Elements {
  /** Number of the points that are nodes of the mesh, the first ones. */
  nodes: number;
  /** Rounding errors: of Π in J; of ‖r‖ at rest in N, and per ‖u‖ in N/m. */
  rounding: { energy: number; atRest: number; perDisplacement: number };
  /** Free unknowns: displacements, point · d + component, then θ and p. */
  order: Int32Array;
  surfaces?: Surfaces;
  cables?: Cables;
  /** Nodes, with weights, whose mean each point between the nodes is at first. */
  between?: Rows;
  /** Nodes, with weights, whose forces reach each node by way of an embedded grid. */
  spread?: Rows;
  motion?: Moving;
}

/** Forces in N, and amplitudes of the loads that follow the body in Pa or N. */
export interface Loading {
  force: Float64Array;
  pressures: number[];
}
