/** The arrows of the loads, each with its label. */

import { type Color, ConeGeometry, CylinderGeometry, Group, MathUtils, Mesh, Vector3 } from "three";
import { element } from "../elements";
import type { Load } from "../loads";
import type { State } from "../state";
import { asForce } from "../units";
import { material } from "./materials";

const SELECTED = 0xc2410c;
const OTHER = 0x7c3a1d;
const BEYOND = 0xb00020;
const UP = new Vector3(0, 1, 0);
const SHAFT = new CylinderGeometry(0.5, 0.5, 1, 12).translate(0, 0.5, 0);
const HEAD = new ConeGeometry(1, 1, 20).translate(0, 0.5, 0);

/** An arrow of some width in m. */
class Arrow {
  readonly look = material({ colour: OTHER, opacity: 1 });
  readonly group = new Group();
  readonly label = element("span", "", "arrow-label");
  private readonly shaft = new Mesh(SHAFT, this.look);
  private readonly head = new Mesh(HEAD, this.look);

  constructor(private readonly width: number) {
    this.look.depthTest = false;
    this.shaft.renderOrder = this.head.renderOrder = 2;
    this.group.add(this.shaft, this.head);
  }

  place(start: Vector3, vector: Vector3): void {
    const { width, group, shaft, head } = this;
    const length = Math.max(vector.length(), 1e-9 * width);
    const tip = Math.min(4.5 * width, length);
    group.position.copy(start);
    group.quaternion.setFromUnitVectors(UP, vector.clone().divideScalar(length));
    group.visible = vector.length() > 0;
    shaft.scale.set(width, Math.max(length - tip, 1e-9 * width), width);
    head.position.y = length - tip;
    head.scale.set(tip / 2.5, tip, tip / 2.5);
  }
}

export class Arrows {
  readonly group = new Group();
  private readonly arrows = new Map<Load, Arrow>();

  /**
   * @param overlay - element for the labels
   * @param width - of the shafts in m
   */
  constructor(
    private readonly state: State,
    private readonly overlay: HTMLElement,
    private readonly width: number,
  ) {}

  /**
   * Draw the loads.
   *
   * @param at - position of a node
   * @param metres - length of an arrow in m per N
   * @param project - pixels of a position
   */
  draw(
    at: (node: number) => Vector3,
    metres: number,
    project: (point: Vector3) => { x: number; y: number },
  ): void {
    const { all, selected } = this.state.loads;
    for (const [load, { group, label }] of this.arrows) {
      if (all.includes(load)) continue;
      group.removeFromParent();
      label.remove();
      this.arrows.delete(load);
    }
    all.forEach((load, number) => {
      const arrow = this.arrows.get(load) ?? this.add(load);
      const vector = new Vector3().fromArray([...load.force, 0]).multiplyScalar(metres);
      arrow.place(at(load.key), vector);
      const colour = this.state.isDoubtful(load) ? BEYOND : load === selected ? SELECTED : OTHER;
      (arrow.look.uniforms.colour.value as Color).set(colour);
      const force = asForce(vector.length() / metres);
      arrow.label.textContent = `${number + 1}: ${force}${load.held ? ", held" : ""}`;
      arrow.label.classList.toggle("selected", load === selected);
      this.putLabel(arrow.label, project(at(load.key).add(vector)));
    });
  }

  /** Put a label beside the pixels of a tip, inside of the picture. */
  private putLabel(label: HTMLElement, { x, y }: { x: number; y: number }): void {
    const { clientWidth, clientHeight } = this.overlay;
    const width = label.offsetWidth + 8;
    const beside = x + 10 + width < clientWidth ? x + 10 : x - 10 - width;
    const left = MathUtils.clamp(beside, 4, clientWidth - width);
    const top = MathUtils.clamp(y - 10, 4, clientHeight - label.offsetHeight - 4);
    label.style.transform = `translate(${left}px, ${top}px)`;
  }

  private add(load: Load): Arrow {
    const arrow = new Arrow(this.width);
    this.arrows.set(load, arrow);
    this.group.add(arrow.group);
    this.overlay.append(arrow.label);
    return arrow;
  }
}
