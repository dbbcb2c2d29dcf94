/** Young's modulus of the body: a slider in powers of ten, and a number. */

import { make } from "./elements";
import type { State } from "./state";
import { digits, typed } from "./units";

const DECADES = 1; // of a slider, to each side
const STEP = 0.01; // of a decade

export class Stiffness {
  readonly element: HTMLElement;
  private readonly slider: HTMLInputElement;
  private readonly number: HTMLInputElement;

  /** @param modulus - Young's modulus of the training in Pa */
  constructor(
    private readonly state: State,
    private readonly modulus: number,
    changed: () => void,
  ) {
    const ends = { min: String(-DECADES), max: String(DECADES), step: String(STEP) };
    const slide = (): void => {
      const decades = this.slider.valueAsNumber;
      state.stiffness = decades === 0 ? 1 : Number(typed(10 ** decades * modulus)) / modulus;
      changed();
    };
    const type = (): void => {
      const { valueAsNumber } = this.number;
      if (!(valueAsNumber > 0) || !Number.isFinite(valueAsNumber)) return;
      state.stiffness = valueAsNumber / modulus;
      changed();
    };
    const name = "Young's modulus";
    this.slider = make("input", { type: "range", ...ends, input: slide, "aria-label": name });
    this.number = make("input", { type: "number", step: "any", min: "0", input: type });
    const label = `E, ${digits(modulus)} Pa in training`;
    this.element = make("label", { class: "slider", id: "stiffness" }, label);
    this.element.append(this.slider, this.number);
    this.update();
  }

  /** Show Young's modulus. */
  update(): void {
    const { stiffness } = this.state;
    if (document.activeElement !== this.slider) this.slider.value = String(Math.log10(stiffness));
    if (document.activeElement !== this.number) {
      this.number.value = typed(this.modulus * stiffness);
    }
  }
}
