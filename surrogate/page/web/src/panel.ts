/** The panel beside the body, which `surrogate/page/page.html.j2` writes: its inputs and texts. */

import { COLOUR_FIELDS, type FieldName } from "./colours";
import { Curve } from "./curve";
import { predictCommand, size } from "./loads";
import { LoadCards } from "./load_cards";
import { largest, lengths } from "./mechanics/vectors";
import type { Gesture, State } from "./state";
import { asForce, asLength, digits, forceUnit, lengthUnit, place, typed, unitOf } from "./units";

const TOLERANCE = 1e-4; // of the largest displacement, of the command of a series
const LARGE_SHARE = 0.1; // of the displacement, of an estimated error that is shown in red
const PASTED = 2000; // ms that a button says so

/** What the panel asks of the page. */
export interface Actions {
  /** Loads or colours have changed. */
  changed: (what: "loads" | "field") => void;
  save: (kind: "png" | "csv" | "npz") => void;
}

/** An element of the page. */
export function find(selector: string): HTMLElement {
  return document.querySelector<HTMLElement>(selector)!;
}

/** Inputs of a selector; those of sliders stand in pairs, the slider first. */
function inputs(selector: string): HTMLInputElement[] {
  return [...document.querySelectorAll<HTMLInputElement>(`${selector} input`)];
}

/** Listen to an input of finite numbers; the function that shows what it stands for. */
export function bind(
  input: HTMLInputElement,
  read: () => number,
  write: (value: number) => void,
): () => void {
  input.addEventListener("input", () => {
    if (Number.isFinite(input.valueAsNumber)) write(input.valueAsNumber);
  });
  const show = (): void => {
    if (document.activeElement !== input) input.value = typed(read());
  };
  input.addEventListener("blur", show);
  return show;
}

export class Panel {
  readonly stage = find("#stage");
  readonly canvas = find("#stage canvas") as HTMLCanvasElement;
  readonly labels = find("#labels");
  readonly curve = new Curve(find("#curve") as HTMLCanvasElement);
  private readonly cards: LoadCards;
  private readonly shown: (() => void)[] = [];

  constructor(
    private readonly state: State,
    private readonly actions: Actions,
  ) {
    const { loads, content } = state;
    const changed = (): void => {
      actions.changed("loads");
    };
    this.cards = new LoadCards(state, changed);
    const sliders: [string, number[]][] = [
      ["#body-force", loads.body.force],
      ["#pressures", loads.pressures],
    ];
    for (const [selector, values] of sliders) {
      inputs(selector).forEach((input, i) => {
        const write = (value: number): void => {
          values[i >> 1] = value;
          changed();
        };
        this.shown.push(bind(input, () => values[i >> 1], write));
      });
    }
    const modulus = content.youngModulus ?? 1;
    const stiffen = (stiffness: number): void => {
      if (stiffness > 0) state.stiffness = stiffness;
      changed();
    };
    inputs("#stiffness").forEach((input, i) => {
      const isSlider = i === 0;
      const read = (): number =>
        isSlider ? Math.log10(state.stiffness) : modulus * state.stiffness;
      const slid = (decades: number): number =>
        decades === 0 ? 1 : Number(typed(10 ** decades * modulus)) / modulus;
      this.shown.push(
        bind(input, read, (value) => {
          stiffen(isSlider ? slid(value) : value / modulus);
        }),
      );
    });
    const resize = (radius: number): void => {
      if (radius > 0) state.radius = radius;
      if (state.tool) remove();
    };
    const remove = (): void => {
      state.put(null);
      changed();
    };
    this.shown.push(bind(find("#radius") as HTMLInputElement, () => state.radius, resize));
    find("#take-away").addEventListener("click", remove);
    for (const input of inputs("section:first-of-type [role=radiogroup]")) {
      input.addEventListener("change", () => {
        state.gesture = input.value as Gesture;
        this.updateTool();
      });
    }
    find("#colours").append(...state.choices.map((name) => this.choice(name)));
    find("#copy").addEventListener("click", copy);
    for (const kind of ["png", "csv", "npz"] as const) {
      find(`#save-${kind}`).addEventListener("click", () => {
        actions.save(kind);
      });
    }
  }

  /** Say what is going on; an empty text for nothing. */
  tell(text: string): void {
    find("#hint").textContent = text;
  }

  /** Show the state. */
  update(most: number): void {
    const { state } = this;
    const { content, loads } = state;
    const warnings = [...state.warnings().values()];
    this.stage.classList.toggle("outside", warnings.length > 0);
    const texts = warnings.map((text) => `${text}: the prediction may be wrong.`);
    const shown = find("#warnings");
    if (texts.join() !== Array.from(shown.children, (p) => p.textContent).join())
      shown.replaceChildren(...texts.map((text) => element("p", text)));
    this.cards.update();
    for (const show of this.shown) show();
    this.updateTool();
    this.curve.draw();
    this.updateBar(most);
    if (content.certified) this.updateEstimate();
    this.updateReadout();
    const { run, series, certified, youngModulus } = content;
    const { tool, stiffness } = state;
    find("#command").textContent = state.isLoaded
      ? predictCommand(run, loads, content, {
          tool,
          modulus: youngModulus && stiffness !== 1 ? youngModulus * stiffness : null,
          tolerance: series > 0 && certified ? TOLERANCE : null,
        })
      : "Set a load first.";
    const node = loads.selected?.node;
    const band = content.passes !== null || Object.keys(content.deviations).length > 0;
    find("#curve-title").textContent =
      node === undefined
        ? "Drag a load to see the curve of its node."
        : `Node at ${this.placeOf(node)}${band ? ", with its 95 % band" : ""}`;
  }

  /** What the sphere does. */
  private updateTool(): void {
    const { tool, gesture, loads } = this.state;
    const reading = find("#tool-force");
    find("#tool").hidden = gesture !== "push" && !tool;
    reading.hidden = !tool;
    const force = this.state.reaction();
    const [factor] = unitOf(size(force), forceUnit());
    const count = loads.contacts.length;
    const nodes = `${count} node${count === 1 ? "" : "s"}`;
    reading.textContent =
      count === 0
        ? "The sphere touches nothing."
        : `The sphere pushes by ${asForce(size(force))}, ${place(force.map((value) => value / factor))}, on ${nodes}.`;
  }

  private updateBar(most: number): void {
    const { label, palette } = COLOUR_FIELDS[this.state.field];
    const [factor, unit] = unitOf(most, lengthUnit());
    const isShown = this.state.values() !== null;
    find("#bar .name").textContent = isShown
      ? `${label} in ${unit}`
      : `${label}: ${this.missing()}`;
    find("#bar .ramp").hidden = !isShown;
    find("#bar .ramp").style.background = ramp(palette);
    document.querySelectorAll("#bar span").forEach((tick, i) => {
      tick.textContent = isShown ? digits(((i / 2) * most) / factor) : "";
    });
  }

  /** Why there are no values of the chosen field. */
  private missing(): string {
    if (!this.state.isLoaded) return "no load";
    if (this.state.field !== "error" || !this.state.fields) return "computing …";
    return this.state.certificate ? "none" : "computing …";
  }

  private updateEstimate(): void {
    const { certificate, fields, content } = this.state;
    let text = "Set a load first.";
    let isBad = certificate !== null && !certificate.settled;
    if (fields && !certificate) text = "Computing …";
    if (certificate?.inverted) {
      text = `None: the prediction turns ${certificate.inverted} elements inside out.`;
    } else if (certificate?.error && fields) {
      const most = largest(lengths(certificate.error, content.d));
      const share = most / (largest(lengths(fields.displacement, content.d)) || 1);
      const numbers = `${asLength(most, 2)} at most, ${digits(100 * share, 2)} % of the largest displacement`;
      isBad ||= share > LARGE_SHARE;
      text = certificate.settled ? numbers : `Not reliable, as no equilibrium is near: ${numbers}`;
    } else if (certificate) {
      text = "None: the forces of the prediction are no finite numbers.";
    }
    find("#estimate").textContent = text;
    find("#estimate").classList.toggle("bad", isBad);
  }

  private updateReadout(): void {
    const { state } = this;
    const node = state.node ?? state.loads.selected?.node ?? null;
    if (node === null) {
      find("#readout").replaceChildren(element("dd", "Point at the body.", "none"));
      return;
    }
    const u = state.displacementAt(node);
    const rows: [string, string][] = [
      ["Place", this.placeOf(node)],
      ...u.map((value, i): [string, string] => [`u${"xyz"[i]}`, asLength(value, 4)]),
      ["|u|", asLength(size(u), 4)],
    ];
    for (const name of state.choices.slice(1)) {
      const { d } = state.content;
      const vectors = state.vectors(name);
      const vector = vectors && Array.from({ length: d }, (_, i) => vectors[node * d + i]);
      rows.push([COLOUR_FIELDS[name].label, vector ? asLength(size(vector)) : "–"]);
    }
    find("#readout").replaceChildren(
      ...rows.flatMap(([term, text]) => [element("dt", term), element("dd", text)]),
    );
  }

  private placeOf(node: number): string {
    const { coordinates, d } = this.state.content;
    return `${place(coordinates.subarray(node * d, node * d + d), 4)} ${lengthUnit()}`;
  }

  /** The choice of a colour field. */
  private choice(name: FieldName): HTMLElement {
    const { label, palette } = COLOUR_FIELDS[name];
    const [row, input, sample] = [element("label"), element("input"), element("i")];
    Object.assign(input, { type: "radio", name: "field", value: name });
    input.checked = this.state.field === name;
    input.addEventListener("change", () => {
      this.state.field = name;
      this.actions.changed("field");
    });
    sample.style.background = ramp(palette);
    row.append(input, sample, label);
    return row;
  }
}

function ramp(palette: readonly string[]): string {
  return `linear-gradient(90deg, ${palette.join(", ")})`;
}

/** Make an element with a text. */
export function element<K extends keyof HTMLElementTagNameMap>(
  tag: K,
  text = "",
  name = "",
): HTMLElementTagNameMap[K] {
  return Object.assign(document.createElement(tag), { textContent: text, className: name });
}

/** Copy the command, or select it where that is not allowed. */
function copy({ target }: Event): void {
  const [button, command] = [target as HTMLButtonElement, find("#command")];
  window.getSelection()?.selectAllChildren(command);
  void navigator.clipboard.writeText(command.textContent).then(
    () => (button.textContent = "Copied"),
    () => (button.textContent = "Selected: press Ctrl+C"),
  );
  setTimeout(() => (button.textContent = "Copy the command"), PASTED);
}
