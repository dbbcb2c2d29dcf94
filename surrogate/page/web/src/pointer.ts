/** Pointer and keys on the body: pressing on a node and dragging sets its force. */

import type { Vector3 } from "three";
import type { Load } from "./loads";
import type { State } from "./state";
import { loadableNodes } from "./view/body_mesh";
import type { Scene } from "./view/scene";

const STEP = 0.05; // of the training's largest force, for a key

/** What pointer and keys ask of the page. */
export interface Reactions {
  /** A drag has begun: `moved` follows. */
  pressed: (load: Load) => void;
  /** Loads have changed, by an event at a time in ms. */
  moved: (time: number) => void;
  /** Another node is pointed at. */
  pointed: () => void;
}

/** Listen to pointer and keys. */
export function listen(scene: Scene, state: State, reactions: Reactions): void {
  const { canvas } = scene;
  let drag: { pointer: number; load: Load; from: Vector3; force: number[]; start: Vector3 } | null =
    null;

  canvas.addEventListener(
    "pointerdown",
    (event) => {
      if (drag || event.button !== 0) return;
      const node = scene.pick(event.offsetX, event.offsetY);
      if (node === null) return;
      event.stopImmediatePropagation();
      canvas.setPointerCapture(event.pointerId);
      canvas.classList.add("dragging");
      const load = state.loads.at(node);
      const start = scene.body.at(node);
      const from = scene.inPlane(event.offsetX, event.offsetY, start);
      drag = { pointer: event.pointerId, load, from, force: [...load.force], start };
      state.node = node;
      reactions.pressed(load);
      reactions.moved(event.timeStamp);
    },
    { capture: true },
  );

  canvas.addEventListener("pointermove", (event) => {
    if (drag?.pointer === event.pointerId) {
      const { load, from, force, start } = drag;
      const pull = scene.inPlane(event.offsetX, event.offsetY, start).sub(from);
      pull.multiplyScalar(scene.stiffness);
      load.force = force.map((value, i) => value + pull.getComponent(i));
      reactions.moved(event.timeStamp);
    } else if (!drag && event.buttons === 0) {
      point(scene.pick(event.offsetX, event.offsetY));
    }
  });

  const release = (event: PointerEvent): void => {
    if (drag?.pointer !== event.pointerId) return;
    const { load } = drag;
    drag = null;
    canvas.classList.remove("dragging");
    if (load.force.every((value) => value === 0)) state.loads.remove(load);
    reactions.moved(event.timeStamp);
  };
  canvas.addEventListener("pointerup", release);
  canvas.addEventListener("pointercancel", release);
  canvas.addEventListener("pointerleave", () => {
    if (!drag) point(null);
  });

  const point = (node: number | null): void => {
    canvas.classList.toggle("over", node !== null);
    if (node === state.node) return;
    state.node = node;
    reactions.pointed();
  };

  const nodes = loadableNodes(state.content);
  canvas.addEventListener("keydown", (event) => {
    if (event.ctrlKey || event.altKey || event.metaKey) return;
    if (act(event)) event.preventDefault();
  });

  /** Do what a key asks for; false if it means nothing here. */
  function act(event: KeyboardEvent): boolean {
    const { loads } = state;
    const axis = { ArrowLeft: -1, ArrowRight: 1, ArrowDown: -2, ArrowUp: 2 }[event.key];
    if (axis !== undefined && loads.selected) {
      push(loads.selected, Math.abs(axis) - 1, Math.sign(axis) * (event.shiftKey ? 5 : 1));
      reactions.moved(event.timeStamp);
    } else if (event.key === "," || event.key === ".") {
      const place = nodes.indexOf(state.node ?? -1);
      const next = place + (event.key === "." ? 1 : -1);
      point(nodes[(next + nodes.length) % nodes.length] ?? null);
    } else if (event.key === "Enter" && state.node !== null) {
      reactions.pressed(loads.at(state.node));
      reactions.moved(event.timeStamp);
    } else if ((event.key === "Delete" || event.key === "Backspace") && loads.selected) {
      loads.remove(loads.selected);
      reactions.moved(event.timeStamp);
    } else if (event.key === "+" || event.key === "=" || event.key === "-") {
      scene.zoom(event.key === "-" ? 1 / 1.2 : 1.2);
    } else if (event.key === "0") {
      scene.home();
      scene.draw();
    } else {
      return false;
    }
    return true;
  }

  /** Change a force along an axis of the screen. */
  function push(load: Load, axis: number, steps: number): void {
    const step = steps * STEP * Math.max(...state.content.largest);
    const direction = scene.axis(axis);
    load.force = load.force.map((value, i) => value + step * direction.getComponent(i));
  }
}
