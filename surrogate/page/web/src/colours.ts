/** Colour fields of the body: what they are called, and their colours from zero to the largest value. */

import { digits, lengthUnit, unitOf } from "./units";

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

/** Colour of a body without values. */
export const NEUTRAL: Rgb = [0.8, 0.82, 0.85];

export type Rgb = [number, number, number];

/** Make a function from 0 … 1 to a colour. */
export function scale(palette: readonly string[]): (part: number, out: Rgb) => void {
  const stops = palette.map((colour) =>
    [1, 3, 5].map((place) => parseInt(colour.slice(place, place + 2), 16) / 255),
  );
  return (part, out) => {
    const at = Math.min(Math.max(part, 0), 1) * (stops.length - 1);
    const low = Math.min(Math.floor(at), stops.length - 2);
    for (let i = 0; i < 3; i++) {
      out[i] = stops[low][i] + (at - low) * (stops[low + 1][i] - stops[low][i]);
    }
  };
}

/** Title of the colour bar of a field whose largest value is given in m, and numbers along it. */
export function bar(field: FieldName, largest: number): { title: string; ticks: string[] } {
  const [factor, unit] = unitOf(largest, lengthUnit());
  return {
    title: `${COLOUR_FIELDS[field].label} in ${unit}`,
    ticks: [0, 0.5, 1].map((part) => digits((part * largest) / factor)),
  };
}
