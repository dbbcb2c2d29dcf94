/** A card for every load: its place, its components and size to type in, its removal. */

import { bind, find, onClick, type Value } from "./elements";
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
      state.unload();
      changed();
    });
    // a choice of nodes for those who do not use a pointer
    const nodes = find<HTMLSelectElement>("#nodes");
    for (const node of loadableNodes(content)) nodes.add(new Option(this.at(node), String(node)));
    nodes.addEventListener("change", () => {
      if (nodes.value === "") return;
      const load = loads.at(Number(nodes.value));
      const half = Number((content.largest.at(-1)! / 2).toPrecision(2));
      if (norm(load.force) === 0) resize(load, half);
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
      const where = `${content.patches ? "Patch about" : "Node"} ${this.at(load.key)}`;
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
    const values: Value[] = [
      ...load.force.map((_, i) => ({
        read: () => load.force[i],
        write: (value: number) => (load.force[i] = value),
      })),
      { read: () => norm(load.force), write: (size) => resize(load, size) },
      {
        read: () => Math.atan2(load.force[1], load.force[0]) / DEGREE,
        write: (angle) => turn(load, angle),
      },
    ];
    const typedIn = (): void => {
      loads.selected = load;
      load.held = null;
      this.changed();
    };
    const shown = [...element.querySelectorAll("input")].map((input, i) =>
      bind(input, values[i], typedIn),
    );
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

/** Give a force another size in N; without a direction it acts downwards. */
function resize(load: Load, size: number): void {
  const before = norm(load.force);
  const downwards = load.force.map((_, i) => (i === load.force.length - 1 ? -1 : 0));
  const direction = before > 0 ? load.force.map((part) => part / before) : downwards;
  load.force = direction.map((part) => part * Math.abs(size));
}

/** Turn a force in the plane, to an angle in degrees. */
function turn(load: Load, angle: number): void {
  const size = norm(load.force);
  load.force = [size * Math.cos(angle * DEGREE), size * Math.sin(angle * DEGREE)];
}
