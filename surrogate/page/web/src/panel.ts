/** The panel beside the body: loads, colours, numbers, saving. */

import { COLOUR_FIELDS, type FieldName } from "./colours";
import { Curve } from "./curve";
import { Gestures } from "./gestures";
import { Sliders } from "./sliders";
import { Stiffness } from "./stiffness";
import { make } from "./elements";
import { LoadCards } from "./load_cards";
import { predictCommand } from "./loads";
import { largest, lengths } from "./mechanics/vectors";
import type { State } from "./state";
import { asLength, digits, forceUnit, lengthUnit, place, unitOf } from "./units";

const TOLERANCE = 5e-3; // of the largest displacement, of the command of a series
const LARGE_SHARE = 0.1; // of the displacement, of an estimated error that is shown in red

/** What the panel asks of the page. */
export interface Actions {
  /** Loads or colours have changed. */
  changed: (what: "loads" | "field") => void;
  save: (kind: "png" | "csv" | "npz") => void;
}

export class Panel {
  readonly stage = make("main", { id: "stage" });
  readonly canvas = make("canvas", {
    tabindex: "0",
    role: "application",
    "aria-label": "The body. Press on it and drag to load it; keys are listed in the panel.",
  });
  readonly labels = make("div", { id: "labels" });
  readonly curve: Curve;
  private readonly warnings = make("div", {
    id: "warnings",
    role: "status",
    "aria-live": "polite",
  });
  private readonly hint = make("p", { id: "hint" });
  private readonly bar = make("div", { id: "bar" });
  private readonly cards: LoadCards;
  private readonly sliders: [string, Sliders][] = [];
  private readonly gestures: Gestures;
  private readonly stiffness: Stiffness | null;
  private readonly readout = make("dl");
  private readonly estimate = make("p", { id: "estimate" });
  private readonly command = make("code", { tabindex: "0", "aria-label": "command" });
  private readonly curveTitle = make("p", { class: "none" });

  constructor(
    root: HTMLElement,
    private readonly state: State,
    private readonly actions: Actions,
  ) {
    const { content } = state;
    const canvas = make("canvas", {
      id: "curve",
      role: "img",
      "aria-label": "Force against displacement",
    });
    this.curve = new Curve(canvas);
    const changed = (): void => {
      actions.changed("loads");
    };
    this.cards = new LoadCards(state, changed);
    const [force, length] = [forceUnit(), lengthUnit()];
    if (content.density) {
      const names = content.density.map((_, i): [string, string] => [
        `b${"xyz"[i]}`,
        `b${"xyz"[i]} in ${force}/${length}³`,
      ]);
      const { force: values } = state.loads.body;
      const sliders = new Sliders("body-force", values, content.density, names, changed);
      this.sliders.push(["Body force", sliders]);
    }
    if (content.pressed.length > 0) {
      const names = content.pressed.map((name, i): [string, string] => {
        const surface = name || `surface ${i + 1}`;
        return [`pressure on ${surface}`, `${surface} in ${force}/${length}²`];
      });
      const { pressures } = state.loads;
      const sliders = new Sliders("pressures", pressures, content.largestPressures, names, changed);
      this.sliders.push(["Pressure", sliders]);
    }
    this.gestures = new Gestures(state, changed);
    this.stiffness = content.youngModulus
      ? new Stiffness(state, content.youngModulus, changed)
      : null;
    const section = (title: string, ...children: HTMLElement[]): HTMLElement =>
      make("section", {}, make("h2", {}, title), ...children);
    const passes = content.passes === null ? "" : `, ${content.passes} passes`;
    this.stage.append(this.canvas, this.labels, this.warnings, this.hint, this.bar);
    root.append(
      this.stage,
      make(
        "aside",
        { id: "panel" },
        make(
          "header",
          {},
          make("h1", {}, content.case),
          make("p", {}, `${content.network}${passes}`),
        ),
        section("A drag on the body", this.gestures.element),
        section("Loads", this.cards.element),
        ...this.sliders.map(([title, { element }]) => section(title, element)),
        ...(this.stiffness ? [section("Young's modulus", this.stiffness.element)] : []),
        section("Colours", this.choices()),
        ...(content.certified ? [section("Estimated error", this.estimate)] : []),
        section("At the node", this.readout),
        section("Force and displacement", this.curveTitle, canvas),
        section("The same by the program", this.command, this.copyButton()),
        section("Save", this.saveButtons()),
        help(content.d),
      ),
    );
  }

  /** Say what is going on; an empty text for nothing. */
  tell(text: string): void {
    this.hint.textContent = text;
  }

  /** Show the state. */
  update(largest: number): void {
    const { state } = this;
    const warnings = [...state.warnings().values()];
    this.stage.classList.toggle("outside", warnings.length > 0);
    const texts = warnings.map((text) => `${text}: the prediction may be wrong.`);
    if (texts.join() !== Array.from(this.warnings.children, (p) => p.textContent).join()) {
      this.warnings.replaceChildren(...texts.map((text) => make("p", {}, text)));
    }
    this.cards.update();
    for (const [, sliders] of this.sliders) sliders.update();
    this.gestures.update();
    this.stiffness?.update();
    this.curve.draw();
    this.updateBar(largest);
    this.updateEstimate();
    this.updateReadout();
    const { run, series, certified, youngModulus } = state.content;
    const tolerance = series > 0 && certified ? TOLERANCE : null;
    const { tool, stiffness } = state;
    const modulus = youngModulus && stiffness !== 1 ? youngModulus * stiffness : null;
    this.command.textContent = state.isLoaded
      ? predictCommand(run, state.loads, state.content, { tool, modulus, tolerance })
      : "Set a load first.";
    const node = state.loads.selected?.node;
    const band = state.content.passes !== null || Object.keys(state.content.deviations).length > 0;
    this.curveTitle.textContent =
      node === undefined
        ? "Drag a load to see the curve of its node."
        : `Node at ${this.placeOf(node)}${band ? ", with its 95 % band" : ""}`;
  }

  private updateBar(largest: number): void {
    const { label, palette } = COLOUR_FIELDS[this.state.field];
    const [factor, unit] = unitOf(largest, lengthUnit());
    const values = this.state.values();
    const ramp = make("div", { class: "ramp" });
    ramp.style.background = `linear-gradient(90deg, ${palette.join(", ")})`;
    const ticks = [0, 0.5, 1].map((part) => make("span", {}, digits((part * largest) / factor)));
    const name = values ? `${label} in ${unit}` : `${label}: ${this.missing()}`;
    this.bar.replaceChildren(
      make("div", { class: "name" }, name),
      ...(values ? [ramp, make("div", { class: "ticks" }, ...ticks)] : []),
    );
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
    this.estimate.textContent = text;
    this.estimate.classList.toggle("bad", isBad);
  }

  private updateReadout(): void {
    const { state } = this;
    const node = state.node ?? state.loads.selected?.node ?? null;
    if (node === null) {
      this.readout.replaceChildren(make("dd", { class: "none" }, "Point at the body."));
      return;
    }
    const u = state.displacementAt(node);
    const rows: [string, string][] = [
      ["Place", this.placeOf(node)],
      ...u.map((value, i): [string, string] => [`u${"xyz"[i]}`, asLength(value, 4)]),
      ["|u|", asLength(Math.hypot(...u), 4)],
    ];
    for (const name of state.choices.slice(1)) {
      const { d } = state.content;
      const vectors = state.vectors(name);
      const length =
        vectors && Math.hypot(...Array.from({ length: d }, (_, i) => vectors[node * d + i]));
      rows.push([COLOUR_FIELDS[name].label, length === null ? "–" : asLength(length)]);
    }
    this.readout.replaceChildren(
      ...rows.flatMap(([term, text]) => [make("dt", {}, term), make("dd", {}, text)]),
    );
  }

  private placeOf(node: number): string {
    const { coordinates, d } = this.state.content;
    return `${place(coordinates.subarray(node * d, node * d + d), 4)} ${lengthUnit()}`;
  }

  private choices(): HTMLElement {
    const choice = (name: FieldName): HTMLElement => {
      const { label, palette } = COLOUR_FIELDS[name];
      const sample = make("i");
      sample.style.background = `linear-gradient(90deg, ${palette.join(", ")})`;
      const change = (): void => {
        this.state.field = name;
        this.actions.changed("field");
      };
      const checked = this.state.field === name;
      const button = make("input", { type: "radio", name: "field", value: name, checked, change });
      return make("label", {}, button, sample, label);
    };
    return make("div", { class: "choices", role: "radiogroup" }, ...this.state.choices.map(choice));
  }

  private copyButton(): HTMLElement {
    const button = make("button", { type: "button" }, "Copy the command");
    button.addEventListener("click", () => {
      const selection = window.getSelection();
      selection?.selectAllChildren(this.command);
      void navigator.clipboard.writeText(this.command.textContent).then(
        () => (button.textContent = "Copied"),
        () => (button.textContent = "Selected: press Ctrl+C"),
      );
      setTimeout(() => (button.textContent = "Copy the command"), 2000);
    });
    return button;
  }

  private saveButtons(): HTMLElement {
    const kinds = ["png", "csv", "npz"] as const;
    const buttons = kinds.map((kind) => {
      const click = (): void => {
        this.actions.save(kind);
      };
      return make("button", { type: "button", click, id: `save-${kind}` }, kind.toUpperCase());
    });
    return make("div", { class: "row" }, ...buttons);
  }
}

/** Keys and gestures. */
function help(d: number): HTMLElement {
  const view =
    d === 2
      ? "drag beside the body to move the view"
      : "drag beside the body, or with the right button, to turn it";
  const items: [string, string][] = [
    ["", `Press on the body and drag: the force follows. Wheel or two fingers: zoom; ${view}.`],
    [", .", "previous and next node (with the body in focus)"],
    ["Enter", "load this node"],
    ["← → ↑ ↓", "change the selected force; with Shift five times as much"],
    ["Delete", "remove the selected load"],
    ["+ − 0", "zoom, whole body"],
  ];
  const lines = items.map(([key, text]) =>
    make("li", {}, ...(key ? [make("kbd", {}, key), " "] : []), text),
  );
  return make("details", {}, make("summary", {}, "Gestures and keys"), make("ul", {}, ...lines));
}
