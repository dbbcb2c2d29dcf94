/** Elements of the page, which `surrogate/page/page.html.j2` writes. */

import { typed } from "./units";

/** The first element of a selector, there or below another one. */
// eslint-disable-next-line @typescript-eslint/no-unnecessary-type-parameters
export function find<T extends HTMLElement>(selector: string, below: ParentNode = document): T {
  return below.querySelector<T>(selector)!;
}

/** Inputs below all elements of a selector; those of sliders stand in pairs, the slider first. */
export function inputs(selector: string): HTMLInputElement[] {
  return [...document.querySelectorAll<HTMLInputElement>(`${selector} input`)];
}

/** Make an element with a text. */
export function element<K extends keyof HTMLElementTagNameMap>(
  tag: K,
  textContent = "",
  className = "",
): HTMLElementTagNameMap[K] {
  return Object.assign(document.createElement(tag), { textContent, className });
}

export function onClick(target: HTMLElement, act: () => void): void {
  target.addEventListener("click", act);
}

/** A number that an input stands for. */
export interface Value {
  read: () => number;
  write: (value: number) => void;
}

/** A number of some. */
export function entry(values: number[], i: number): Value {
  return { read: () => values[i], write: (value) => (values[i] = value) };
}

/** Listen to an input of finite numbers; the function that shows its value. */
export function bind(
  input: HTMLInputElement,
  { read, write }: Value,
  changed: () => void,
): () => void {
  input.addEventListener("input", () => {
    if (!Number.isFinite(input.valueAsNumber)) return;
    write(input.valueAsNumber);
    changed();
  });
  const show = (): void => {
    if (document.activeElement !== input) input.value = typed(read());
  };
  input.addEventListener("blur", show);
  return show;
}
