/** Numbers that act everywhere, such as components of a body force: a slider and a field for each. */

import { make } from "./elements";
import { typed } from "./units";

const STEPS = 100; // of a slider, to each side

export class Sliders {
  readonly element: HTMLElement;
  private readonly inputs: [HTMLInputElement, HTMLInputElement][];

  /**
   * @param id - of the element
   * @param values - which the inputs change
   * @param largest - numbers at the ends of the sliders
   * @param names - of the sliders, and what stands before them
   */
  constructor(
    id: string,
    private readonly values: number[],
    largest: readonly number[],
    names: readonly [string, string][],
    changed: () => void,
  ) {
    this.inputs = largest.map((most, i): [HTMLInputElement, HTMLInputElement] => {
      const set = ({ target }: Event): void => {
        const { valueAsNumber } = target as HTMLInputElement;
        if (!Number.isFinite(valueAsNumber)) return;
        values[i] = valueAsNumber;
        changed();
      };
      const ends = { min: String(-most), max: String(most), step: String(most / STEPS) };
      const slider = { type: "range", ...ends, input: set, "aria-label": names[i][0] };
      return [make("input", slider), make("input", { type: "number", step: "any", input: set })];
    });
    const rows = this.inputs.map(([slider, number], i) =>
      make("label", { class: "slider" }, names[i][1], slider, number),
    );
    this.element = make("div", { id }, ...rows);
    this.update();
  }

  /** Show the numbers. */
  update(): void {
    this.inputs.flat().forEach((input, place) => {
      const value = typed(this.values[place >> 1]);
      if (document.activeElement !== input) input.value = value;
    });
  }
}
