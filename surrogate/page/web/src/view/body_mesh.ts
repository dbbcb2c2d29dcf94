/** The body in the scene: its coloured surface and lines, its ghost at rest, its nodes. */

import {
  BufferAttribute,
  BufferGeometry,
  CanvasTexture,
  DoubleSide,
  DynamicDrawUsage,
  Group,
  LineBasicMaterial,
  LineSegments,
  Mesh,
  MeshBasicMaterial,
  MeshLambertMaterial,
  Points,
  PointsMaterial,
  Sphere,
  Vector3,
} from "three";
import { NEUTRAL, scale, type Rgb } from "../colours";
import type { Content } from "../content";

const INK = 0x1d2733;

export class BodyMesh {
  readonly group = new Group();
  readonly surface: Mesh;
  /** Positions of all nodes, with z = 0 in the plane. */
  readonly positions: Float32Array;
  private readonly rest: Float32Array;
  private readonly place: BufferAttribute;
  private readonly colours: BufferAttribute;
  private readonly cursor: Points;

  constructor(private readonly content: Content) {
    const { d, nodes, coordinates } = content;
    this.rest = new Float32Array(nodes * 3);
    for (let node = 0; node < nodes; node++) {
      for (let i = 0; i < d; i++) this.rest[node * 3 + i] = coordinates[node * d + i]!;
    }
    this.positions = this.rest.slice();
    this.place = new BufferAttribute(this.positions, 3).setUsage(DynamicDrawUsage);
    this.colours = new BufferAttribute(new Float32Array(nodes * 3), 3).setUsage(DynamicDrawUsage);

    const look = { vertexColors: true, side: DoubleSide, polygonOffset: true };
    const offset = { polygonOffsetFactor: 1, polygonOffsetUnits: 1 };
    const material =
      d === 2
        ? new MeshBasicMaterial({ ...look, ...offset })
        : new MeshLambertMaterial({ ...look, ...offset, flatShading: true });
    this.surface = new Mesh(this.geometry(content.triangles), material);
    this.surface.geometry.setAttribute("color", this.colours);

    const ghost = new BufferAttribute(this.rest, 3);
    this.group.add(
      this.linesOf(content.features, ghost, 0x8a94a3, 0.75),
      this.surface,
      this.linesOf(content.lines, this.place, INK, d === 2 ? 0.35 : 0.22),
      this.linesOf(content.features, this.place, INK, 0.85),
      this.nodesOf(loadableNodes(content), 5, 0x1d2733, 0.65),
    );
    this.cursor = this.nodesOf([0], 15, 0xd1361f, 1);
    this.cursor.visible = false;
    this.group.add(this.cursor);
    this.colour(null, 1, []);
  }

  /** Move the nodes by displacements in m; null moves them to rest. */
  move(displacement: Float32Array | null): void {
    const { d, nodes } = this.content;
    this.positions.set(this.rest);
    if (displacement) {
      for (let node = 0; node < nodes; node++) {
        for (let i = 0; i < d; i++) this.positions[node * 3 + i]! += displacement[node * d + i]!;
      }
    }
    this.place.needsUpdate = true;
  }

  /** Colour the nodes by values from 0 to `largest`; null colours them grey. */
  colour(values: Float64Array | null, largest: number, palette: readonly string[]): void {
    const colour = values ? scale(palette) : null;
    const rgb: Rgb = [...NEUTRAL];
    for (let node = 0; node < this.content.nodes; node++) {
      colour?.(values![node]! / largest, rgb);
      for (let i = 0; i < 3; i++) this.colours.array[node * 3 + i] = linear(rgb[i]!);
    }
    this.colours.needsUpdate = true;
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

  private geometry(index: ArrayLike<number>, place = this.place): BufferGeometry {
    const geometry = new BufferGeometry();
    geometry.setAttribute("position", place);
    geometry.setIndex(new BufferAttribute(Uint32Array.from(index), 1));
    geometry.boundingSphere = new Sphere(new Vector3(), Infinity);
    return geometry;
  }

  private linesOf(
    index: ArrayLike<number>,
    place: BufferAttribute,
    color: number,
    opacity: number,
  ): LineSegments {
    const material = new LineBasicMaterial({ color, opacity, transparent: true });
    const lines = new LineSegments(this.geometry(index, place), material);
    lines.frustumCulled = false;
    return lines;
  }

  private nodesOf(index: ArrayLike<number>, size: number, color: number, opacity: number): Points {
    const material = new PointsMaterial({
      color,
      size: size * window.devicePixelRatio,
      sizeAttenuation: false,
      map: disc(),
      alphaTest: 0.4,
      transparent: true,
      opacity,
    });
    const points = new Points(this.geometry(index), material);
    points.frustumCulled = false;
    return points;
  }
}

/** Nodes of the surface that the training loaded. */
export function loadableNodes(content: Content): number[] {
  const drawn = new Set(content.triangles);
  return [...drawn].filter((node) => content.loadable[node]).sort((a, b) => a - b);
}

/** A component of sRGB as the linear light that three.js blends. */
function linear(component: number): number {
  return component <= 0.04045 ? component / 12.92 : ((component + 0.055) / 1.055) ** 2.4;
}

function disc(): CanvasTexture {
  const canvas = document.createElement("canvas");
  canvas.width = canvas.height = 32;
  const context = canvas.getContext("2d")!;
  context.fillStyle = "white";
  context.arc(16, 16, 15, 0, 2 * Math.PI);
  context.fill();
  return new CanvasTexture(canvas);
}
