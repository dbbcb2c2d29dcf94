/** A card for every load: its place, its components and size to type in, its removal. */

import { make } from "./elements";
import { size, type Load } from "./loads";
import type { State } from "./state";
import { isBeyond } from "./training_range";
import { forceUnit, place, typed } from "./units";
import { loadableNodes } from "./view/body_mesh";

interface Card {
  element: HTMLElement;
  name: HTMLElement;
  where: string;
  inputs: { field: HTMLInputElement; read: () => number }[];
}

export class LoadCards {
  readonly element = make("div");
  private readonly list = make("div");
  private readonly none = make("p", { class: "none" }, "None yet. Press on the body and drag.");
  private readonly clear: HTMLButtonElement;
  private readonly cards = new Map<Load, Card>();

  constructor(
    private readonly state: State,
    private readonly changed: () => void,
  ) {
    const click = (): void => {
      state.loads.clear();
      state.put(null);
      changed();
    };
    this.clear = make("button", { type: "button", click }, "Remove all");
    this.element.append(
      this.list,
      this.none,
      make("div", { class: "row" }, this.adder(), this.clear),
    );
  }

  /** Show the loads. */
  update(): void {
    const { all, selected } = this.state.loads;
    for (const [load, card] of this.cards) {
      if (all.includes(load)) continue;
      card.element.remove();
      this.cards.delete(load);
    }
    this.none.hidden = all.length > 0;
    this.clear.disabled = !this.state.isLoaded && all.length === 0 && !this.state.tool;
    const { largest, loadable } = this.state.content.trained;
    all.forEach((load, number) => {
      let card = this.cards.get(load);
      if (!card) {
        card = this.card(load);
        this.cards.set(load, card);
        this.list.append(card.element);
      }
      card.name.textContent = `${number + 1}: ${card.where}${load.held ? ", held" : ""}`;
      card.element.classList.toggle("selected", load === selected);
      const beyond = isBeyond(load.force, largest);
      card.element.classList.toggle("beyond", beyond || !loadable[load.node]);
      for (const { field, read } of card.inputs) {
        if (document.activeElement !== field) field.value = typed(read());
      }
    });
  }

  private card(load: Load): Card {
    const { loads, content } = this.state;
    const inputs: Card["inputs"] = [];
    const number = (
      label: string,
      read: () => number,
      write: (value: number) => void,
    ): HTMLElement => {
      const field = make("input", { type: "number", step: "any" });
      field.addEventListener("input", () => {
        if (!Number.isFinite(field.valueAsNumber)) return;
        loads.selected = load;
        load.held = null;
        write(field.valueAsNumber);
        this.changed();
      });
      field.addEventListener("blur", () => {
        this.update();
      });
      inputs.push({ field, read });
      return make("label", { class: "number" }, label, field);
    };
    const components = load.force.map((_, i) =>
      number(
        `F${"xyz"[i]} in ${forceUnit()}`,
        () => load.force[i],
        (value) => (load.force[i] = value),
      ),
    );
    const magnitude = number(
      `Size in ${forceUnit()}`,
      () => size(load.force),
      (value) => {
        const now = size(load.force);
        const direction = now > 0 ? load.force.map((f) => f / now) : downwards(content.d);
        load.force = direction.map((f) => f * Math.abs(value));
      },
    );
    const angle = number(
      "Angle in °",
      () => degrees(load),
      (value) => {
        const [length, radians] = [size(load.force), (value * Math.PI) / 180];
        load.force = [length * Math.cos(radians), length * Math.sin(radians)];
      },
    );
    const { coordinates, d } = content;
    const at = place(coordinates.subarray(load.node * d, load.node * d + d));
    const click = (): void => {
      loads.selected = load;
      this.changed();
    };
    const remove = (): void => {
      loads.remove(load);
      this.changed();
    };
    const where = `${content.patches ? "Patch about" : "Node"} ${at}`;
    const name = make("button", { type: "button", class: "name", click });
    const cross = make(
      "button",
      { type: "button", class: "plain", click: remove, "aria-label": "Remove the load" },
      "✕",
    );
    const element = make(
      "div",
      { class: "load" },
      make("div", { class: "head" }, name, cross),
      make("div", { class: "numbers" }, ...components, magnitude, ...(d === 2 ? [angle] : [])),
    );
    return { element, name, where, inputs };
  }

  /** A choice of nodes for those who do not use a pointer. */
  private adder(): HTMLElement {
    const { content, loads } = this.state;
    const { coordinates, d } = content;
    const options = loadableNodes(content).map((node) => {
      const at = place(coordinates.subarray(node * d, node * d + d));
      return make("option", { value: String(node) }, at);
    });
    const change = (): void => {
      if (list.value === "") return;
      const load = loads.at(Number(list.value));
      if (size(load.force) === 0) {
        const half = Number((content.largest.at(-1)! / 2).toPrecision(2));
        load.force = downwards(d).map((part) => part * half);
      }
      list.value = "";
      this.changed();
    };
    const list = make("select", { change }, make("option", { value: "" }, "choose …"), ...options);
    const label = content.patches ? "Touch the body at" : "Load the node at";
    return make("label", { class: "number" }, label, list);
  }
}

/** Unit vector against the last axis. */
function downwards(d: number): number[] {
  return Array.from({ length: d }, (_, i) => (i === d - 1 ? -1 : 0));
}

function degrees(load: Load): number {
  return (Math.atan2(load.force[1], load.force[0]) * 180) / Math.PI;
}
