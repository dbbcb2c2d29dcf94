/** Pointer and keys on the body: a drag sets a force or a target, takes hold of the body, or pushes it. */

import { Vector3 } from "three";
import type { Load } from "./loads";
import type { State, Tool } from "./state";
import { loadableNodes, outwardsAt } from "./view/body_mesh";
import type { Scene } from "./view/scene";

const STEP = 0.05; // of the training's largest force, for a key
const ZOOM = 1.2; // for a key

/** What pointer and keys ask of the page. */
export interface Reactions {
  /** A drag has begun: `moved` follows. */
  pressed: (load: Load) => void;
  /** Loads have changed, by an event at a time in ms. */
  moved: (time: number) => void;
  /** Another node is pointed at. */
  pointed: () => void;
}

/** What a drag moves. */
interface Drag {
  /** Where it moves. */
  through: Vector3;
  /** Follow the pointer, moved by so much in m. */
  follow: (pull: Vector3) => void;
  end?: () => void;
}

/**
 * Listen to pointer and keys.
 *
 * @param surface - nodes of the surface that can move
 */
export function listen(
  scene: Scene,
  state: State,
  surface: readonly number[],
  reactions: Reactions,
): void {
  const { canvas } = scene;
  const { loads, content } = state;
  let drag: (Drag & { pointer: number; from: Vector3 }) | null = null;

  const down = (event: PointerEvent): void => {
    if (drag || event.button !== 0) return;
    const { offsetX: x, offsetY: y, pointerId: pointer } = event;
    const begin = { force: dragNode, hold: dragNode, push: dragTool, reach: dragTarget };
    const begun = begin[state.gesture](x, y);
    if (!begun) return;
    event.stopImmediatePropagation();
    canvas.setPointerCapture(pointer);
    canvas.classList.add("dragging");
    drag = { ...begun, pointer, from: scene.inPlane(x, y, begun.through) };
    reactions.moved(event.timeStamp);
  };

  const move = (event: PointerEvent): void => {
    if (drag?.pointer === event.pointerId) {
      const { through, from, follow } = drag;
      follow(scene.inPlane(event.offsetX, event.offsetY, through).sub(from));
      reactions.moved(event.timeStamp);
    } else if (!drag && event.buttons === 0) {
      point(scene.pick(event.offsetX, event.offsetY));
    }
  };

  const release = (event: PointerEvent): void => {
    if (drag?.pointer !== event.pointerId) return;
    drag.end?.();
    drag = null;
    canvas.classList.remove("dragging");
    reactions.moved(event.timeStamp);
  };

  const leave = (): void => {
    if (!drag) point(null);
  };

  /** Begin to drag a node, by a force or a displacement. */
  const dragNode = (x: number, y: number): Drag | null => {
    const node = scene.pick(x, y);
    if (node === null) return null;
    const load = loads.at(node);
    const { force } = load;
    const held = state.gesture === "hold" ? state.displacementAt(node) : null;
    load.held = held;
    state.node = node;
    reactions.pressed(load);
    return {
      through: scene.body.at(node),
      follow: (pull) => {
        if (held) load.held = moved(held, pull, 1);
        else load.force = moved(force, pull, scene.stiffness);
      },
      end: () => {
        const acts = [...load.force, ...(load.held ?? [])].some(Boolean);
        if (state.motion.isOn || !acts) loads.remove(load);
      },
    };
  };

  /** Begin to drag where the actuators shall bring a node. */
  const dragTarget = (x: number, y: number): Drag | null => {
    const node = scene.pick(x, y);
    if (node === null) return null;
    const through = scene.body.at(node);
    const start = through.toArray().slice(0, content.d);
    state.node = node;
    state.target = { node, place: start };
    return { through, follow: (pull) => (state.target = { node, place: moved(start, pull, 1) }) };
  };

  /** Begin to drag the sphere, which is put on the body where there is none under the pointer. */
  const dragTool = (x: number, y: number): Drag | null => {
    const tool = state.tool && scene.meetsTool(x, y) ? state.tool : placeTool(x, y);
    if (!tool) return null;
    const start = tool.wanted;
    return {
      through: new Vector3().fromArray([...start, 0]),
      follow: (pull) => (tool.wanted = moved(start, pull, 1)),
    };
  };

  /** Put the sphere outside of the body, at the node of its surface that a pointer means. */
  const placeTool = (x: number, y: number): Tool | null => {
    const meant = scene.pick(x, y);
    if (meant === null) return null;
    const at = (node: number): Vector3 => scene.body.at(node);
    const node = scene.closest(surface, at(meant))!;
    const out = outwardsAt(node, content, at).multiplyScalar(state.radius);
    const centre = at(node).add(out).toArray().slice(0, content.d);
    const tool = { centre, wanted: centre, radius: state.radius };
    state.put(tool);
    return tool;
  };

  const point = (node: number | null): void => {
    canvas.classList.toggle("over", node !== null);
    if (node === state.node) return;
    state.node = node;
    reactions.pointed();
  };

  const nodes = loadableNodes(content);

  /** Do what a key asks for; false if it means nothing here. */
  const act = ({ key, shiftKey, timeStamp }: KeyboardEvent): boolean => {
    const { selected } = loads;
    const arrow = { ArrowLeft: -1, ArrowRight: 1, ArrowDown: -2, ArrowUp: 2 }[key];
    if (arrow !== undefined && selected) {
      const step = (shiftKey ? 5 : 1) * Math.sign(arrow) * STEP * Math.max(...content.largest);
      selected.held = null;
      selected.force = moved(selected.force, scene.axis(Math.abs(arrow) - 1), step);
    } else if (key === "Enter" && state.node !== null) {
      reactions.pressed(loads.at(state.node));
    } else if ((key === "Delete" || key === "Backspace") && selected) {
      loads.remove(selected);
    } else {
      return look(key);
    }
    reactions.moved(timeStamp);
    return true;
  };

  /** Choose a node, or change the view; false if a key means neither. */
  const look = (key: string): boolean => {
    if (key === "," || key === ".") {
      const next = nodes.indexOf(state.node ?? -1) + (key === "." ? 1 : -1);
      point(nodes[(next + nodes.length) % nodes.length] ?? null);
    } else if (key === "+" || key === "=" || key === "-") {
      scene.zoom(key === "-" ? 1 / ZOOM : ZOOM);
    } else if (key === "0") {
      scene.home();
      scene.draw();
    } else {
      return false;
    }
    return true;
  };

  canvas.addEventListener("pointerdown", down, { capture: true });
  canvas.addEventListener("pointermove", move);
  canvas.addEventListener("pointerup", release);
  canvas.addEventListener("pointercancel", release);
  canvas.addEventListener("pointerleave", leave);
  canvas.addEventListener("keydown", (event) => {
    if (event.ctrlKey || event.altKey || event.metaKey) return;
    if (act(event)) event.preventDefault();
  });
}

/** Components that a vector moves by a factor of itself. */
function moved(from: readonly number[], by: Vector3, factor: number): number[] {
  return from.map((value, i) => value + factor * by.getComponent(i));
}
