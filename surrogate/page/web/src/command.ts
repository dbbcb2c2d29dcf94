/** The command that predicts the same. */

import { norm } from "./mechanics/vectors";
import type { State } from "./state";

const TOLERANCE = 1e-4; // of the largest displacement, of a series

export function predictCommand({ content, loads, tool, stiffness, modulus }: State): string {
  const { run, patch, passes, pressed, series, certified, youngModulus, actuation } = content;
  if (actuation && tool) return "Take the sphere away first: surrogate actuate has no tools.";
  const words = ["surrogate", actuation ? "actuate" : "predict", quoted(run)];
  actuation?.sliders.forEach(({ name, kind }, i) =>
    words.push(`--given=${quoted(`${name}.${kind}=${loads.given[i]}`)}`),
  );
  for (const { key, force } of loads.all) {
    const place = [...content.place(key), ...(patch > 0 ? [patch] : [])];
    words.push(`--load="${place.join(",")}:${force.join(",")}"`);
  }
  loads.pressures.forEach((pressure, i) => {
    if (pressure !== 0) words.push(`--load=${quoted(`${pressed[i]}:${pressure}`)}`);
  });
  const option = actuation ? '--load="body:' : '--body-force="';
  if (norm(loads.body.force) > 0) words.push(`${option}${loads.body.force.join(",")}"`);
  if (tool) words.push(`--tool="sphere:${tool.centre.join(",")}:${tool.radius}"`);
  if (youngModulus && stiffness !== 1) words.push(`--young-modulus ${modulus}`);
  if (passes !== null) words.push(`--passes ${passes}`);
  if (actuation) words.push("--confirm");
  else if (series > 0 && certified) words.push(`--tolerance ${TOLERANCE}`);
  return [...words, "--out prediction.npz"].join(" ");
}

/** A word as a shell reads it. */
function quoted(word: string): string {
  return /^[\w./@%+=:,-]+$/.test(word) ? word : `'${word.replaceAll("'", "'\\''")}'`;
}
