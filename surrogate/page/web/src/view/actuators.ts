/** What actuates the body, seen through it: walls of chambers, cables, and the target of a node. */

import { type BufferAttribute, Group, type Points } from "three";
import type { Content } from "../content";
import { placesOf } from "../mechanics/following";
import type { State } from "../state";
import { discs, dynamic, inside, segments } from "./body_mesh";

const CHAMBER = 0x1f5f8b;
const CABLE = 0x0f7a4d;
const TARGET = 0xb00020;

export class DrawnActuators {
  readonly group = new Group();
  private readonly cables: BufferAttribute;
  private readonly target: Points;
  private readonly place = dynamic(new Float32Array(3));

  /** @param nodes - positions of the nodes of the body */
  constructor(
    private readonly content: Content,
    nodes: BufferAttribute,
  ) {
    const { d, actuation, body } = content;
    const of = body?.cables?.units ?? new Int32Array();
    this.cables = dynamic(new Float32Array(3 * of.length));
    const legs = [...of.keys()].flatMap((i) => (of[i] === of[i + 1] ? [i, i + 1] : []));
    const chambers = actuation?.chambers ?? [];
    this.target = discs(this.place, [0], 17, TARGET, 1);
    const parts = [
      inside(nodes, chambers, d, CHAMBER),
      segments(this.cables, legs, CABLE, 1),
      discs(this.cables, [...of.keys()], 5, CABLE, 1),
      this.target,
    ];
    for (const part of parts) {
      Object.assign(part, { frustumCulled: false, renderOrder: 1 });
      Object.assign(part.material, { depthTest: false });
    }
    this.group.add(...parts);
  }

  /** Move all of it to where it is. */
  show({ displacement, target }: State): void {
    const { body, d } = this.content;
    this.target.visible = target !== null;
    this.place.array.set(target?.place ?? []);
    this.place.needsUpdate = true;
    if (!body?.cables) return;
    const u = displacement && new Float32Array(displacement.buffer); // of all points
    const x = body.coordinates.map((value, i) => value + (u?.[i] ?? 0));
    placesOf(body.cables, x, d).forEach(
      (value, i) => (this.cables.array[3 * Math.floor(i / d) + (i % d)] = value),
    );
    this.cables.needsUpdate = true;
  }
}
