/** The scene: body, supports, arrows, camera; it draws when something has changed. */

import {
  Box3,
  CircleGeometry,
  Mesh,
  MOUSE,
  OrthographicCamera,
  PerspectiveCamera,
  Plane,
  Raycaster,
  Scene as ThreeScene,
  SphereGeometry,
  TOUCH,
  Vector2,
  Vector3,
  WebGLRenderer,
} from "three";
import { OrbitControls } from "three/addons/controls/OrbitControls.js";
import { COLOUR_FIELDS, type FieldName } from "../colours";
import type { State } from "../state";
import { ceiling, units } from "../units";
import { DrawnActuators } from "./actuators";
import { Arrows } from "./arrows";
import { BodyMesh } from "./body_mesh";
import { material } from "./materials";
import { supportMarks } from "./supports";

const REACH = 0.25; // of the body's diagonal: the arrow of the largest force of the training
const GROUND = 0xf7f9fb;
const STEEL = 0x6b7684;
const NEAR = 16; // pixels around a node
const NARROW = 600; // pixels of a stage on which the lines of a mesh are close together
const MANY = 10000; // lines that a processor draws only once the picture stands still
const FADE = 0.99; // of a largest value of before, a frame of a motion
const STILL = 150; // ms

export class Scene {
  readonly body: BodyMesh;
  /** Newtons per metre of an arrow. */
  readonly stiffness: number;
  /** Largest value of the colours in m. */
  largest = 1;
  /** Largest values of the colours that are shown, or were a moment ago in a motion. */
  private readonly most: Partial<Record<FieldName, number>> = {};
  private readonly three = new ThreeScene();
  private readonly renderer: WebGLRenderer;
  private readonly camera: OrthographicCamera | PerspectiveCamera;
  private readonly controls: OrbitControls;
  private readonly arrows: Arrows;
  private readonly actuators: DrawnActuators;
  /** The sphere that pushes the body, a disc in the plane. */
  private readonly ball: Mesh;
  private readonly raycaster = new Raycaster();
  private readonly centre: Vector3;
  private readonly extent: Vector3;
  private readonly diagonal: number;
  private readonly pickable: number[];
  /** Whether lines of the mesh are drawn once the picture stands still. */
  private readonly linesWait: boolean;
  private timer = 0;

  constructor(
    private readonly state: State,
    private readonly place: HTMLElement,
    readonly canvas: HTMLCanvasElement,
    overlay: HTMLElement,
  ) {
    const { content } = state;
    const software = isSoftware();
    this.linesWait = software && content.lines.length > 2 * MANY;
    this.renderer = new WebGLRenderer({ canvas, antialias: !software });
    this.renderer.setPixelRatio(window.devicePixelRatio);
    this.renderer.setClearColor(GROUND);
    this.body = new BodyMesh(content);
    const box = new Box3().setFromArray(this.body.positions);
    this.extent = box.getSize(new Vector3());
    this.centre = box.getCenter(new Vector3());
    this.diagonal = this.extent.length();
    this.stiffness = Math.max(...content.largest) / (REACH * this.diagonal);
    this.actuators = new DrawnActuators(content, this.body.nodes);
    this.arrows = new Arrows(state, overlay, 0.006 * this.diagonal);
    this.ball = new Mesh(
      content.d === 2 ? new CircleGeometry(1, 96) : new SphereGeometry(1, 48, 32),
      material({ colour: STEEL, shade: content.d === 2 ? 0 : 0.55 }),
    );
    this.pickable =
      content.places ?? [...new Set(content.vertices)].filter((node) => !content.clamped[node]);
    const { body, actuators, ball, arrows } = this;
    this.three.add(body.group, actuators.group, supportMarks(content), ball, arrows.group);

    const isPlane = content.d === 2;
    const far = 50 * this.diagonal;
    this.camera = isPlane
      ? new OrthographicCamera(-1, 1, 1, -1, -far, far)
      : new PerspectiveCamera(32, 1, 0.01 * this.diagonal, far);
    if (!isPlane) this.camera.up.set(0, 0, 1);
    this.controls = new OrbitControls(this.camera, canvas);
    const [drag, one, two] = isPlane
      ? [MOUSE.PAN, TOUCH.PAN, TOUCH.DOLLY_PAN]
      : [MOUSE.ROTATE, TOUCH.ROTATE, TOUCH.DOLLY_ROTATE];
    Object.assign(this.controls, {
      zoomToCursor: isPlane,
      enableRotate: !isPlane,
      mouseButtons: { LEFT: drag, MIDDLE: MOUSE.DOLLY, RIGHT: drag },
      touches: { ONE: one, TWO: two },
    });
    this.resize();
    this.controls.addEventListener("change", () => this.draw());
  }

  /** Fit the camera to the body. */
  home(): void {
    const { camera, extent, centre, diagonal } = this;
    const aspect = this.place.clientWidth / Math.max(this.place.clientHeight, 1);
    if (camera instanceof OrthographicCamera) {
      const width = extent.x / 2 + 0.14 * diagonal;
      const height = extent.y / 2 + 0.27 * diagonal;
      const half = Math.max(height, width / aspect);
      Object.assign(camera, {
        top: half,
        bottom: -half,
        left: -half * aspect,
        right: half * aspect,
      });
      camera.zoom = 1;
      camera.position.set(centre.x, centre.y, diagonal);
    } else {
      const narrow = Math.min(1, aspect) * Math.tan((camera.fov * Math.PI) / 360);
      const away = (0.6 * diagonal) / Math.sin(Math.atan(narrow));
      camera.position.copy(new Vector3(0.45, -1, 0.5).setLength(away).add(centre));
      camera.aspect = aspect;
    }
    this.controls.target.copy(centre);
    camera.updateProjectionMatrix();
    this.controls.update();
  }

  /** Take over the size of the page, with the whole body in view. */
  resize(): void {
    this.renderer.setSize(this.place.clientWidth, this.place.clientHeight, false);
    this.body.fineLines(this.place.clientWidth < NARROW);
    this.home();
  }

  /** Come nearer by a factor. */
  zoom(factor: number): void {
    this.controls.dollyOut(factor);
  }

  /** Take over loads, displacements and colours, and draw. */
  show(): void {
    const { state, body } = this;
    const values = state.values();
    const before = state.motion.isOn ? FADE * (this.most[state.field] ?? 0) : 0;
    const most = values?.reduce((a, b) => Math.max(a, b), before) ?? 0;
    this.most[state.field] = most;
    this.largest = most > units.negligible ? ceiling(most) : 1;
    body.move(state.displacement);
    body.colour(values, this.largest, COLOUR_FIELDS[state.field].palette);
    body.mark(state.node);
    this.actuators.show(state);
    this.ball.visible = state.tool !== null;
    if (state.tool) {
      this.ball.position.fromArray([...state.tool.centre, 0]);
      this.ball.scale.setScalar(state.tool.radius);
      this.ball.updateMatrixWorld();
    }
    this.draw();
  }

  /** Draw, for now without the lines of the mesh if there are too many. */
  draw(): void {
    if (this.linesWait) {
      clearTimeout(this.timer);
      this.timer = setTimeout(() => this.drawWhole(), STILL);
    }
    this.render(!this.linesWait);
  }

  /** Draw with all lines. */
  drawWhole(): void {
    clearTimeout(this.timer);
    this.render(true);
  }

  private render(withLines: boolean): void {
    this.body.showLines(withLines);
    this.arrows.draw(
      (node) => this.body.at(node),
      1 / this.stiffness,
      (point) => this.project(point),
    );
    this.renderer.render(this.three, this.camera);
  }

  /** Wait until the graphics processor has drawn. */
  finish(): void {
    const gl = this.renderer.getContext();
    gl.readPixels(0, 0, 1, 1, gl.RGBA, gl.UNSIGNED_BYTE, new Uint8Array(4));
  }

  /** Pixels of a position, from the upper left corner of the canvas. */
  project(point: Vector3): { x: number; y: number } {
    const { x, y } = point.clone().project(this.camera);
    return {
      x: ((1 + x) / 2) * this.place.clientWidth,
      y: ((1 - y) / 2) * this.place.clientHeight,
    };
  }

  /** Whether a pointer is on the sphere. */
  meetsTool(x: number, y: number): boolean {
    this.aim(x, y);
    const met = this.raycaster.intersectObjects([this.ball, this.body.surface]);
    return this.ball.visible && met.length > 0 && met[0].object === this.ball;
  }

  /** The node that a pointer means: near it if it was loaded in training, else the nearest of the face. */
  pick(x: number, y: number): number | null {
    this.aim(x, y);
    const face = this.raycaster.intersectObject(this.body.surface)[0]?.face;
    const { loadable, clamped, d, vertices, places } = this.state.content;
    const away = (node: number): number => {
      const place = this.project(this.body.at(node));
      return Math.hypot(place.x - x, place.y - y);
    };
    if (!face || d === 2) {
      const near = this.pickable.filter((node) => away(node) < NEAR);
      const found =
        least(
          near.filter((node) => loadable[node]),
          away,
        ) ?? least(near, away);
      if (found !== null || !face) return found;
    }
    if (places) return this.closest(places, this.body.at(vertices[face.a]));
    const corners = [face.a, face.b, face.c].map((vertex) => vertices[vertex]);
    return least(
      corners.filter((node) => !clamped[node]),
      away,
    );
  }

  /** The nearest of some nodes in space; null of none. */
  closest(nodes: readonly number[], point: Vector3): number | null {
    return least(nodes, (node) => this.body.at(node).distanceToSquared(point));
  }

  /** Where a pointer is in the plane through a point that faces the camera. */
  inPlane(x: number, y: number, through: Vector3): Vector3 {
    this.aim(x, y);
    const plane = new Plane().setFromNormalAndCoplanarPoint(this.axis(2), through);
    return this.raycaster.ray.intersectPlane(plane, new Vector3()) ?? through.clone();
  }

  /** Unit vector to the right (0), upwards (1) or towards the camera (2). */
  axis(column: number): Vector3 {
    return new Vector3().setFromMatrixColumn(this.camera.matrixWorld, column);
  }

  private aim(x: number, y: number): void {
    const { clientWidth, clientHeight } = this.place;
    const pointer = new Vector2((2 * x) / clientWidth - 1, 1 - (2 * y) / clientHeight);
    this.camera.updateMatrixWorld();
    this.raycaster.setFromCamera(pointer, this.camera);
  }
}

/** The node that is the least away; null of none. */
function least(nodes: readonly number[], away: (node: number) => number): number | null {
  const all = nodes.map(away);
  return nodes[all.indexOf(Math.min(...all))] ?? null;
}

/** True if a processor draws, for which smoothed edges are too slow. */
function isSoftware(): boolean {
  const gl = document.createElement("canvas").getContext("webgl2");
  const names = gl?.getExtension("WEBGL_debug_renderer_info");
  const name = names ? String(gl!.getParameter(names.UNMASKED_RENDERER_WEBGL)) : "";
  gl?.getExtension("WEBGL_lose_context")?.loseContext();
  return /swiftshader|llvmpipe|software|basic render/i.test(name);
}
