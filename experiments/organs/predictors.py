"""What predicts the organs: names of runs, and the same load series with directions."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import NDArray

from experiments.framework.resources import Resources
from experiments.measures.latency import prediction
from surrogate import Surrogate, load
from surrogate.contrib import fit_balance
from surrogate.learning.inference import balance
from surrogate.learning.probabilistic import Distribution

HUNDREDTHS_OF_MM = 1e5  # 1e-5 m in a metre
TOLERANCE = 5e-3  # of the displacement, that directions go on to
BODIES = {"breast3d": "breast", "liver3d": "liver", "liver3d_touch": "liver, touched"}
KINDS = {
    "series": "load series",
    "unet": "U-Net, embedded grid",
    "reduced": "reduced network",
    "reduced-vb": "reduced network, VB",
    "modal-gp": "GP on modal loads",
}
RUNS = tuple(f"{case}-{kind}" for case in BODIES for kind in KINDS)
TOUCHED = {"liver3d_touch": (300, 400)}  # bodies whose surface is made ready, and whose network
# is balanced as well: points of the energy, and random loads for which they are chosen
LEAST_ENERGY = "least energy in its modes"
WITH_DIRECTIONS = f"load series, directions to {TOLERANCE:g}"

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Predictor:
    """A run, or a run whose predictions directions take to a tolerance.

    Attributes
    ----------
    run : str
    body, label : str
    surrogate : Surrogate
    tolerance : float or None
    """

    run: str
    body: str
    label: str
    surrogate: Surrogate
    tolerance: float | None = None

    def predict(self, forces: Array, passes: int, seed: int) -> Distribution:
        """Predict some loads, (M, n_nodes, d) in N."""
        if self.tolerance is None:
            return self.surrogate.averaged_passes(forces, passes, seed)
        mean = self.surrogate.predict(forces, tolerance=self.tolerance)
        return Distribution(mean, np.zeros_like(mean), np.zeros_like(mean))

    def predict_one(self, force: Array, passes: int) -> Callable[[], object]:
        """Make a function that predicts one load, (n_nodes, d) in N, for measuring its time."""
        if self.tolerance is None:
            return prediction(self.surrogate, force, passes)
        return partial(self.surrogate.predict, force, tolerance=self.tolerance)


def predictors(resources: Resources) -> Iterator[Predictor]:
    """Predictors of a scale, body by body."""
    for run in resources.scale.matching(RUNS):
        case, _, kind = run.partition("-")
        surrogate = resources.surrogate(run)
        if case in TOUCHED and kind.startswith("reduced"):
            surrogate.prepare()
        yield Predictor(run, BODIES[case], KINDS[kind], surrogate)
        if kind == "series":
            yield Predictor(run, BODIES[case], WITH_DIRECTIONS, surrogate, TOLERANCE)
        if kind == "reduced" and case in TOUCHED:
            balanced = load(resources.trained(run).folder, resources.device.type)
            points, loads = TOUCHED[case]
            balance(balanced, fit_balance(balanced, points, loads=loads))
            yield Predictor(run, BODIES[case], f"{KINDS[kind]}, {LEAST_ENERGY}", balanced)
