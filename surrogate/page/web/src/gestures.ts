/** What a drag on the body does, and the sphere that pushes it. */

import { make } from "./elements";
import { size } from "./loads";
import type { Gesture, State } from "./state";
import { asForce, forceUnit, lengthUnit, place, unitOf } from "./units";

const LABELS: Record<Gesture, string> = {
  force: "pulls it by a force",
  hold: "takes hold of it",
  push: "pushes it with a sphere",
};

export class Gestures {
  readonly element = make("div");
  private readonly radius: HTMLInputElement;
  private readonly sphere: HTMLElement;
  private readonly reading = make("p", { id: "tool-force" });

  constructor(
    private readonly state: State,
    changed: () => void,
  ) {
    const gestures: Gesture[] = state.content.responding
      ? ["force", "hold", "push"]
      : ["force", "hold"];
    const choose = (gesture: Gesture): HTMLElement => {
      const change = (): void => {
        state.gesture = gesture;
        this.update();
      };
      const checked = state.gesture === gesture;
      const input = { type: "radio", name: "gesture", value: gesture, checked, change };
      return make("label", {}, make("input", input), LABELS[gesture]);
    };
    const resize = (): void => {
      const { valueAsNumber } = this.radius;
      if (!(valueAsNumber > 0) || !Number.isFinite(valueAsNumber)) return;
      state.radius = valueAsNumber;
      if (state.tool) remove();
    };
    const remove = (): void => {
      state.put(null);
      changed();
    };
    this.radius = make("input", { type: "number", step: "any", min: "0", input: resize });
    this.radius.value = String(state.radius);
    const cross = make("button", { type: "button", click: remove }, "Take it away");
    this.sphere = make(
      "div",
      { class: "row", id: "tool" },
      make("label", { class: "number" }, `Radius in ${lengthUnit()}`, this.radius),
      cross,
    );
    this.element.append(
      make("div", { class: "choices", role: "radiogroup" }, ...gestures.map(choose)),
      this.sphere,
      this.reading,
    );
    this.update();
  }

  /** Show what the sphere does. */
  update(): void {
    const { tool, gesture, loads } = this.state;
    this.sphere.hidden = gesture !== "push" && !tool;
    this.reading.hidden = !tool;
    if (!tool) return;
    const force = this.state.reaction();
    const [factor] = unitOf(size(force), forceUnit());
    const count = loads.contacts.length;
    const components = place(force.map((value) => value / factor));
    const nodes = `${count} node${count === 1 ? "" : "s"}`;
    this.reading.textContent =
      count === 0
        ? "The sphere touches nothing."
        : `The sphere pushes by ${asForce(size(force))}, ${components}, on ${nodes}.`;
  }
}
