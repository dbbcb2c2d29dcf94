/** Colour fields of the body: what they are called, and their colours from zero to the largest value. */

import { digits, unitOf, units } from "./units";

export type FieldName = "displacement" | "epistemic" | "aleatoric" | "error";

export interface ColourField {
  label: string;
  /** Colours from zero to the largest value, in equal steps. */
  palette: string[];
}

export const COLOUR_FIELDS: Record<FieldName, ColourField> = {
  displacement: {
    label: "Displacement",
    palette: ["#f4f1e6", "#cfe4d4", "#92c9c3", "#4fa1b6", "#2b709f", "#203f78", "#151c42"],
  },
  epistemic: {
    label: "Std. deviation, epistemic",
    palette: ["#f6f2ea", "#fbdcae", "#f7b267", "#ee7b3d", "#c8471f", "#872014", "#4a0d10"],
  },
  aleatoric: {
    label: "Std. deviation, aleatoric",
    palette: ["#f4f1ea", "#dfe5b8", "#b5cc6e", "#7fab3a", "#4b8322", "#275a18", "#12330f"],
  },
  error: {
    label: "Estimated error",
    palette: ["#f6f0f1", "#f0cfdb", "#e39abb", "#cd5e98", "#a12f79", "#6b1a5c", "#371037"],
  },
};

/** Title of the colour bar of a field whose largest value is given in m, and numbers along it. */
export function bar(field: FieldName, largest: number): { title: string; ticks: string[] } {
  const [factor, unit] = unitOf(largest, units.length);
  return {
    title: `${COLOUR_FIELDS[field].label} in ${unit}`,
    ticks: [0, 0.5, 1].map((part) => digits((part * largest) / factor)),
  };
}
