/** The body in the scene: coloured surface, lines, ghost at rest, nodes, what is between materials. */

import {
  BufferAttribute,
  BufferGeometry,
  Color,
  DynamicDrawUsage,
  Group,
  LineSegments,
  Mesh,
  type Object3D,
  Points,
  type ShaderMaterial,
  Sphere,
  Vector3,
} from "three";
import type { Content } from "../content";
import { material } from "./materials";

const INK = 0x1d2733;
const GHOST = 0x7d8796;
const CURSOR = 0xc2410c;
const SEAM = 0x6b2fa0;
const NEUTRAL = new Color(0.8, 0.82, 0.85); // of a body without values

export class BodyMesh {
  readonly group = new Group();
  readonly surface: Mesh;
  /** Positions of all nodes, with z = 0 in the plane. */
  readonly positions: Float32Array;
  private readonly rest: Float32Array;
  readonly nodes: BufferAttribute;
  private readonly cursor: Points;
  private readonly mesh: LineSegments;

  constructor(private readonly content: Content) {
    const { d, vertices, triangles, lines, features, seams, patches, places } = content;
    const isPlane = d === 2;
    this.rest = new Float32Array(content.nodes * 3).map((_, i) =>
      i % 3 < d ? content.coordinates[Math.floor(i / 3) * d + (i % 3)] : 0,
    );
    this.positions = this.rest.slice();
    this.nodes = dynamic(this.positions);
    const surface = geometryOf(dynamic(new Float32Array(vertices.length * 3)), triangles);
    surface.setAttribute("colour", dynamic(new Float32Array(vertices.length * 3)));
    surface.boundingSphere = new Sphere(new Vector3(), Infinity); // wherever it moves
    this.surface = new Mesh(surface, material({ shade: isPlane ? 0 : 0.38 }));
    this.mesh = segments(this.nodes, lines, INK, 0);
    this.cursor = discs(this.nodes, [0], 15, CURSOR, 1);
    const touchable = patches ? (places ?? []) : loadableNodes(content);
    this.group.add(
      segments(new BufferAttribute(this.rest, 3), features, GHOST, 0.8),
      this.surface,
      this.mesh,
      segments(this.nodes, features, INK, 0.85),
      discs(this.nodes, touchable, isPlane ? 6 : 4, INK, isPlane ? 0.8 : 0.5),
      inside(this.nodes, seams, d, SEAM),
      this.cursor,
    );
    this.group.children.forEach((part: Object3D) => (part.frustumCulled = false));
    this.mark(null);
    this.move(null);
    this.colour(null, 1, []);
  }

  /** Move the nodes by displacements in m; null moves them to rest. */
  move(displacement: Float32Array | null): void {
    const { d, vertices } = this.content;
    this.positions.set(this.rest);
    displacement?.forEach((u, i) => (this.positions[Math.floor(i / d) * 3 + (i % d)] += u));
    this.nodes.needsUpdate = true;
    const { geometry } = this.surface;
    const place = geometry.getAttribute("position");
    vertices.forEach((node, vertex) => {
      for (let i = 0; i < 3; i++) place.array[vertex * 3 + i] = this.positions[node * 3 + i];
    });
    place.needsUpdate = true;
    if (d === 3) geometry.computeVertexNormals();
  }

  /** Colour the nodes by values from 0 to `largest`; null colours them grey. */
  colour(values: Float64Array | null, largest: number, palette: readonly string[]): void {
    const stops = palette.map((colour) => new Color(colour));
    const attribute = this.surface.geometry.getAttribute("colour");
    const colour = NEUTRAL.clone();
    this.content.vertices.forEach((node, vertex) => {
      if (values) {
        const at = Math.min(values[node] / largest, 1) * (stops.length - 1);
        const low = Math.min(Math.floor(at), stops.length - 2);
        colour.lerpColors(stops[low], stops[low + 1], at - low);
      }
      colour.toArray(attribute.array, vertex * 3);
    });
    attribute.needsUpdate = true;
  }

  /** Draw the lines of the mesh fainter, where they are close together. */
  fineLines(close: boolean): void {
    const opacity = this.content.d === 2 ? 0.35 : 0.22;
    const { uniforms } = this.mesh.material as ShaderMaterial;
    uniforms.opacity.value = close ? opacity / 2 : opacity;
  }

  /** Draw the lines of the mesh, or leave them out. */
  showLines(shown: boolean): void {
    this.mesh.visible = shown;
  }

  /** Mark a node, or none. */
  mark(node: number | null): void {
    this.cursor.visible = node !== null;
    if (node !== null) this.cursor.geometry.setIndex([node]);
  }

  /** Position of a node. */
  at(node: number): Vector3 {
    return new Vector3().fromArray(this.positions, node * 3);
  }
}

/** Nodes of the surface that the training loaded. */
export function loadableNodes({ places, vertices, loadable }: Content): number[] {
  return places ?? inOrder(vertices).filter((node) => loadable[node]);
}

/** Nodes of the surface that can move. */
export function movableSurface({ d, vertices, features, clamped }: Content): number[] {
  return inOrder(d === 2 ? features : vertices).filter((node) => !clamped[node]);
}

/** Unit vector from the middle of the cells at a node of the surface to the node. */
export function outwardsAt(
  node: number,
  { cells, corners }: Content,
  at: (node: number) => Vector3,
): Vector3 {
  const around = new Vector3();
  for (let first = 0; first < cells.length; first += corners) {
    const cell = cells.subarray(first, first + corners);
    if (cell.includes(node)) for (const corner of cell) around.add(at(node).sub(at(corner)));
  }
  return around.normalize();
}

function inOrder(nodes: Int32Array): number[] {
  return [...new Set(nodes)].sort((a, b) => a - b);
}

export function dynamic(values: Float32Array): BufferAttribute {
  return new BufferAttribute(values, 3).setUsage(DynamicDrawUsage);
}

export function geometryOf(place: BufferAttribute, index: ArrayLike<number>): BufferGeometry {
  return new BufferGeometry().setAttribute("position", place).setIndex(Array.from(index));
}

export function segments(
  place: BufferAttribute,
  index: ArrayLike<number>,
  colour: number,
  opacity: number,
): LineSegments {
  return new LineSegments(geometryOf(place, index), material({ colour, opacity }));
}

/** Lines in the plane, or faces in space, that are seen through the body. */
export function inside(
  place: BufferAttribute,
  index: ArrayLike<number>,
  d: number,
  colour: number,
): LineSegments | Mesh {
  const look = material({ colour, opacity: d === 2 ? 1 : 0.3 });
  look.depthTest = false;
  const part = new (d === 2 ? LineSegments : Mesh)(geometryOf(place, index), look);
  part.renderOrder = 1;
  return part;
}

export function discs(
  place: BufferAttribute,
  index: ArrayLike<number>,
  size: number,
  colour: number,
  opacity: number,
): Points {
  return new Points(geometryOf(place, index), material({ colour, opacity, size }));
}
