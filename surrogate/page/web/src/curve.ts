/** The plot of force against displacement of the dragged node, with its 95 % band. */

import { ceiling, digits, unitOf, units } from "./units";

const QUANTILE = 1.96; // of the normal distribution, for 95 %
const MOST = 2000; // points
const LEFT = 62; // pixels beside the plot, for numbers
const [TOP, RIGHT, BOTTOM] = [16, 12, 30];

interface Point {
  force: number;
  displacement: number;
  deviation: number | null;
}

export class Curve {
  private points: Point[] = [];
  private node: number | null = null;

  constructor(private readonly canvas: HTMLCanvasElement) {}

  clear(): void {
    this.points = [];
  }

  /** Add a point of a node: force in N, displacement and its standard deviation in m. */
  add(node: number, force: number, displacement: number, deviation: number | null): void {
    if (node !== this.node) this.clear();
    this.node = node;
    if (this.points.at(-1)?.force === force) this.points.pop(); // a better displacement
    this.points.push({ force, displacement, deviation });
    if (this.points.length > MOST) this.points.shift();
  }

  draw(): void {
    const { canvas, points } = this;
    const ratio = window.devicePixelRatio;
    const [width, height] = [canvas.clientWidth, canvas.clientHeight];
    canvas.width = width * ratio;
    canvas.height = height * ratio;
    const context = canvas.getContext("2d")!;
    context.scale(ratio, ratio);
    const reach = points.map((p) => p.displacement + QUANTILE * (p.deviation ?? 0));
    const mostForce = ceiling(Math.max(0, ...points.map((p) => p.force)));
    const mostLength = ceiling(Math.max(0, ...reach));
    const x = (force: number): number => LEFT + (force / mostForce) * (width - RIGHT - LEFT);
    const y = (length: number): number =>
      height - BOTTOM - (Math.max(length, 0) / mostLength) * (height - BOTTOM - TOP);
    const line = (colour: string, width: number, ...ends: [number, number][]): void => {
      context.strokeStyle = colour;
      context.lineWidth = width;
      context.beginPath();
      for (const [force, length] of ends) context.lineTo(x(force), y(length));
      context.stroke();
    };

    context.fillStyle = "#465160";
    context.font = "12px system-ui, sans-serif";
    const [newtons, forceLabel] = unitOf(mostForce, units.force);
    const [metres, lengthLabel] = unitOf(mostLength, units.length);
    for (const part of [0, 0.5, 1]) {
      const [force, length] = [part * mostForce, part * mostLength];
      line("#e2e6eb", 1, [force, 0], [force, mostLength]);
      line("#e2e6eb", 1, [0, length], [mostForce, length]);
      if (points.length === 0) continue;
      const [end, after] = part === 1 ? [` ${forceLabel}`, 8] : ["", 0];
      context.textAlign = part === 1 ? "right" : "center";
      context.fillText(digits(force / newtons) + end, x(force) + after, height - BOTTOM + 17);
      context.textAlign = "right";
      const unit = part === 1 ? ` ${lengthLabel}` : "";
      context.fillText(digits(length / metres) + unit, LEFT - 6, y(length) + 4);
    }
    for (const { force, displacement, deviation } of points) {
      const half = QUANTILE * (deviation ?? 0);
      if (deviation !== null)
        line("#2b709f47", 3, [force, displacement - half], [force, displacement + half]);
    }
    line("#1f5f8b", 1.75, ...points.map((p): [number, number] => [p.force, p.displacement]));
    const last = points.at(-1);
    if (!last) return;
    context.fillStyle = "#c2410c";
    context.beginPath();
    context.arc(x(last.force), y(last.displacement), 4, 0, 2 * Math.PI);
    context.fill();
  }
}
