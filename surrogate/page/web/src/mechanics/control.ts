/** What is given of a load that follows the body, as `shared_schema/actuators/control.py`: h(a, q) = 0. */

export interface Control {
  kind: "tension" | "length" | "pressure" | "volume" | "gas";
  /** Length in m or volume in m³ at rest. */
  rest: number;
  /** Pressure around the body in Pa, of a gas. */
  ambient: number;
}

/** h, and its derivatives by amplitude, quantity and what is given. */
export type Equation = [value: number, byAmplitude: number, byQuantity: number, byGiven: number];

const STIFF = 1e6; // N/m: of a cable that is taut or not

/** Whether tension or pressure are given. */
export function givesAmplitude({ kind }: Control): boolean {
  return kind === "tension" || kind === "pressure";
}

/** h(a, q) of a given number. */
export function equation(control: Control, given: number, a: number, q: number): Equation {
  const { kind, rest, ambient } = control;
  if (kind === "gas") {
    const scale = Math.max(ambient, Math.abs(given), Number.MIN_VALUE) * rest;
    const value = ((ambient + a) * q - (ambient + given) * rest) / scale;
    return [value, q / scale, (ambient + a) / scale, -rest / scale];
  }
  const isTaut = a + STIFF * (q - given) > 0;
  if (kind === "volume" || (kind === "length" && isTaut))
    return [(q - given) / rest, 0, 1 / rest, -1 / rest];
  return givesAmplitude(control) ? [a - given, 1, 0, -1] : [a, 1, 0, 0];
}
