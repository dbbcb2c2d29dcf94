"""One node under growing forces: error and uncertainty inside and outside the training range.

Corner of the 2D beam under vertical forces (Fig. "fa2half_deform"), inner corner of the 2D L-shape
under horizontal forces (Fig. "L_deform").
"""

from __future__ import annotations

from functools import partial

import numpy as np
from numpy.typing import NDArray

from experiments.framework.experiment import Experiment, Findings
from experiments.framework.record import Claim, Table
from experiments.framework.resources import Resources
from experiments.measures.errors_on_test_split import MM
from surrogate.figures import sweep_curves
from surrogate.learning.measures import ForceSweep, force_sweep

MATCH = 0.05  # error up to which a prediction matches, relative to the largest displacement
GROWTH = 0.9  # rank correlation from which uncertainty grows steadily
CONFIDENT = 2.0  # smallest factor between uncertainty outside and inside
CAPTURED = 0.95  # smallest share of forces with the error inside the 95 % band


def measure(resources: Resources, case: str, with_capture: bool) -> Findings:
    """Compare the Bayesian and the deterministic network of a case with the finite elements.

    Parameters
    ----------
    resources : Resources
    case : str
        Case of the networks; the dataset of the sweep is named after it.
    with_capture : bool
        Add the claim that the 95 % band captures the error outside the training range.
    """
    variational, deterministic = (
        resources.predicted_loads(run, sweep_of(case)) for run in runs_of(case)
    )
    vb, d = force_sweep(variational), force_sweep(deterministic)
    claims = [
        matches_inside(vb),
        confident_inside(vb),
        deviates_outside("The Bayesian network", vb),
        deviates_outside("The deterministic network", d),
    ]
    if with_capture:
        claims.append(captured_outside(vb))
    return Findings(
        tables=[sweep_table(vb, d)],
        claims=claims,
        figures={
            "sweep": (
                sweep_curves(variational, deterministic, "U-Net (VB)"),
                "Displacement of the loaded node in the direction of the force (left), and its "
                "error beside the 95 % band (right; linear near zero, logarithmic beyond); grey, "
                f"the training range of ±{vb.limit:g} N.",
            )
        },
    )


def runs_of(case: str) -> tuple[str, str]:
    """Names of the Bayesian and the deterministic run of a case."""
    return f"{case}-vb", f"{case}-det"


def sweep_of(case: str) -> str:
    """Name of the dataset with the force sweep of a case."""
    return f"{case}_sweep"


def ends(sweep: ForceSweep) -> list[int]:
    """Numbers of the forces at the ends of the training range, at twice them, and at the largest.

    Forces of both senses, ascending.
    """
    sizes = (sweep.limit, 2 * sweep.limit, float(np.abs(sweep.force).max()))
    return sorted({sweep.nearest(sense * size) for size in sizes for sense in (-1, 1)})


def sweep_table(vb: ForceSweep, d: ForceSweep) -> Table:
    """Table of errors and standard deviation at the ends of the training range and beyond."""
    return Table.of(
        f"Forces along {'xyz'[vb.axis]}: displacement u of the loaded node, error of the "
        "prediction U there, and error and standard deviation of the component along the force; "
        "the last column counts the components of all free nodes.",
        ends(vb),
        {
            "force [N]": lambda i: float(vb.force[i]),
            "‖u‖₂ [m]": lambda i: float(vb.moved[i]),
            "‖U − u‖₂ (D) [mm]": lambda i: MM * float(d.node_error[i]),
            "‖U − u‖₂ (VB) [mm]": lambda i: MM * float(vb.node_error[i]),
            "error along the force (VB) [mm]": lambda i: MM * abs(float(vb.error[i])),
            "σ along the force (VB) [mm]": lambda i: MM * float(vb.std[i]),
            "inside the 95 % band (VB) [%]": lambda i: 100 * float(vb.covered_components[i]),
        },
    )


def relative_error(sweep: ForceSweep, where: NDArray[np.bool_]) -> float:
    """Largest ‖U − u‖₂ over the largest ‖u‖₂ at the loaded node, for the forces `where`."""
    return float(sweep.node_error[where].max() / sweep.moved[where].max())


def matches_inside(sweep: ForceSweep) -> Claim:
    """Test whether the prediction matches within the training range."""
    error = relative_error(sweep, ~sweep.outside)
    return Claim(
        what="Within the training range the prediction matches the finite elements.",
        holds=error <= MATCH,
        evidence=f"Largest ‖U − u‖₂ at the loaded node {100 * error:.3g} % of the largest ‖u‖₂ "
        f"there (matches up to {100 * MATCH:g} %).",
    )


def deviates_outside(network: str, sweep: ForceSweep) -> Claim:
    """Test whether the prediction deviates outside the training range; better if it does not."""
    error = relative_error(sweep, sweep.outside)
    return Claim(
        what=f"{network} deviates from the finite elements outside the training range.",
        holds=error > MATCH,
        evidence=f"Largest ‖U − u‖₂ at the loaded node {100 * error:.3g} % of the largest ‖u‖₂ "
        f"there (deviates above {100 * MATCH:g} %).",
        better=True,
    )


def confident_inside(sweep: ForceSweep) -> Claim:
    """Test whether uncertainty is small within the training range and grows steadily outside."""
    largest = float(sweep.std[~sweep.outside].max())
    ratios = {sweep.force[i]: sweep.std[i] / largest for i in ends(sweep) if sweep.outside[i]}
    growth = ", ".join(f"at {force:g} N {ratio:.1f}" for force, ratio in ratios.items())
    return Claim(
        what="The network is confident within the training range and gets less so outside.",
        holds=sweep.growth >= GROWTH and min(ratios.values()) >= CONFIDENT,
        evidence=f"Largest standard deviation along the force inside {MM * largest:.2f} mm; over "
        f"that, outside: {growth} (at least {CONFIDENT:g}); rank correlation with the force "
        f"outside {sweep.growth:.2f} (at least {GROWTH}). The error along the force is inside the "
        f"95 % band at {by_sense(sweep, sweep.covered)}.",
    )


def by_sense(sweep: ForceSweep, covered: NDArray[np.bool_]) -> str:
    """Write the shares of `covered` (N,) among the forces outside, for each sense."""
    negative, positive = (100 * covered[sense].mean() for sense in sweep.senses)
    return f"{negative:.3g} % of the negative forces outside, {positive:.3g} % of the positive"


def captured_outside(sweep: ForceSweep) -> Claim:
    """Test whether the 95 % band captures the error outside the training range, in both senses."""
    everywhere = float(sweep.covered_components[sweep.outside].mean())
    return Claim(
        what="The 95 % band captures the error outside the training range.",
        holds=min(float(sweep.covered[sense].mean()) for sense in sweep.senses) >= CAPTURED,
        evidence=f"At the loaded node along the force, which is what the paper shows, at "
        f"{by_sense(sweep, sweep.covered)} (at least {100 * CAPTURED:g} % of both); across it, at "
        f"{by_sense(sweep, sweep.covered_across)}; of all free components, "
        f"{100 * everywhere:.3g} %.",
    )


def make_study(
    name: str, title: str, label: str, question: str, case: str, with_capture: bool
) -> Experiment[Resources]:
    """Make the study of the sweep on the body of a case; for `with_capture` see `measure`."""
    return Experiment(
        name=name,
        title=title,
        labels=(label,),
        question=question,
        measure=partial(measure, case=case, with_capture=with_capture),
        datasets=(sweep_of(case),),
        runs=runs_of(case),
    )


BEAM = make_study(
    "force-sweep-beam",
    "2D beam under growing forces",
    "fig: fa2half_deform",
    "Vertical forces up to 3.2 times those of the training act at the corner: how far are the "
    "predictions off, and does the uncertainty say so?",
    case="beam2d",
    with_capture=True,
)
LSHAPE = make_study(
    "force-sweep-lshape",
    "2D L-shape under growing forces",
    "fig: L_deform",
    "Horizontal forces up to six times those of the training act at the inner corner: how far are "
    "the predictions off, and does the uncertainty say so?",
    case="lshape2d",
    with_capture=False,
)
