/** Displacements under unit loads, which are computed once. */

import type { Loads, Part } from "./loads";
import { add } from "./mechanics/vectors";

export class Responses {
  private readonly known = new Map<number, Float64Array[] | null>();

  /**
   * @param compute - displacements in m of all nodes under some loads
   * @param arrived - called when more of them are known
   */
  constructor(
    private readonly loads: Loads,
    private readonly compute: (units: Part[]) => Promise<Float64Array[]>,
    private readonly arrived: () => void,
  ) {}

  /** Those of the unit components of a load in m; null until they are there. */
  of(key: number): Float64Array[] | null {
    const found = this.known.get(key);
    if (found !== undefined) return found;
    this.known.set(key, null);
    void this.compute(this.loads.units(key)).then((columns) => {
      this.known.set(key, columns);
      this.arrived();
    });
    return null;
  }

  /** That of some loads in m, of a size; null until all of their columns are there. */
  sum(parts: readonly Part[], size: number): Float64Array | null {
    const columns = parts.map(({ key }) => this.of(key));
    const sum = new Float64Array(size);
    for (const [i, { force }] of parts.entries()) {
      const found = columns[i];
      if (!found) return null;
      force.forEach((newtons, component) => {
        if (newtons !== 0) add(sum, found[component], newtons);
      });
    }
    return sum;
  }
}
