/** The page's mechanics in node: a body and questions on stdin, answers on stdout. */

import { readFileSync } from "node:fs";
import { put } from "../../../surrogate/page/web/src/content";
import { ActuatedModes } from "../../../surrogate/page/web/src/mechanics/actuated_modes";
import { certify } from "../../../surrogate/page/web/src/mechanics/certificate";
import { Equilibrium } from "../../../surrogate/page/web/src/mechanics/equilibrium";
import { Motion } from "../../../surrogate/page/web/src/mechanics/motion";
import { atPoints } from "../../../surrogate/page/web/src/mechanics/points_between";
import { loadSeries, seriesTerms, weights } from "../../../surrogate/page/web/src/mechanics/load_series";
import { approach } from "../../../surrogate/page/web/src/mechanics/reach";
import { Solid } from "../../../surrogate/page/web/src/mechanics/solid";

const { text, arrays, asks } = JSON.parse(readFileSync(0, "utf-8"));
for (const [path, { type, values }] of Object.entries(arrays)) {
  put(text, path, (type === "int32" ? Int32Array : Float64Array).from(values));
}
const { actuation, ...body } = text;
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
    const tangent = equilibrium.tangent(u);
    const residual = equilibrium.outOfBalance(u, force);
    const energy = solid.energy();
    solid.set(1, solid.slopes(x));
    answers.push({
      energy,
      residual: Array.from(residual),
      product: Array.from(solid.forces(1)),
      solved: Array.from(tangent.solve(equilibrium.held(x))),
      stable: tangent.stable,
    });
  } else if (ask.kind === "series") {
    const terms = seriesTerms(equilibrium, force, ask.order);
    answers.push({
      terms: terms.map((term) => Array.from(term)),
      weights: weights(equilibrium, terms, force),
      series: Array.from(loadSeries(equilibrium, force, ask.order)),
    });
  } else if (ask.kind === "motion") {
    const motion = new Motion(equilibrium, field(ask.u));
    const moments = ask.factors.map((factor: number) => {
      motion.goOn();
      const pressures = ask.pressures.map((pressure: number) => factor * pressure);
      const loading = { force: force.map((newtons) => factor * newtons), pressures };
      const moment = motion.step(loading, ask.damping, ask.stiffness);
      return [Array.from(moment!.displacement), Array.from(moment!.error)];
    });
    answers.push(moments);
  } else if (ask.kind === "actuated") {
    const modes = new ActuatedModes(actuation, equilibrium.following, equilibrium.size);
    const work = modes.worksOf(force);
    const reached = modes.move(ask.given, work);
    if (ask.way) while (!approach(modes, ask.node, field(ask.way), work));
    answers.push({
      reached,
      displacement: Array.from(modes.displacement()),
      amplitudes: Array.from(modes.at.amplitudes),
      quantities: modes.quantities(),
      given: Array.from(modes.at.given),
      changes: modes.changes().map((q) => Array.from(modes.displacement(q))),
    });
  } else {
    const predicted = atPoints(equilibrium, field(ask.u), force);
    const found = await certify(equilibrium, force, predicted, always);
    const { corrected } = found!;
    answers.push({
      ...found,
      error: found?.error && Array.from(found.error),
      corrected: corrected && Array.from(corrected.displacement),
    });
  }
}
console.log(JSON.stringify(answers));
