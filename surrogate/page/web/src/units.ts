/** Numbers with units, as people read them. */

const PREFIXES: [number, string][] = [
  [1, ""],
  [1e-3, "m"],
  [1e-6, "µ"],
  [1e-9, "n"],
];

/** The prefix in which a number has digits before the point: its factor, and its letter. */
export function prefixOf(value: number): [number, string] {
  const found = PREFIXES.find(([factor]) => Math.abs(value) >= factor * (1 - 5e-4));
  return value === 0 ? PREFIXES[0] : (found ?? PREFIXES.at(-1)!);
}

/** A number with three significant digits, and a minus sign that is as wide as a plus sign. */
export function digits(value: number, count = 3): string {
  const text = Math.abs(value) < 1e-12 ? "0" : Number(value.toPrecision(count)).toString();
  return text.replace("-", "−");
}

function inUnit(value: number, unit: string, count: number): string {
  const [factor, letter] = prefixOf(value);
  return `${digits(value / factor, count)} ${letter}${unit}`;
}

export function inMetres(value: number, count = 3): string {
  return inUnit(value, "m", count);
}

export function inNewtons(value: number, count = 3): string {
  return inUnit(value, "N", count);
}

const STEPS = [1, 1.2, 1.6, 2, 2.4, 3, 4, 5, 6, 8, 10];

/** The smallest of some round numbers, whose halves are round too, that is at least a positive one. */
export function ceiling(value: number): number {
  const power = 10 ** Math.floor(Math.log10(value));
  return STEPS.map((factor) => factor * power).find((c) => c >= value * (1 - 1e-9))!;
}
