/** Files of what the page shows: a picture, a table, arrays. */

import { zipSync, type Zippable } from "fflate";
import { bar, COLOUR_FIELDS } from "./colours";
import { norm } from "./mechanics/vectors";
import type { State } from "./state";
import { asForce, place, units } from "./units";
import type { Scene } from "./view/scene";

export type Kind = "png" | "csv" | "npz";

/** Let the browser save a file. */
export async function save(kind: Kind, state: State, scene: Scene): Promise<void> {
  const link = document.createElement("a");
  const makers = { png: asPng, csv: asCsv, npz: asNpz };
  link.href = URL.createObjectURL(await makers[kind](state, scene));
  link.download = `${state.content.case}.${kind}`;
  link.click();
  setTimeout(() => URL.revokeObjectURL(link.href), 10_000);
}

/** Nodal vectors, (nodes · d), by their names in solution files. */
function solution(state: State): Record<string, Float64Array> {
  const { content, loads, fields, certificate } = state;
  const named = { displacement: new Float64Array(content.coordinates.length), ...fields };
  return {
    coordinates: content.coordinates,
    force: loads.nodal(),
    ...Object.fromEntries(
      Object.entries(named).map(([name, values]) => [name, Float64Array.from(values)]),
    ),
    ...(certificate?.error && { estimated_error: certificate.error }),
  };
}

/** A table with a row for every node: places, forces in N, fields in m. */
function asCsv(state: State): Blob {
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
function asNpz(state: State): Blob {
  const { nodes, d } = state.content;
  const files = Object.entries(solution(state)).map(([name, values]) => [
    `${name}.npy`,
    npy(values, [nodes, d]),
  ]);
  return new Blob([zipSync(Object.fromEntries(files) as Zippable, { level: 0 })]);
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
async function asPng(state: State, { canvas, largest }: Scene): Promise<Blob> {
  const picture = new OffscreenCanvas(canvas.width, canvas.height);
  const context = picture.getContext("2d")!;
  context.drawImage(canvas, 0, 0);
  const unit = canvas.width / canvas.clientWidth;
  context.scale(unit, unit);
  context.fillStyle = "#1d2733";
  context.font = "600 17px system-ui, sans-serif";
  context.fillText(state.content.case, 18, 30);
  context.font = "14px system-ui, sans-serif";
  loadTexts(state).forEach((text, row) => context.fillText(text, 18, 54 + 20 * row));
  if (!state.values()) return picture.convertToBlob();
  const { title, ticks } = bar(state.field, largest);
  const [height, width] = [canvas.clientHeight, Math.min(300, canvas.clientWidth - 36)];
  context.fillText(title, 18, height - 54);
  ticks.forEach((tick, i) => {
    context.textAlign = (["left", "center", "right"] as const)[i];
    context.fillText(tick, 18 + (i / 2) * width, height - 14);
  });
  const ramp = context.createLinearGradient(18, 0, 18 + width, 0);
  const { palette } = COLOUR_FIELDS[state.field];
  palette.forEach((colour, i) => ramp.addColorStop(i / (palette.length - 1), colour));
  context.fillStyle = ramp;
  context.fillRect(18, height - 46, width, 14);
  return picture.convertToBlob();
}

/** Lines that say the loads. */
function loadTexts(state: State): string[] {
  const { all, body } = state.loads;
  const texts = all.map(({ key, force }, number) => {
    const at = `${place(state.content.place(key))} ${units.length}`;
    return `${number + 1}: ${asForce(norm(force))} at ${at}`;
  });
  if (norm(body.force) > 0)
    texts.push(`Body force ${place(body.force)} ${units.force}/${units.length}³`);
  if (state.tool) texts.push(`Sphere: ${asForce(norm(state.reaction()))}`);
  return texts;
}
