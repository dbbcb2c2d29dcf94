/** The body in the scene: its coloured surface and lines, its ghost at rest, its nodes. */

import {
  BufferAttribute,
  BufferGeometry,
  DynamicDrawUsage,
  Group,
  LineSegments,
  Mesh,
  Points,
  type ShaderMaterial,
  Sphere,
  Vector3,
} from "three";
import { NEUTRAL, scale, type Rgb } from "../colours";
import type { Content } from "../content";
import { material } from "./materials";

const INK = 0x1d2733;
const GHOST = 0x7d8796;
const CURSOR = 0xc2410c;

export class BodyMesh {
  readonly group = new Group();
  readonly surface: Mesh;
  /** Positions of all nodes, with z = 0 in the plane. */
  readonly positions: Float32Array;
  private readonly rest: Float32Array;
  private readonly nodes: BufferAttribute;
  private readonly cursor: Points;
  private readonly mesh: LineSegments;

  constructor(private readonly content: Content) {
    const { d, coordinates, vertices, lines, features } = content;
    this.rest = new Float32Array(content.nodes * 3);
    for (let node = 0; node < content.nodes; node++) {
      for (let i = 0; i < d; i++) this.rest[node * 3 + i] = coordinates[node * d + i]!;
    }
    this.positions = this.rest.slice();
    this.nodes = dynamic(this.positions);
    const surface = geometryOf(dynamic(new Float32Array(vertices.length * 3)), content.triangles);
    surface.setAttribute("colour", dynamic(new Float32Array(vertices.length * 3)));
    this.surface = new Mesh(surface, material({ shade: d === 2 ? 0 : 0.38 }));
    this.surface.frustumCulled = false;
    this.cursor = this.discs([0], 15, CURSOR, 1);
    this.cursor.visible = false;
    this.mesh = segments(this.nodes, lines, INK, 0);
    const ghost = new BufferAttribute(this.rest, 3);
    this.group.add(
      segments(ghost, features, GHOST, 0.8),
      this.surface,
      this.mesh,
      segments(this.nodes, features, INK, 0.85),
      this.discs(
        content.patches ? (content.places ?? []) : loadableNodes(content),
        d === 2 ? 6 : 4,
        INK,
        d === 2 ? 0.8 : 0.5,
      ),
      this.cursor,
    );
    this.move(null);
    this.colour(null, 1, []);
  }

  /** Move the nodes by displacements in m; null moves them to rest. */
  move(displacement: Float32Array | null): void {
    const { d, nodes, vertices } = this.content;
    this.positions.set(this.rest);
    if (displacement) {
      for (let node = 0; node < nodes; node++) {
        for (let i = 0; i < d; i++) this.positions[node * 3 + i] += displacement[node * d + i];
      }
    }
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
    const { vertices } = this.content;
    const colour = values ? scale(palette) : null;
    const rgb: Rgb = [...NEUTRAL];
    const attribute = this.surface.geometry.getAttribute("colour");
    for (let vertex = 0; vertex < vertices.length; vertex++) {
      colour?.(values![vertices[vertex]] / largest, rgb);
      for (let i = 0; i < 3; i++) attribute.array[vertex * 3 + i] = rgb[i]!;
    }
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

  private discs(index: ArrayLike<number>, size: number, colour: number, opacity: number): Points {
    const points = new Points(geometryOf(this.nodes, index), material({ colour, opacity, size }));
    points.frustumCulled = false;
    return points;
  }
}

/** Nodes of the surface that the training loaded. */
export function loadableNodes(content: Content): number[] {
  if (content.places) return content.places;
  const drawn = new Set(content.vertices);
  return [...drawn].filter((node) => content.loadable[node]).sort((a, b) => a - b);
}

function dynamic(values: Float32Array): BufferAttribute {
  return new BufferAttribute(values, 3).setUsage(DynamicDrawUsage);
}

function geometryOf(place: BufferAttribute, index: ArrayLike<number>): BufferGeometry {
  const geometry = new BufferGeometry();
  geometry.setAttribute("position", place);
  geometry.setIndex(new BufferAttribute(Uint32Array.from(index), 1));
  geometry.boundingSphere = new Sphere(new Vector3(), Infinity);
  return geometry;
}

function segments(
  place: BufferAttribute,
  index: ArrayLike<number>,
  colour: number,
  opacity: number,
): LineSegments {
  const lines = new LineSegments(geometryOf(place, index), material({ colour, opacity }));
  lines.frustumCulled = false;
  return lines;
}

/** Nodes of the surface that can move. */
export function movableSurface({ d, vertices, features, clamped }: Content): number[] {
  const drawn = new Set(d === 2 ? features : vertices);
  return [...drawn].filter((node) => !clamped[node]).sort((a, b) => a - b);
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
