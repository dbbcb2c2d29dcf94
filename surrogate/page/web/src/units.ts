/** Numbers with units, as people read them. */

/** Labels of the units of the case, and the length below which a length is a rounding error. */
export const units = { length: "m", force: "N", negligible: 0 };

const PREFIXES: [number, string][] = [
  [1e6, "M"],
  [1e3, "k"],
  [1, ""],
  [1e-3, "m"],
  [1e-6, "µ"],
  [1e-9, "n"],
  [1e-12, "p"],
];

/** The unit in which a number has digits before the point: its factor, and its label. */
export function unitOf(value: number, unit: string): [number, string] {
  if (unit === "m³" && Math.abs(value) < 0.1) return [1e-6, "cm³"];
  if (!["m", "N", "Pa"].includes(unit) || value === 0) return [1, unit];
  const found = PREFIXES.find(([factor]) => Math.abs(value) >= factor * (1 - 5e-4));
  const [factor, letter] = found ?? PREFIXES.at(-1)!;
  return [factor, letter + unit];
}

/** A number with three significant digits, and a minus sign that is as wide as a plus sign. */
export function digits(value: number, count = 3): string {
  return Number(value.toPrecision(count)).toString().replaceAll("-", "−");
}

/** A number for a field to type in, with four significant digits. */
export function typed(value: number): string {
  return String(Number(value.toPrecision(4)));
}

export function inUnit(value: number, unit: string, count: number): string {
  const [factor, label] = unitOf(value, unit);
  return `${digits(value / factor, count)} ${label}`;
}

/** Without rounding errors: a length that the body's size makes negligible is zero. */
function rounded(length: number): number {
  return Math.abs(length) < units.negligible ? 0 : length;
}

export function asLength(value: number, count = 3): string {
  return inUnit(rounded(value), units.length, count);
}

export function asForce(value: number, count = 3): string {
  return inUnit(value, units.force, count);
}

/** Coordinates in the unit of the case, in parentheses. */
export function place(x: ArrayLike<number>, count = 3): string {
  return `(${Array.from(x, (value) => digits(rounded(value), count)).join(", ")})`;
}

const STEPS = [1, 1.2, 1.6, 2, 2.4, 3, 4, 5, 6, 8, 10];

/** The smallest of some round numbers, whose halves are round too, that is at least a positive one; 1 for zero. */
export function ceiling(value: number): number {
  if (value <= 0) return 1;
  const power = 10 ** Math.floor(Math.log10(value));
  return STEPS.map((factor) => factor * power).find((c) => c >= value * (1 - 1e-9))!;
}
