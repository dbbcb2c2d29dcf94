/** Files of what the page shows: a picture, a table, arrays. */

import { zipSync } from "fflate";
import { COLOUR_FIELDS } from "./colours";
import { asForce, digits, forceUnit, lengthUnit, place, unitOf } from "./units";
import { size } from "./loads";
import type { State } from "./state";

/** Nodal vectors, (nodes · d), by their names in solution files. */
function solution(state: State): Record<string, Float64Array> {
  const { content, loads, fields, certificate } = state;
  const rest = new Float64Array(content.nodes * content.d);
  const found: Record<string, Float64Array> = {
    coordinates: content.coordinates,
    force: loads.nodal(),
    displacement: rest,
  };
  for (const [name, values] of Object.entries(fields ?? {}))
    found[name] = Float64Array.from(values);
  if (certificate?.error) found.estimated_error = certificate.error;
  return found;
}

/** A table with a row for every node: places, forces in N, fields in m. */
export function asCsv(state: State): Blob {
  const { nodes, d } = state.content;
  const arrays = Object.entries(solution(state));
  const axes = ["x", "y", "z"].slice(0, d);
  const head = arrays.flatMap(([name]) =>
    axes.map((axis) => (name === "coordinates" ? axis : `${name}_${axis}`)),
  );
  const rows = Array.from({ length: nodes }, (_, node) =>
    arrays.flatMap(([, values]) => axes.map((_, i) => values[node * d + i])).join(","),
  );
  return new Blob([[head.join(","), ...rows, ""].join("\n")], { type: "text/csv" });
}

/** NumPy's archive, with the arrays of `surrogate predict --out FILE.npz`. */
export function asNpz(state: State): Blob {
  const { nodes, d } = state.content;
  const files: Record<string, Uint8Array> = {};
  for (const [name, values] of Object.entries(solution(state))) {
    files[`${name}.npy`] = npy(values, [nodes, d]);
  }
  return new Blob([zipSync(files, { level: 0 })]);
}

/** NumPy's format 1.0 of an array in double precision. */
function npy(values: Float64Array, shape: number[]): Uint8Array {
  const text = `{'descr': '<f8', 'fortran_order': False, 'shape': (${shape.join(", ")}), }`;
  const length = Math.ceil((10 + text.length + 1) / 64) * 64;
  const file = new Uint8Array(length + values.byteLength);
  file.set([0x93, ...new TextEncoder().encode("NUMPY"), 1, 0]);
  new DataView(file.buffer).setUint16(8, length - 10, true);
  file.set(new TextEncoder().encode(text.padEnd(length - 11) + "\n"), 10);
  file.set(new Uint8Array(values.buffer, values.byteOffset, values.byteLength), length);
  return file;
}

/** The body as it is drawn, with colour bar and loads. */
export function asPng(state: State, drawn: HTMLCanvasElement, largest: number): Promise<Blob> {
  const picture = document.createElement("canvas");
  picture.width = drawn.width;
  picture.height = drawn.height;
  const context = picture.getContext("2d")!;
  context.fillStyle = "white";
  context.fillRect(0, 0, picture.width, picture.height);
  context.drawImage(drawn, 0, 0);
  const unit = drawn.width / drawn.clientWidth;
  context.scale(unit, unit);
  const [width, height] = [drawn.clientWidth, drawn.clientHeight];
  context.fillStyle = "#1d2733";
  context.font = "600 17px system-ui, sans-serif";
  context.fillText(state.content.case, 18, 30);
  context.font = "14px system-ui, sans-serif";
  const { coordinates, d } = state.content;
  state.loads.all.forEach((load, number) => {
    const at = place(coordinates.subarray(load.node * d, load.node * d + d));
    const text = `${number + 1}: ${asForce(size(load.force))} at ${at} ${lengthUnit()}`;
    context.fillText(text, 18, 54 + 20 * number);
  });
  const { all, body } = state.loads;
  const others: string[] = [];
  if (size(body.force) > 0) {
    others.push(`Body force ${place(body.force)} ${forceUnit()}/${lengthUnit()}³`);
  }
  if (state.tool) others.push(`Sphere: ${asForce(size(state.reaction()))}`);
  others.forEach((text, row) => {
    context.fillText(text, 18, 54 + 20 * (all.length + row));
  });
  const values = state.values();
  if (values) {
    const { label, palette } = COLOUR_FIELDS[state.field];
    const [factor, unit] = unitOf(largest, lengthUnit());
    const bar = context.createLinearGradient(18, 0, 18 + Math.min(300, width - 36), 0);
    palette.forEach((colour, i) => {
      bar.addColorStop(i / (palette.length - 1), colour);
    });
    context.fillText(`${label} in ${unit}`, 18, height - 54);
    [0, 0.5, 1].forEach((part) => {
      context.textAlign = (["left", "center", "right"] as const)[part * 2]!;
      const text = digits((part * largest) / factor);
      context.fillText(text, 18 + part * Math.min(300, width - 36), height - 14);
    });
    context.fillStyle = bar;
    context.fillRect(18, height - 46, Math.min(300, width - 36), 14);
  }
  return new Promise((resolve, reject) => {
    picture.toBlob((blob) => {
      if (blob) resolve(blob);
      else reject(new Error("no picture"));
    }, "image/png");
  });
}

/** Let the browser save a file. */
export function download(blob: Blob, name: string): void {
  const link = document.createElement("a");
  link.href = URL.createObjectURL(blob);
  link.download = name;
  link.click();
  setTimeout(() => {
    URL.revokeObjectURL(link.href);
  }, 10_000);
}
