/** The marks of the supports: hatched lines in the plane, a dark face with ticks in space. */

import { BufferAttribute, BufferGeometry, Group, LineSegments, Mesh, Points, Vector3 } from "three";
import type { Content } from "../content";
import { material } from "./materials";

const COLOUR = 0x3a4554;

/** Draw the supports of a body whose size is `diagonal`. */
export function supportMarks(content: Content, diagonal: number): Group {
  const group = new Group();
  const { supports, d } = content;
  const lines: Vector3[] = [];
  const faces: Vector3[] = [];
  const gap = 0.003 * diagonal;
  const tick = 0.028 * diagonal;
  for (let first = 0; first < supports.length; first += d) {
    const corners = Array.from({ length: d }, (_, i) => position(content, supports[first + i]));
    const out = outward(corners);
    const back = corners.map((corner) => corner.clone().addScaledVector(out, gap));
    if (d === 2) {
      hatch(back[0], back[1], out, tick, lines);
    } else {
      faces.push(...back);
      for (const corner of back)
        lines.push(corner, corner.clone().addScaledVector(out, 0.7 * tick));
    }
  }
  if (lines.length > 0)
    group.add(new LineSegments(geometryOf(lines), material({ colour: COLOUR, opacity: 1 })));
  if (faces.length > 0)
    group.add(new Mesh(geometryOf(faces), material({ colour: COLOUR, opacity: 0.85 })));
  if (supports.length === 0) {
    const held = Array.from(content.clamped.keys()).filter((node) => content.clamped[node]);
    const points = held.map((node) => position(content, node));
    group.add(new Points(geometryOf(points), material({ colour: COLOUR, opacity: 1, size: 9 })));
  }
  return group;
}

/** A line with oblique ticks behind it. */
function hatch(a: Vector3, b: Vector3, out: Vector3, tick: number, lines: Vector3[]): void {
  const along = b.clone().sub(a);
  const count = Math.max(1, Math.round(along.length() / (0.75 * tick)));
  lines.push(a, b);
  const slope = along
    .clone()
    .normalize()
    .add(out)
    .multiplyScalar(0.8 * tick);
  for (let i = 0; i < count; i++) {
    const start = a.clone().addScaledVector(along, (i + 0.5) / count);
    lines.push(start, start.clone().add(slope));
  }
}

function outward(corners: Vector3[]): Vector3 {
  const first = corners[1].clone().sub(corners[0]);
  if (corners.length === 2) return new Vector3(first.y, -first.x, 0).normalize();
  return first.cross(corners[2].clone().sub(corners[0])).normalize();
}

function position({ coordinates, d }: Content, node: number): Vector3 {
  return new Vector3().fromArray([...coordinates.subarray(node * d, node * d + d), 0]);
}

function geometryOf(points: Vector3[]): BufferGeometry {
  const places = new Float32Array(points.flatMap((point) => point.toArray()));
  return new BufferGeometry().setAttribute("position", new BufferAttribute(places, 3));
}
