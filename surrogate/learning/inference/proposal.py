"""Load cases that a network predicts worst: those to solve next.

Many random load cases of a family are predicted, and their errors are estimated without a
factorisation (`surrogate.mechanics.certify.fast_estimate`). The proposed ones differ in what is
wrong: each is that whose estimated error field is farthest, in the Euclidean norm, from those of
all proposed before and from zero. So the first is the worst of all, and a load that is predicted as
wrongly as another, and in the same way, is not proposed beside it.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from shared_schema.common.arguments import checked_arguments
from shared_schema.common.errors import InputError
from shared_schema.common.machine import require_memory
from shared_schema.common.solution_file import require_suffix
from shared_schema.load_cases import LoadCases, write_load_cases
from shared_schema.manifest import digest_of
from surrogate.learning.inference.fresh_loads import drawn_loads
from surrogate.learning.inference.surrogate import Surrogate
from surrogate.learning.probabilistic.stochastic_passes import PASSES, require_passes

Array = NDArray[np.float64]
AT_ONCE = 256  # load cases
DRAWN = 20  # random load cases for each proposed one


@dataclass(frozen=True)
class Proposal:
    """Proposed load cases.

    Attributes
    ----------
    surrogate : Surrogate
        Network that predicts them worst.
    forces : array, (n, n_nodes, d)
        In N, in the order in which they were chosen.
    errors : array, (n,)
        Their estimated mean errors in m; infinite if a cell is inverted.
    among : int
        Number of load cases that they were chosen from.
    median : float
        Median estimated mean error of all of these, in m.
    """

    surrogate: Surrogate
    forces: Array
    errors: Array
    among: int
    median: float

    @checked_arguments
    def save(self, path: str | Path) -> None:
        """Write the load cases to a file that ends in .h5, for `datagen run`."""
        require_suffix(Path(path), (".h5",))
        geometry, case = self.surrogate.geometry, self.surrogate.description.data.case
        cases = LoadCases.of(geometry.coordinates, self.forces)
        write_load_cases(Path(path), cases, digest_of(case), geometry.cell_type)

    def summary(self) -> str:
        """Describe the proposal in a line."""
        units = self.surrogate.description.data.units
        return (
            f"{len(self.errors)} load cases of {self.among}, estimated mean error "
            f"{units.written(float(np.median(self.errors)))} in the median, of all "
            f"{units.written(self.median)}"
        )


@checked_arguments
def propose(
    surrogate: Surrogate,
    count: int,
    *,
    family: str = "trained",
    among: int | None = None,
    seed: int = 0,
    passes: int = PASSES,
) -> Proposal:
    """Propose load cases that are worth a solve.

    Parameters
    ----------
    surrogate : Surrogate
    count : int
        Number of load cases.
    family : str
        Random loads that they are drawn from: "trained", those of the training; or such as
        "loads=1-8,reach=2,places=free" (`surrogate.learning.data.load_families`).
    among : int, optional
        Number of load cases that are drawn, `count` at least; 20 times as many by default.
    seed : int
        Seed of the random loads.
    passes : int
        Number of passes of a stochastic network.

    Raises
    ------
    InputError
        If the family or a number is wrong, the run does not name its material, or the case has a
        pressure, which is not drawn.
    """
    geometry = surrogate.geometry
    surrogate.body.balanced()
    if count < 1:
        raise InputError(f"count {count}: expected 1 at least", "count")
    among = DRAWN * count if among is None else among
    if among < count:
        raise InputError(f"among {among}: expected {count} at least, the number proposed", "among")
    require_passes(passes, seed)
    require_memory(among * geometry.coordinates.nbytes, f"among {among}: the forces", "among")
    forces = drawn_loads(surrogate, among, np.random.default_rng(seed), family)
    fields = np.empty(forces.shape, dtype=np.float32)
    errors = np.empty(among)
    for start in range(0, among, AT_ONCE):
        some = slice(start, start + AT_ONCE)
        predicted = surrogate.averaged_passes(forces[some], passes).mean
        error = surrogate.fast_estimate(forces[some], predicted)
        errors[some] = np.abs(error).mean(axis=(1, 2))
        fields[some] = np.where(np.isfinite(error), error, predicted)  # all of it may be wrong
    chosen = farthest(fields.reshape(among, -1), count)
    median = float(np.median(errors))
    return Proposal(surrogate, forces[chosen], errors[chosen], among, median)


def farthest(points: NDArray[np.float32], count: int) -> NDArray[np.int64]:
    """Choose points far from each other and from zero, greedily: (n, m) → (count,)."""
    distance = np.linalg.norm(points, axis=1)
    chosen = np.empty(count, dtype=np.int64)
    for number in range(count):
        chosen[number] = distance.argmax()
        new = np.linalg.norm(points - points[chosen[number]], axis=1)
        distance = np.minimum(distance, new)
        distance[chosen[number]] = -1.0
    return chosen
