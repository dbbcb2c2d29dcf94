/** The arrows of the loads, each with its label. */

import {
  ConeGeometry,
  CylinderGeometry,
  Group,
  MathUtils,
  Mesh,
  Vector3,
  type ShaderMaterial,
} from "three";
import { size, type Load } from "../loads";
import { asForce } from "../units";
import { material, rgb } from "./materials";

const SELECTED = 0xc2410c;
const OTHER = 0x7c3a1d;
const BEYOND = 0xb00020;
const UP = new Vector3(0, 1, 0);

interface Arrow {
  group: Group;
  shaft: Mesh;
  head: Mesh;
  look: ShaderMaterial;
  label: HTMLElement;
}

export class Arrows {
  readonly group = new Group();
  private readonly arrows = new Map<Load, Arrow>();

  /**
   * @param overlay - element for the labels
   * @param width - of the shafts in m
   */
  constructor(
    private readonly overlay: HTMLElement,
    private readonly width: number,
  ) {}

  /**
   * Draw the loads.
   *
   * @param at - position of a node
   * @param metres - length of an arrow in m per N
   * @param beyond - true for a load outside the training range
   * @param project - pixels of a position
   */
  draw(
    loads: readonly Load[],
    selected: Load | null,
    at: (node: number) => Vector3,
    metres: number,
    beyond: (load: Load) => boolean,
    project: (point: Vector3) => { x: number; y: number },
  ): void {
    for (const [load, arrow] of this.arrows) {
      if (!loads.includes(load)) this.drop(load, arrow);
    }
    loads.forEach((load, number) => {
      const arrow = this.arrows.get(load) ?? this.add(load);
      const vector = new Vector3(load.force[0], load.force[1], load.force[2] ?? 0);
      vector.multiplyScalar(metres);
      this.place(arrow, at(load.node), vector);
      const colour = beyond(load) ? BEYOND : load === selected ? SELECTED : OTHER;
      arrow.look.uniforms.colour.value = rgb(colour);
      const tip = at(load.node).add(vector);
      const { x, y } = project(tip);
      const held = load.held ? ", held" : "";
      arrow.label.textContent = `${number + 1}: ${asForce(size(load.force))}${held}`;
      arrow.label.classList.toggle("selected", load === selected);
      const { clientWidth, clientHeight } = this.overlay;
      const width = arrow.label.offsetWidth + 8;
      const beside = x + 10 + width < clientWidth ? x + 10 : x - 10 - width;
      const left = MathUtils.clamp(beside, 4, clientWidth - width);
      const top = MathUtils.clamp(y - 10, 4, clientHeight - arrow.label.offsetHeight - 4);
      arrow.label.style.transform = `translate(${left}px, ${top}px)`;
    });
  }

  private place(arrow: Arrow, start: Vector3, vector: Vector3): void {
    const length = Math.max(vector.length(), 1e-9 * this.width);
    const head = Math.min(4.5 * this.width, length);
    arrow.group.position.copy(start);
    arrow.group.quaternion.setFromUnitVectors(UP, vector.clone().divideScalar(length));
    arrow.shaft.scale.set(this.width, Math.max(length - head, 1e-9 * this.width), this.width);
    arrow.head.position.y = length - head;
    arrow.head.scale.set(head / 2.5, head, head / 2.5);
    arrow.group.visible = vector.length() > 0;
  }

  private add(load: Load): Arrow {
    const look = material({ colour: OTHER, opacity: 1 });
    look.depthTest = false;
    const shaft = new Mesh(new CylinderGeometry(0.5, 0.5, 1, 12).translate(0, 0.5, 0), look);
    const head = new Mesh(new ConeGeometry(1, 1, 20).translate(0, 0.5, 0), look);
    shaft.renderOrder = head.renderOrder = 2;
    const group = new Group();
    group.add(shaft, head);
    const label = document.createElement("span");
    label.className = "arrow-label";
    this.overlay.append(label);
    const arrow = { group, shaft, head, look, label };
    this.arrows.set(load, arrow);
    this.group.add(group);
    return arrow;
  }

  private drop(load: Load, arrow: Arrow): void {
    this.group.remove(arrow.group);
    arrow.label.remove();
    arrow.shaft.geometry.dispose();
    arrow.head.geometry.dispose();
    this.arrows.delete(load);
  }
}
