/** A card for every load: its place, its components and size to type in, its removal. */

import { bind, find, onClick } from "./elements";
import type { Load } from "./loads";
import { norm } from "./mechanics/vectors";
import type { State } from "./state";
import { place } from "./units";
import { loadableNodes } from "./view/body_mesh";

const DEGREE = Math.PI / 180;

/** A card, and what brings it up to date. */
interface Card {
  element: HTMLElement;
  shown: (() => void)[];
}

export class LoadCards {
  private readonly cards = new Map<Load, Card>();

  constructor(
    private readonly state: State,
    private readonly changed: () => void,
  ) {
    const { loads, content } = state;
    onClick(find("#remove-all"), () => {
      loads.clear();
      state.put(null);
      changed();
    });
    // a choice of nodes for those who do not use a pointer
    const nodes = find<HTMLSelectElement>("#nodes");
    for (const node of loadableNodes(content)) nodes.add(new Option(this.at(node), String(node)));
    nodes.addEventListener("change", () => {
      if (nodes.value === "") return;
      const load = loads.at(Number(nodes.value));
      const half = Number((content.largest.at(-1)! / 2).toPrecision(2));
      if (norm(load.force) === 0) load.force[content.d - 1] = -half;
      nodes.value = "";
      changed();
    });
  }

  /** Show the loads. */
  update(): void {
    const { loads, content, tool, isLoaded } = this.state;
    const { all, selected } = loads;
    for (const [load, { element }] of this.cards) {
      if (all.includes(load)) continue;
      element.remove();
      this.cards.delete(load);
    }
    find("#no-load").hidden = all.length > 0;
    find<HTMLButtonElement>("#remove-all").disabled = !isLoaded && all.length === 0 && !tool;
    all.forEach((load, number) => {
      const { element, shown } = this.cards.get(load) ?? this.card(load);
      const where = `${content.patches ? "Patch about" : "Node"} ${this.at(load.node)}`;
      find(".name", element).textContent = `${number + 1}: ${where}${load.held ? ", held" : ""}`;
      element.classList.toggle("selected", load === selected);
      element.classList.toggle("beyond", this.state.isDoubtful(load));
      for (const show of shown) show();
    });
  }

  private card(load: Load): Card {
    const { loads } = this.state;
    const template = find<HTMLTemplateElement>("#load").content;
    const element = template.firstElementChild!.cloneNode(true) as HTMLElement;
    const components = load.force.map((_, i): [() => number, (value: number) => void] => [
      () => load.force[i],
      (value) => (load.force[i] = value),
    ]);
    const size = (value: number): void => {
      const before = norm(load.force);
      if (before === 0) load.force[load.force.length - 1] = -Math.abs(value);
      else load.force = load.force.map((part) => (part / before) * Math.abs(value));
    };
    const turn = (angle: number): void => {
      const length = norm(load.force);
      load.force = [length * Math.cos(angle * DEGREE), length * Math.sin(angle * DEGREE)];
    };
    const numbers = [
      ...components,
      [() => norm(load.force), size] as const,
      [() => Math.atan2(load.force[1], load.force[0]) / DEGREE, turn] as const,
    ];
    const shown = [...element.querySelectorAll("input")].map((input, i) => {
      const [read, write] = numbers[i];
      return bind(input, read, (value) => {
        loads.selected = load;
        load.held = null;
        write(value);
        this.changed();
      });
    });
    const [name, cross] = element.querySelectorAll("button");
    onClick(name, () => {
      loads.selected = load;
      this.changed();
    });
    onClick(cross, () => {
      loads.remove(load);
      this.changed();
    });
    const card = { element, shown };
    this.cards.set(load, card);
    find("#loads").append(element);
    return card;
  }

  private at(node: number): string {
    return place(this.state.content.place(node));
  }
}
