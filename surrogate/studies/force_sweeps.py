"""What studies of growing forces share: error and uncertainty inside and outside the training."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from surrogate.extrapolation import Extrapolation
from surrogate.force_sweep import ForceSweep, force_sweep
from surrogate.studies.accuracy import MM
from surrogate.studies.record import Claim, Table
from surrogate.studies.study import Outcome
from surrogate.uncertainty_figures import sweep as draw_sweep

MATCH = 0.05  # of the largest displacement: an error up to which a prediction matches
GROWTH = 0.9  # a rank correlation from which uncertainty grows steadily
CONFIDENT = 2.0  # a factor by which uncertainty is larger outside, at least
CAPTURED = 0.95  # share of forces whose error the 95 % band should capture


def sweep_outcome(
    variational: Extrapolation, deterministic: Extrapolation, forces: Sequence[float]
) -> Outcome:
    """Table, claims and figure that the sweeps on both bodies have in common.

    Parameters
    ----------
    variational, deterministic : Extrapolation
        Of the same sweep, by the two networks.
    forces : sequence of float
        Magnitudes for the table in N, the last two well beyond the training.
    """
    vb, d = force_sweep(variational), force_sweep(deterministic)
    return Outcome(
        tables=[sweep_table(vb, d, forces)],
        claims=[
            matches_inside(vb),
            confident_inside(vb, forces[-2:]),
            deviates_outside("The Bayesian network", vb),
            deviates_outside("The deterministic network", d),
        ],
        figures={
            "sweep": (
                draw_sweep(variational, deterministic),
                "Displacement of the loaded node in the direction of the force (left), and its "
                f"error and 95 % band (right); grey, the training range of ±{vb.limit:g} N.",
            )
        },
    )


def sweep_table(vb: ForceSweep, d: ForceSweep, forces: Sequence[float]) -> Table:
    """Error and standard deviation at some forces."""
    rows = tuple(
        (
            force,
            vb.at(force, np.abs(vb.reference)),
            MM * vb.at(force, np.abs(vb.error)),
            MM * vb.at(force, vb.std),
            MM * d.at(force, np.abs(d.error)),
            vb.at(force, vb.covered_components),
        )
        for force in forces
    )
    return Table(
        caption="Loaded node, in the direction of the force, mean of both senses; last column, of "
        "all free components.",
        head=(
            "force [N]",
            "displacement [m]",
            "error (VB) [mm]",
            "σ (VB) [mm]",
            "error (D) [mm]",
            "inside the 95 % band",
        ),
        rows=rows,
    )


def relative_error(sweep: ForceSweep, where: np.ndarray) -> float:
    """Largest error over the largest displacement, of the forces `where`."""
    return float(np.abs(sweep.error[where]).max() / np.abs(sweep.reference[where]).max())


def matches_inside(sweep: ForceSweep) -> Claim:
    """Whether the prediction matches within the training range."""
    error = relative_error(sweep, ~sweep.outside)
    return Claim(
        what="Within the training range the prediction matches the finite elements.",
        holds=error <= MATCH,
        evidence=f"Largest error {error:.2%} of the largest displacement (matches up to "
        f"{MATCH:.0%}).",
    )


def deviates_outside(network: str, sweep: ForceSweep) -> Claim:
    """Whether the prediction deviates outside the training range; better if it does not."""
    error = relative_error(sweep, sweep.outside)
    return Claim(
        what=f"{network} deviates from the finite elements outside the training range.",
        holds=error > MATCH,
        evidence=f"Largest error {error:.2%} of the largest displacement (deviates above "
        f"{MATCH:.0%}).",
        better=True,
    )


def confident_inside(sweep: ForceSweep, forces: Sequence[float]) -> Claim:
    """Whether uncertainty is small within the training range and grows steadily outside."""
    largest = float(sweep.std[~sweep.outside].max())
    ratios = [sweep.at(force, sweep.std) / largest for force in forces]
    said = ", ".join(f"at {f:g} N {r:.3g}" for f, r in zip(forces, ratios, strict=True))
    return Claim(
        what="The network is confident within the training range and gets less so outside.",
        holds=sweep.growth >= GROWTH and min(ratios) >= CONFIDENT,
        evidence=f"Largest standard deviation inside {MM * largest:.2f} mm; over that, outside: "
        f"{said} (at least {CONFIDENT:g}); rank correlation with the force outside "
        f"{sweep.growth:.2f} (at least {GROWTH}).",
    )


def captured_outside(sweep: ForceSweep) -> Claim:
    """Whether the 95 % band captures the error outside the training range."""
    share = float(sweep.covered[sweep.outside].mean())
    everywhere = float(sweep.covered_components[sweep.outside].mean())
    return Claim(
        what="The 95 % band captures the error outside the training range.",
        holds=share >= CAPTURED,
        evidence=f"At the loaded node for {share:.0%} of the forces outside (at least "
        f"{CAPTURED:.0%}); of all free components, {everywhere:.0%}.",
    )
