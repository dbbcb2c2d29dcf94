/** A card for every load: its place, its components and size to type in, its removal. */

import { bind, find } from "./panel";
import { size, type Load } from "./loads";
import type { State } from "./state";
import { isBeyond } from "./training_range";
import { place } from "./units";
import { loadableNodes } from "./view/body_mesh";

/** A card, and what brings it up to date. */
interface Card {
  element: HTMLElement;
  shown: (() => void)[];
}

export class LoadCards {
  private readonly list = find("#loads");
  private readonly cards = new Map<Load, Card>();

  constructor(
    private readonly state: State,
    private readonly changed: () => void,
  ) {
    const { loads, content } = state;
    find("#remove-all").addEventListener("click", () => {
      loads.clear();
      state.put(null);
      changed();
    });
    // a choice of nodes for those who do not use a pointer
    const nodes = find("#nodes") as HTMLSelectElement;
    for (const node of loadableNodes(content)) nodes.add(new Option(this.at(node), String(node)));
    nodes.addEventListener("change", () => {
      if (nodes.value === "") return;
      const load = loads.at(Number(nodes.value));
      const half = Number((content.largest.at(-1)! / 2).toPrecision(2));
      if (size(load.force) === 0) load.force = downwards(content.d).map((part) => part * half);
      nodes.value = "";
      changed();
    });
  }

  /** Show the loads. */
  update(): void {
    const { loads, content, tool, isLoaded } = this.state;
    const { all, selected } = loads;
    for (const [load, card] of this.cards) {
      if (all.includes(load)) continue;
      card.element.remove();
      this.cards.delete(load);
    }
    find("#no-load").hidden = all.length > 0;
    (find("#remove-all") as HTMLButtonElement).disabled = !isLoaded && all.length === 0 && !tool;
    all.forEach((load, number) => {
      const card = this.cards.get(load) ?? this.card(load);
      const where = `${content.patches ? "Patch about" : "Node"} ${this.at(load.node)}`;
      card.element.querySelector(".name")!.textContent =
        `${number + 1}: ${where}${load.held ? ", held" : ""}`;
      card.element.classList.toggle("selected", load === selected);
      const { largest, loadable } = content.trained;
      const isBeyondTraining = isBeyond(load.force, largest) || !loadable[load.node];
      card.element.classList.toggle("beyond", isBeyondTraining);
      for (const show of card.shown) show();
    });
  }

  private card(load: Load): Card {
    const { loads, content } = this.state;
    const template = (find("#load") as HTMLTemplateElement).content.firstElementChild!;
    const made = template.cloneNode(true) as HTMLElement;
    const direction = (): number[] =>
      size(load.force) > 0 ? load.force.map((f) => f / size(load.force)) : downwards(content.d);
    const numbers: [() => number, (value: number) => void][] = load.force.map((_, i) => [
      () => load.force[i],
      (value) => (load.force[i] = value),
    ]);
    numbers.push(
      [
        () => size(load.force),
        (value) => (load.force = direction().map((part) => part * Math.abs(value))),
      ],
      [
        () => (Math.atan2(load.force[1], load.force[0]) * 180) / Math.PI,
        (value) => {
          const [length, angle] = [size(load.force), (value * Math.PI) / 180];
          load.force = [length * Math.cos(angle), length * Math.sin(angle)];
        },
      ],
    );
    const shown = [...made.querySelectorAll("input")].map((input, i) => {
      const [read, write] = numbers[i];
      return bind(input, read, (value) => {
        loads.selected = load;
        load.held = null;
        write(value);
        this.changed();
      });
    });
    const [name, cross] = made.querySelectorAll("button");
    name.addEventListener("click", () => {
      loads.selected = load;
      this.changed();
    });
    cross.addEventListener("click", () => {
      loads.remove(load);
      this.changed();
    });
    const card = { element: made, shown };
    this.cards.set(load, card);
    this.list.append(made);
    return card;
  }

  private at(node: number): string {
    const { coordinates, d } = this.state.content;
    return place(coordinates.subarray(node * d, node * d + d));
  }
}

/** Unit vector against the last axis. */
function downwards(d: number): number[] {
  return Array.from({ length: d }, (_, i) => (i === d - 1 ? -1 : 0));
}
