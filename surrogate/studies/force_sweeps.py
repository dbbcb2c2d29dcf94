"""What studies of growing forces share: error and uncertainty inside and outside the training."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from surrogate.evaluation.extrapolation import Extrapolation
from surrogate.evaluation.force_sweep import ForceSweep, force_sweep
from surrogate.presentation.sweep_curves import sweep_curves
from surrogate.studies.accuracy import MM
from surrogate.studies.record import Claim, Table
from surrogate.studies.study import Outcome

MATCH = 0.05  # of the largest displacement: an error up to which a prediction matches
GROWTH = 0.9  # a rank correlation from which uncertainty grows steadily
CONFIDENT = 2.0  # a factor by which uncertainty is larger outside, at least
CAPTURED = 0.95  # share of forces whose error the 95 % band should capture


def sweep_outcome(variational: Extrapolation, deterministic: Extrapolation) -> Outcome:
    """Table, claims and figure that the sweeps on both bodies have in common.

    Parameters
    ----------
    variational, deterministic : Extrapolation
        Of the same sweep, by the two networks.
    """
    vb, d = force_sweep(variational), force_sweep(deterministic)
    return Outcome(
        tables=[sweep_table(vb, d)],
        claims=[
            matches_inside(vb),
            confident_inside(vb),
            deviates_outside("The Bayesian network", vb),
            deviates_outside("The deterministic network", d),
        ],
        figures={
            "sweep": (
                sweep_curves(variational, deterministic, "U-Net (VB)"),
                "Displacement of the loaded node in the direction of the force (left), and its "
                "error beside the 95 % band (right; linear near zero, logarithmic beyond); grey, "
                f"the training range of ±{vb.limit:g} N.",
            )
        },
    )


def ends(sweep: ForceSweep) -> list[int]:
    """Numbers of the forces at the ends of the training range, of twice them, and of the largest.

    In both senses, ascending.
    """
    sizes = (sweep.limit, 2 * sweep.limit, float(np.abs(sweep.force).max()))
    return sorted({sweep.nearest(sense * size) for size in sizes for sense in (-1, 1)})


def sweep_table(vb: ForceSweep, d: ForceSweep) -> Table:
    """Errors and standard deviation at the ends of the training range and beyond."""
    rows = tuple(
        (
            float(vb.force[i]),
            float(vb.moved[i]),
            MM * float(d.node_error[i]),
            MM * float(vb.node_error[i]),
            MM * abs(float(vb.error[i])),
            MM * float(vb.std[i]),
            100 * float(vb.covered_components[i]),
        )
        for i in ends(vb)
    )
    return Table(
        caption=f"Forces along {'xyz'[vb.axis]}: displacement u of the loaded node, error of the "
        "prediction U there, and error and standard deviation of the component along the force; "
        "the last column counts the components of all free nodes.",
        head=(
            "force [N]",
            "‖u‖₂ [m]",
            "‖U − u‖₂ (D) [mm]",
            "‖U − u‖₂ (VB) [mm]",
            "error along the force (VB) [mm]",
            "σ along the force (VB) [mm]",
            "inside the 95 % band (VB) [%]",
        ),
        rows=rows,
    )


def relative_error(sweep: ForceSweep, where: NDArray[np.bool_]) -> float:
    """Largest ‖U − u‖₂ over the largest ‖u‖₂ at the loaded node, of the forces `where`."""
    return float(sweep.node_error[where].max() / sweep.moved[where].max())


def matches_inside(sweep: ForceSweep) -> Claim:
    """Whether the prediction matches within the training range."""
    error = relative_error(sweep, ~sweep.outside)
    return Claim(
        what="Within the training range the prediction matches the finite elements.",
        holds=error <= MATCH,
        evidence=f"Largest ‖U − u‖₂ at the loaded node {100 * error:.3g} % of the largest ‖u‖₂ "
        f"there (matches up to {100 * MATCH:g} %).",
    )


def deviates_outside(network: str, sweep: ForceSweep) -> Claim:
    """Whether the prediction deviates outside the training range; better if it does not."""
    error = relative_error(sweep, sweep.outside)
    return Claim(
        what=f"{network} deviates from the finite elements outside the training range.",
        holds=error > MATCH,
        evidence=f"Largest ‖U − u‖₂ at the loaded node {100 * error:.3g} % of the largest ‖u‖₂ "
        f"there (deviates above {100 * MATCH:g} %).",
        better=True,
    )


def confident_inside(sweep: ForceSweep) -> Claim:
    """Whether uncertainty is small within the training range and grows steadily outside."""
    largest = float(sweep.std[~sweep.outside].max())
    ratios = {sweep.force[i]: sweep.std[i] / largest for i in ends(sweep) if sweep.outside[i]}
    said = ", ".join(f"at {force:g} N {ratio:.1f}" for force, ratio in ratios.items())
    return Claim(
        what="The network is confident within the training range and gets less so outside.",
        holds=sweep.growth >= GROWTH and min(ratios.values()) >= CONFIDENT,
        evidence=f"Largest standard deviation along the force inside {MM * largest:.2f} mm; over "
        f"that, outside: {said} (at least {CONFIDENT:g}); rank correlation with the force outside "
        f"{sweep.growth:.2f} (at least {GROWTH}). The error along the force is inside the 95 % "
        f"band at {by_sense(sweep, sweep.covered)}.",
    )


def by_sense(sweep: ForceSweep, covered: NDArray[np.bool_]) -> str:
    """Share of `covered` (N,) among the forces outside the training range, of each sense."""
    negative, positive = (100 * covered[sense].mean() for sense in sweep.senses)
    return f"{negative:.3g} % of the negative forces outside, {positive:.3g} % of the positive"


def captured_outside(sweep: ForceSweep) -> Claim:
    """Whether the 95 % band captures the error outside the training range, in both senses."""
    everywhere = float(sweep.covered_components[sweep.outside].mean())
    return Claim(
        what="The 95 % band captures the error outside the training range.",
        holds=min(float(sweep.covered[sense].mean()) for sense in sweep.senses) >= CAPTURED,
        evidence=f"At the loaded node along the force, which is what the paper shows, at "
        f"{by_sense(sweep, sweep.covered)} (at least {100 * CAPTURED:g} % of both); across it, at "
        f"{by_sense(sweep, sweep.covered_across)}; of all free components, "
        f"{100 * everywhere:.3g} %.",
    )
