/** The marks of the supports, which `surrogate/page/surface.py` places. */

import { BufferAttribute, BufferGeometry, Group, LineSegments, Mesh, Points } from "three";
import type { Content } from "../content";
import { material } from "./materials";

const COLOUR = 0x3a4554;

export function supportMarks({ marks }: Content): Group {
  return new Group().add(
    new LineSegments(geometryOf(marks.lines), material({ colour: COLOUR, opacity: 1 })),
    new Mesh(geometryOf(marks.faces), material({ colour: COLOUR, opacity: 0.85 })),
    new Points(geometryOf(marks.points), material({ colour: COLOUR, opacity: 1, size: 9 })),
  );
}

function geometryOf(places: Float64Array): BufferGeometry {
  const attribute = new BufferAttribute(Float32Array.from(places), 3);
  return new BufferGeometry().setAttribute("position", attribute);
}
