/** The sphere that pushes the body, a disc in the plane. */

import { CircleGeometry, Mesh, SphereGeometry } from "three";
import type { Sphere } from "../touch/sphere";
import { shadedMaterial } from "./materials";

const STEEL = 0x6b7684;

export class Ball {
  readonly mesh: Mesh;

  constructor(d: number) {
    const geometry = d === 2 ? new CircleGeometry(1, 96) : new SphereGeometry(1, 48, 32);
    this.mesh = new Mesh(geometry, shadedMaterial(STEEL, d));
    this.mesh.visible = false;
  }

  /** Draw a sphere, or none. */
  show(tool: Sphere | null): void {
    this.mesh.visible = tool !== null;
    if (!tool) return;
    this.mesh.position.set(tool.centre[0], tool.centre[1], tool.centre[2] ?? 0);
    this.mesh.scale.setScalar(tool.radius);
    this.mesh.updateMatrixWorld();
  }
}
