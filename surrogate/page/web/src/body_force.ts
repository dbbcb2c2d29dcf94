/** The body force: a slider and a number for every component. */

import { make } from "./elements";
import type { State } from "./state";
import { forceUnit, lengthUnit, typed } from "./units";

const STEPS = 100; // of a slider, to each side

export class BodyForce {
  readonly element: HTMLElement;
  private readonly inputs: [HTMLInputElement, HTMLInputElement][];

  /** @param largest - components of the largest body force in N/m³ */
  constructor(
    private readonly state: State,
    largest: readonly number[],
    changed: () => void,
  ) {
    const { force } = state.loads.body;
    this.inputs = largest.map((most, i): [HTMLInputElement, HTMLInputElement] => {
      const set = ({ target }: Event): void => {
        const { valueAsNumber } = target as HTMLInputElement;
        if (!Number.isFinite(valueAsNumber)) return;
        force[i] = valueAsNumber;
        changed();
      };
      const ends = { min: String(-most), max: String(most), step: String(most / STEPS) };
      const name = `b${"xyz"[i]}`;
      const slider = { type: "range", ...ends, input: set, "aria-label": name };
      return [make("input", slider), make("input", { type: "number", step: "any", input: set })];
    });
    const unit = `${forceUnit()}/${lengthUnit()}³`;
    const rows = this.inputs.map(([slider, number], i) =>
      make("label", { class: "slider" }, `b${"xyz"[i]} in ${unit}`, slider, number),
    );
    this.element = make("div", { id: "body-force" }, ...rows);
    this.update();
  }

  /** Show the body force. */
  update(): void {
    this.inputs.flat().forEach((input, place) => {
      const value = typed(this.state.loads.body.force[place >> 1]);
      if (document.activeElement !== input) input.value = value;
    });
  }
}
