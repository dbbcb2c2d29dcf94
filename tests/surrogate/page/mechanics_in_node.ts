/** The page's mechanics in node: a body and questions on stdin, answers on stdout. */

import { readFileSync } from "node:fs";
import { certify } from "../../../surrogate/page/web/src/mechanics/certificate";
import { CarriedCompliance } from "../../../surrogate/page/web/src/mechanics/carried_compliance";
import { descend } from "../../../surrogate/page/web/src/mechanics/descent";
import { Equilibrium } from "../../../surrogate/page/web/src/mechanics/equilibrium";
import { atPoints } from "../../../surrogate/page/web/src/mechanics/points_between";
import { readBody } from "../../../surrogate/page/web/src/mechanics/read_body";
import {
  loadSeries,
  seriesTerms,
  weights,
} from "../../../surrogate/page/web/src/mechanics/series";
import { Solid } from "../../../surrogate/page/web/src/mechanics/solid";

const { text, arrays, asks } = JSON.parse(readFileSync(0, "utf-8"));
const body = readBody(text, (name) => {
  const array = arrays[name];
  if (!array) return null;
  return (array.type === "int32" ? Int32Array : Float64Array).from(array.values);
});
const solid = new Solid(body);
const equilibrium = new Equilibrium(solid);
const always = (): Promise<boolean> => Promise.resolve(true);
const field = (values: (number | null)[]): Float64Array =>
  Float64Array.from(values, (value) => value ?? NaN);

const answers = [];
for (const ask of asks) {
  const force = field(ask.force);
  equilibrium.under(ask.pressures);
  if (ask.kind === "state") {
    const u = field(ask.u);
    const x = field(ask.x);
    const states = solid.at(u);
    const [change] = solid.changes(states, [solid.slopes(x)]);
    const tangent = equilibrium.tangent(u);
    answers.push({
      energy: solid.energy(states),
      residual: Array.from(equilibrium.outOfBalance(u, force)),
      product: Array.from(solid.forcesOf(change)),
      solved: Array.from(tangent.solve(equilibrium.held(x))),
      stable: tangent.stable,
    });
  } else if (ask.kind === "series") {
    const terms = seriesTerms(equilibrium, force, ask.order);
    answers.push({
      terms: terms.u.map((term) => Array.from(term)),
      weights: weights(equilibrium, terms, force),
      series: Array.from(loadSeries(equilibrium, force, ask.order)),
    });
  } else if (ask.kind === "descent") {
    const compliance = new CarriedCompliance(equilibrium);
    const found = await descend(equilibrium, compliance, force, field(ask.u), always);
    answers.push({ displacement: Array.from(found!) });
  } else {
    const predicted = atPoints(equilibrium, field(ask.u), force);
    const found = await certify(equilibrium, force, predicted, always);
    answers.push({ ...found, error: found?.error && Array.from(found.error) });
  }
}
console.log(JSON.stringify(answers));
