/** The page's mechanics in node: a body, certificates and series asked for on stdin, answers on stdout. */

import { readFileSync } from "node:fs";
import { certify } from "../../../surrogate/page/web/src/mechanics/certificate";
import { Equilibrium } from "../../../surrogate/page/web/src/mechanics/equilibrium";
import { loadSeries } from "../../../surrogate/page/web/src/mechanics/series";
import { Solid } from "../../../surrogate/page/web/src/mechanics/solid";

const { body, states, loads } = JSON.parse(readFileSync(0, "utf-8"));
const x = Float64Array.from(body.coordinates);
const solid = new Solid(x, Int32Array.from(body.cells), body.cellType, body.material);
const equilibrium = new Equilibrium(solid, Int32Array.from(body.order), x.length);
const always = (): Promise<boolean> => Promise.resolve(true);
const certificates = [];
for (const { force, predicted } of states) {
  const found = await certify(
    equilibrium,
    Float64Array.from(force),
    Float64Array.from(predicted, (value) => value ?? NaN),
    always,
  );
  certificates.push({ ...found, error: found?.error && Array.from(found.error) });
}
const series = loads.map(({ force, order }) =>
  Array.from(loadSeries(equilibrium, Float64Array.from(force), order)),
);
console.log(JSON.stringify({ certificates, series }));
