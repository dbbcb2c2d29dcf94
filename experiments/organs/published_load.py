"""The breast under the load of the published solution by AceFEM."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from experiments.framework.experiment import Experiment, Findings, Setting
from experiments.framework.record import Cell, Table
from experiments.framework.resources import Resources
from experiments.measures.predicted_samples import PredictedSamples
from experiments.organs.predictors import BODIES, HUNDREDTHS_OF_MM, KINDS, predictors

ACEFEM = Path(__file__).with_name("breast_acefem.txt")  # u in m, saurabhdeshpande93/MAgNET, MIT
BODY_FORCE = (-5941.76154725, -5233.60075768, -2561.67423583)  # N/m³, fitted to that solution
PUBLISHED_ERROR = 2.8e-4  # m, of a component, of the authors' graph U-Net (Deshpande et al. 2024)
RUNS = tuple(f"breast3d-{kind}" for kind in KINDS)


def measure(resources: Resources) -> Findings:
    """Predict this load by every network of the breast."""
    solution = np.loadtxt(ACEFEM)
    rows: list[tuple[Cell, ...]] = []
    for predictor in predictors(resources):
        if predictor.body != BODIES["breast3d"]:
            continue
        model = predictor.surrogate
        force = model.solve(body_force=BODY_FORCE).force
        predicted = predictor.predict(force[None], resources.scale.passes, Setting.seed)
        error = np.abs(predicted.mean[0] - solution)
        inside: Cell = None
        if model.is_probabilistic:
            fields = force[None], solution[None], predicted
            inside = 100 * float(PredictedSamples(model.geometry, *fields).covered.mean())
        mean, largest = (HUNDREDTHS_OF_MM * float(value) for value in (error.mean(), error.max()))
        rows.append((predictor.label, mean, largest, inside))
    largest = HUNDREDTHS_OF_MM * float(np.linalg.norm(solution, axis=1).max())
    rows.append(
        ("graph U-Net of the authors, published", HUNDREDTHS_OF_MM * PUBLISHED_ERROR, None, None)
    )
    table = Table(
        caption="Errors of a component against AceFEM's displacement, whose largest is "
        f"{largest:.4g}·10⁻⁵ m; free components inside their 95 % intervals.",
        head=("predicted by", "mean [10⁻⁵ m]", "largest [10⁻⁵ m]", "inside [%]"),
        rows=tuple(rows),
    )
    return Findings([table])


STUDY = Experiment(
    name="organ-published",
    title="The published load of the breast",
    question="How far is every prediction from the solution that the paper's authors published?",
    measure=measure,
    runs=RUNS,
)
