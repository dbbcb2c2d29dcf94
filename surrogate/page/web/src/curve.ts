/** The plot of force against displacement of the dragged node, with its 95 % band. */

import { ceiling, digits, forceUnit, lengthUnit, unitOf } from "./units";

const QUANTILE = 1.96; // of the normal distribution, for 95 %
const MOST = 2000; // points

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
    const frame = { left: 62, top: 16, right: width - 12, bottom: height - 30 };
    const x = (force: number): number =>
      frame.left + (force / mostForce) * (frame.right - frame.left);
    const y = (length: number): number =>
      frame.bottom - (Math.max(length, 0) / mostLength) * (frame.bottom - frame.top);
    axes(context, frame, mostForce, mostLength, points.length > 0);
    context.strokeStyle = "rgba(43, 112, 159, 0.28)";
    context.lineWidth = 3;
    for (const { force, displacement, deviation } of points) {
      if (deviation === null) continue;
      context.beginPath();
      context.moveTo(x(force), y(displacement - QUANTILE * deviation));
      context.lineTo(x(force), y(displacement + QUANTILE * deviation));
      context.stroke();
    }
    context.strokeStyle = "#1f5f8b";
    context.lineWidth = 1.75;
    context.beginPath();
    for (const { force, displacement } of points) context.lineTo(x(force), y(displacement));
    context.stroke();
    const last = points.at(-1);
    if (!last) return;
    context.fillStyle = "#c2410c";
    context.beginPath();
    context.arc(x(last.force), y(last.displacement), 4, 0, 2 * Math.PI);
    context.fill();
  }
}

interface Frame {
  left: number;
  top: number;
  right: number;
  bottom: number;
}

function axes(
  context: CanvasRenderingContext2D,
  frame: Frame,
  mostForce: number,
  mostLength: number,
  labelled: boolean,
): void {
  context.strokeStyle = "#e2e6eb";
  context.fillStyle = "#465160";
  context.font = "12px system-ui, sans-serif";
  const [forceFactor, forceLabel] = unitOf(mostForce, forceUnit());
  const [lengthFactor, lengthLabel] = unitOf(mostLength, lengthUnit());
  for (const part of [0, 0.5, 1]) {
    const across = frame.left + part * (frame.right - frame.left);
    const up = frame.bottom - part * (frame.bottom - frame.top);
    context.beginPath();
    context.moveTo(across, frame.top);
    context.lineTo(across, frame.bottom);
    context.moveTo(frame.left, up);
    context.lineTo(frame.right, up);
    context.stroke();
    if (!labelled) continue;
    context.textAlign = part === 1 ? "right" : "center";
    const last = part === 1 ? ` ${forceLabel}` : "";
    context.fillText(
      digits((part * mostForce) / forceFactor) + last,
      across + (last ? 8 : 0),
      frame.bottom + 17,
    );
    context.textAlign = "right";
    const unit = part === 1 ? ` ${lengthLabel}` : "";
    context.fillText(digits((part * mostLength) / lengthFactor) + unit, frame.left - 6, up + 4);
  }
}
