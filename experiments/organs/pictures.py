"""Pictures of the organs: the deformed body, the error of a prediction and its uncertainty."""

from __future__ import annotations

import numpy as np

from experiments.framework.experiment import Experiment, Findings
from experiments.framework.resources import Resources
from experiments.organs.predictors import BODIES, KINDS
from surrogate.figures import error_beside_uncertainty

SHOWN = "reduced-vb"


def measure(resources: Resources) -> Findings:
    """Draw a test sample of each body that moves further than three quarters of them do."""
    result = Findings()
    for case, body in BODIES.items():
        run = f"{case}-{SHOWN}"
        if run not in resources.scale.runs:
            continue
        dataset, predicted = resources.dataset_of(run), resources.predicted_test(run)
        test = dataset.nodal_test
        moved = np.linalg.norm(test.displacement, axis=2).max(axis=1)
        shown = int(np.abs(moved - np.quantile(moved, 0.75)).argmin())
        figure = error_beside_uncertainty(
            dataset.geometry,
            test.force[shown],
            predicted.mean[shown],
            predicted.std[shown],
            test.displacement[shown],
        )
        result.figures[f"{case}"] = (
            figure,
            f"The {body}, {KINDS[SHOWN]}, test sample {shown}, which moves by "
            f"{moved[shown]:.3f} m: error and predicted standard deviation of the nodes on the "
            "deformed body; red, the finite elements'.",
        )
    return result


STUDY = Experiment(
    name="organ-pictures",
    title="Pictures",
    question="What do the bodies, the errors and the intervals look like?",
    measure=measure,
    runs=tuple(f"{case}-{SHOWN}" for case in BODIES),
)
