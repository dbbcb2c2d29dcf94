/** Pointer and keys on the body: a drag sets a force, takes hold of the body, or pushes it. */

import { Vector3 } from "three";
import { size, type Load } from "./loads";
import type { State, Tool } from "./state";
import type { Scene } from "./view/scene";
import { loadableNodes, movableSurface, outwardsAt } from "./view/body_mesh";

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

/** A drag that is going on. */
interface Drag {
  pointer: number;
  /** Where it moves, and where it began there. */
  through: Vector3;
  from: Vector3;
  /** Follow the pointer, moved by so much in m. */
  follow: (pull: Vector3) => void;
  end: () => void;
}

/** Listen to pointer and keys. */
export function listen(scene: Scene, state: State, reactions: Reactions): void {
  const { canvas } = scene;
  const surface = movableSurface(state.content);
  let drag: Drag | null = null;

  canvas.addEventListener(
    "pointerdown",
    (event) => {
      if (drag || event.button !== 0) return;
      const { offsetX: x, offsetY: y, pointerId: pointer } = event;
      const begun = state.gesture === "push" ? dragTool(x, y) : dragNode(x, y);
      if (!begun) return;
      event.stopImmediatePropagation();
      canvas.setPointerCapture(pointer);
      canvas.classList.add("dragging");
      drag = { ...begun, pointer, from: scene.inPlane(x, y, begun.through) };
      reactions.moved(event.timeStamp);
    },
    { capture: true },
  );

  canvas.addEventListener("pointermove", (event) => {
    if (drag?.pointer === event.pointerId) {
      const { through, from, follow } = drag;
      follow(scene.inPlane(event.offsetX, event.offsetY, through).sub(from));
      reactions.moved(event.timeStamp);
    } else if (!drag && event.buttons === 0) {
      point(scene.pick(event.offsetX, event.offsetY));
    }
  });

  const release = (event: PointerEvent): void => {
    if (drag?.pointer !== event.pointerId) return;
    const { end } = drag;
    drag = null;
    canvas.classList.remove("dragging");
    end();
    reactions.moved(event.timeStamp);
  };

  /** Begin to drag a node, by a force or a displacement. */
  function dragNode(x: number, y: number): Omit<Drag, "pointer" | "from"> | null {
    const node = scene.pick(x, y);
    if (node === null) return null;
    const load = state.loads.at(node);
    const force = [...load.force];
    const held = state.gesture === "hold" ? state.displacementAt(node) : null;
    load.held = held && [...held];
    state.node = node;
    reactions.pressed(load);
    return {
      through: scene.body.at(node),
      follow: (pull) => {
        if (held) {
          load.held = held.map((value, i) => value + pull.getComponent(i));
        } else {
          pull.multiplyScalar(scene.stiffness);
          load.force = force.map((value, i) => value + pull.getComponent(i));
        }
      },
      end: () => {
        const isIdle = load.force.every((value) => value === 0);
        if (isIdle && (!load.held || size(load.held) === 0)) state.loads.remove(load);
      },
    };
  }

  /** Begin to drag the sphere, which is put on the body where there is none under the pointer. */
  function dragTool(x: number, y: number): Omit<Drag, "pointer" | "from"> | null {
    const tool = state.tool && scene.meetsTool(x, y) ? state.tool : placeTool(x, y);
    if (!tool) return null;
    const start = [...tool.wanted];
    return {
      through: new Vector3().fromArray([...start, 0]),
      follow: (pull) => {
        tool.wanted = start.map((value, i) => value + pull.getComponent(i));
      },
      end: () => undefined,
    };
  }

  /** Put the sphere outside of the body, at the node of its surface that a pointer means. */
  function placeTool(x: number, y: number): Tool | null {
    const meant = scene.pick(x, y);
    if (meant === null) return null;
    const at = (node: number): Vector3 => scene.body.at(node);
    const away = (node: number): number => at(node).distanceToSquared(at(meant));
    const node = surface.reduce((best, other) => (away(other) < away(best) ? other : best));
    const out = outwardsAt(node, state.content, at).multiplyScalar(state.radius);
    const centre = at(node).add(out).toArray().slice(0, state.content.d);
    const tool = { centre, wanted: [...centre], radius: state.radius };
    state.put(tool);
    return tool;
  }
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
    load.held = null;
    load.force = load.force.map((value, i) => value + step * direction.getComponent(i));
  }
}
