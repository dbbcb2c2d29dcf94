/** The panel beside the body, which `surrogate/page/page.html.j2` writes: its inputs and texts. */

import { bar, COLOUR_FIELDS, type FieldName } from "./colours";
import { predictCommand } from "./command";
import { Curve } from "./curve";
import { bind, element, entry, find, inputs, onClick, type Value } from "./elements";
import { LoadCards } from "./load_cards";
import { norm } from "./mechanics/vectors";
import type { Kind } from "./save";
import type { Gesture, State } from "./state";
import { asForce, asLength, digits, inUnit, place, unitOf, units } from "./units";

const REACHED = 5e-3; // of the size of the body: what a target is missed by
const UNLOADED = "Set a load first.";
const REAL = 0.95; // of real time
const PASTED = 2000; // ms that a button says so

/** What the panel asks of the page. */
export interface Actions {
  /** Loads have changed. */
  changed: () => void;
  /** Motion begins from where the body is, or ends. */
  restarted: () => void;
  recoloured: () => void;
  save: (kind: Kind) => void;
}

export class Panel {
  readonly stage = find("#stage");
  readonly canvas = find<HTMLCanvasElement>("#stage canvas");
  readonly labels = find("#labels");
  readonly curve = new Curve(find("#curve"));
  private readonly cards: LoadCards;
  private readonly shown: (() => void)[] = [];

  constructor(
    private readonly state: State,
    private readonly actions: Actions,
  ) {
    const { loads } = state;
    this.cards = new LoadCards(state, actions.changed);
    const twice = (value: Value): Value[] => [value, value];
    const inPairs = (values: number[]): Value[] =>
      values.flatMap((_, i) => twice(entry(values, i)));
    const values = {
      "#body-force": inPairs(loads.body.force),
      "#pressures": inPairs(loads.pressures),
      "#actuators": inPairs(loads.given).map(({ read, write }) => ({
        read,
        write: (value: number) => {
          state.target = null;
          write(value);
        },
      })),
      "#stiffness": [
        { read: () => Math.log10(state.stiffness), write: (decades) => state.stiffen(decades) },
        { read: () => state.modulus, write: (modulus) => (state.modulus = modulus) },
      ],
      "#damping": twice({
        read: () => state.motion.damping,
        write: (ratio) => (state.motion.damping = Math.max(0, ratio)),
      }),
      "#tool": [{ read: () => state.radius, write: (radius) => state.resize(radius) }],
    } satisfies Record<string, Value[]>;
    for (const [selector, some] of Object.entries(values)) {
      inputs(selector).forEach((input, i) =>
        this.shown.push(bind(input, some[i], actions.changed)),
      );
    }
    onClick(find("#take-away"), () => {
      state.put(null);
      actions.changed();
    });
    onClick(find("#reset"), () => {
      state.unload();
      state.fields = null;
      actions.restarted();
    });
    const [over] = inputs("#motion .choices");
    over.addEventListener("change", () => {
      state.motion.isOn = over.checked;
      actions.restarted();
    });
    onClick(find("#no-target"), () => {
      state.target = null;
      actions.changed();
    });
    for (const input of inputs("section:first-of-type [role=radiogroup]")) {
      input.addEventListener("change", () => {
        state.gesture = input.value as Gesture;
        this.updateTool();
      });
    }
    find("#colours").append(...state.choices.map((name) => this.choice(name)));
    onClick(find("#copy"), copy);
    for (const kind of ["png", "csv", "npz"] as const) {
      onClick(find(`#save-${kind}`), () => actions.save(kind));
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
    this.updateWarnings();
    this.cards.update();
    for (const show of this.shown) show();
    this.updateTool();
    this.updateActuators();
    this.updateMotion();
    this.curve.draw();
    this.updateBar(most);
    if (content.certified) this.updateEstimate();
    this.updateReadout();
    const command = state.motion.isOn ? "" : state.isLoaded ? predictCommand(state) : UNLOADED;
    find("#command").textContent = command;
    const node = loads.selected?.key;
    const band = content.passes !== null || Object.keys(content.deviations).length > 0;
    find("#curve-title").textContent =
      node === undefined
        ? "Drag a load to see the curve of its node."
        : `Node at ${this.placeOf(node)}${band ? ", with its 95 % band" : ""}`;
  }

  /** How the loads leave the training; where it is small, the estimated error in place of that. */
  private updateWarnings(): void {
    const { estimate } = this.state;
    const warnings = [...this.state.warnings().values()];
    const isWarned = warnings.length > 0 && estimate?.isBad !== false;
    const texts = warnings.map((text) => `${text}: the prediction may be wrong.`);
    if (warnings.length > 0 && !isWarned)
      texts.splice(
        0,
        Infinity,
        `Loads unlike those of the training: estimated error ${percent(estimate!.share)}.`,
      );
    this.stage.classList.toggle("outside", isWarned);
    const shown = find("#warnings");
    if (texts.join() !== Array.from(shown.children, (p) => p.textContent).join())
      shown.replaceChildren(...texts.map((text) => element("p", text)));
  }

  /** What the sphere does. */
  private updateTool(): void {
    const { tool, gesture, loads } = this.state;
    const reading = find("#tool-force");
    find("#tool").hidden = gesture !== "push" && !tool;
    reading.hidden = !tool;
    const force = this.state.reaction();
    const [factor] = unitOf(norm(force), units.force);
    const count = loads.contacts.filter(({ force }) => force.some(Boolean)).length;
    const nodes = `${count} node${count === 1 ? "" : "s"}`;
    const components = place(force.map((value) => value / factor));
    reading.textContent =
      count === 0
        ? "The sphere touches nothing."
        : `The sphere pushes by ${asForce(norm(force))}, ${components}, on ${nodes}.`;
  }

  /** What the actuators do, and whether they reach the target. */
  private updateActuators(): void {
    const { content, actuated, target } = this.state;
    if (!content.actuation) return;
    const { sliders, controls, size } = content.actuation;
    document.querySelectorAll("#actuators p").forEach((reading, i) => {
      const at = controls.length - sliders.length + i;
      const values = [actuated?.amplitudes[at] ?? 0, actuated?.quantities[at] ?? controls[at].rest];
      reading.textContent = sliders[i].readings
        .map(([name, unit], k) => `${name} ${inUnit(values[k], unit, 4)}`)
        .join(", ");
    });
    find("#target").hidden = !target;
    const missed = actuated?.missed ?? 0;
    const isFar = missed > REACHED * size;
    find("#reached").textContent = !isFar
      ? "The target is reached."
      : actuated?.isWhole
        ? `The target is out of reach: the nearest state misses it by ${asLength(missed)}.`
        : "On the way to the target …";
    find("#reached").classList.toggle("bad", isFar && actuated?.isWhole === true);
    find("#no-equilibrium").hidden = target !== null || actuated?.isWhole !== false;
  }

  private updateMotion(): void {
    const { isOn, time, pace } = this.state.motion;
    const slow = pace > REAL ? "" : `slow motion, ${digits(100 * pace, 2)} % of `;
    find("#pace").textContent = isOn ? `${time.toFixed(2)} s, ${slow}real time` : "";
  }

  private updateBar(most: number): void {
    const { field } = this.state;
    const { label, palette } = COLOUR_FIELDS[field];
    const { title, ticks } = bar(field, most);
    const isShown = this.state.values() !== null;
    find("#bar .name").textContent = isShown ? title : `${label}: ${this.missing()}`;
    find("#bar .ramp").hidden = !isShown;
    find("#bar .ramp").style.background = ramp(palette);
    document
      .querySelectorAll("#bar span")
      .forEach((tick, i) => (tick.textContent = isShown ? ticks[i] : ""));
  }

  /** Why there are no values of the chosen field. */
  private missing(): string {
    const { isLoaded, field, fields, certificate } = this.state;
    if (!isLoaded) return "no load";
    return field === "error" && fields && certificate ? "none" : "computing …";
  }

  private updateEstimate(): void {
    const { certificate, fields, estimate } = this.state;
    let text = fields ? "Computing …" : UNLOADED;
    if (certificate?.inverted) {
      text = `None: the prediction turns ${certificate.inverted} elements inside out.`;
    } else if (certificate && estimate) {
      text = `${asLength(estimate.most, 2)} at most, ${percent(estimate.share)}`;
      if (this.state.motion.isOn) text += ", that the time step adds";
      if (!certificate.settled) text = `Not reliable, as no equilibrium is near: ${text}`;
    } else if (certificate) {
      text = "None: the forces of the prediction are no finite numbers.";
    }
    find("#estimate").textContent = text;
    find("#estimate").classList.toggle("bad", certificate !== null && estimate?.isBad !== false);
  }

  private updateReadout(): void {
    const { state } = this;
    const node = state.node ?? state.loads.selected?.key ?? null;
    if (node === null) {
      find("#readout").replaceChildren(element("dd", "Point at the body.", "none"));
      return;
    }
    const u = state.displacementAt(node);
    const rows: [string, string][] = [
      ["Place", this.placeOf(node)],
      ...u.map((value, i): [string, string] => [`u${"xyz"[i]}`, asLength(value, 4)]),
      ["|u|", asLength(norm(u), 4)],
    ];
    for (const name of state.choices.slice(1)) {
      const vector = state.vectorAt(name, node);
      rows.push([COLOUR_FIELDS[name].label, vector ? asLength(norm(vector)) : "–"]);
    }
    find("#readout").replaceChildren(
      ...rows.flatMap(([term, text]) => [element("dt", term), element("dd", text)]),
    );
  }

  private placeOf(node: number): string {
    return `${place(this.state.content.place(node), 4)} ${units.length}`;
  }

  /** The choice of a colour field. */
  private choice(name: FieldName): HTMLElement {
    const { label, palette } = COLOUR_FIELDS[name];
    const [row, input, sample] = [element("label"), element("input"), element("i")];
    Object.assign(input, { type: "radio", name: "field", value: name });
    input.checked = this.state.field === name;
    input.addEventListener("change", () => {
      this.state.field = name;
      this.actions.recoloured();
    });
    sample.style.background = ramp(palette);
    row.append(input, sample, label);
    return row;
  }
}

function percent(share: number): string {
  return `${digits(100 * share, 2)} % of the largest displacement`;
}

function ramp(palette: readonly string[]): string {
  return `linear-gradient(90deg, ${palette.join(", ")})`;
}

/** Copy the command, or select it where that is not allowed. */
function copy(): void {
  const [button, command] = [find("#copy"), find("#command")];
  window.getSelection()?.selectAllChildren(command);
  void navigator.clipboard.writeText(command.textContent).then(
    () => (button.textContent = "Copied"),
    () => (button.textContent = "Selected: press Ctrl+C"),
  );
  setTimeout(() => (button.textContent = "Copy the command"), PASTED);
}
