"""Networks trained on noisy data: maximum likelihood and variational Bayes (Fig. "MLEvsBayes")."""

from __future__ import annotations

import numpy as np

from experiments.framework.experiment import Experiment, Findings
from experiments.framework.record import Claim, Table, join_named
from experiments.framework.resources import Resources
from experiments.measures.errors_on_test_split import BODIES, MM
from experiments.measures.noisy_data_sweeps import (
    END,
    draw_uncertainties,
    noise_ratio,
    predict_sweep,
    without_noise,
)
from experiments.paper.force_sweeps import GROWTH
from surrogate.measures import ForceSweep

NOISE_FREE = {"beam2d": "beam2d_f1-vb", "lshape2d": "lshape2d-vb"}
RUNS = tuple(f"{body}_noisy-{kind}" for body in NOISE_FREE for kind in ("mle", "vb"))
SWEEPS = {body: f"{body}_sweep" for body in NOISE_FREE}
FAR = (2.0, 4.0)  # forces outside the training range, in N
CAPTURED = 2.0  # factor within which the noise is captured
RELIABLE = 0.5  # share of errors inside the 95 % band below which σ is not reliable


def measure(resources: Resources) -> Findings:
    """Compare the uncertainties of both kinds of networks with noise and errors, on both bodies."""
    mle, vb = (predicted_by(resources, kind) for kind in ("mle", "vb"))
    noise_free = [predict_sweep(resources, run, SWEEPS[body]) for body, run in NOISE_FREE.items()]
    return Findings(
        tables=[noise_table(mle | vb)],
        claims=[
            captured("Maximum likelihood", mle),
            captured("Variational Bayes", vb),
            unreliable(mle),
            growing(vb),
        ],
        figures={
            "std": (
                draw_uncertainties(mle, vb, noise_free),
                "Standard deviations after training on noisy data, of the loaded node's "
                "displacement in the direction of the force; error: that of the mean against the "
                "finite elements without noise. Dark grey, forces with noise in training; light "
                "grey, the training range. Right, in green, for comparison: variational Bayes "
                "trained on the same forces without noise.",
            )
        },
    )


def predicted_by(resources: Resources, kind: str) -> dict[str, ForceSweep]:
    """Sweeps by one kind of networks; keys: names of body and network."""
    return {
        f"{BODIES[body]} ({kind.upper()})": predict_sweep(resources, f"{body}_noisy-{kind}", sweep)
        for body, sweep in SWEEPS.items()
    }


def captured(likelihood: str, sweeps: dict[str, ForceSweep]) -> Claim:
    """Test whether the noise is captured within the training range, on every body."""
    ratios = {name: noise_ratio(sweep) for name, sweep in sweeps.items()}
    return Claim(
        what=f"{likelihood} captures the noise within the training range.",
        holds=all(1 / CAPTURED <= ratio <= CAPTURED for ratio in ratios.values()),
        evidence="Predicted standard deviation over that of the noise, median over the forces "
        f"with noise: {join_named(ratios)} (captured: within a factor of {CAPTURED:g}).",
    )


def share_covered(sweep: ForceSweep) -> float:
    """Share of the forces outside the training range whose error is inside the 95 % band."""
    return float(sweep.covered[sweep.outside].mean())


def unreliable(sweeps: dict[str, ForceSweep]) -> Claim:
    """Test whether networks stay confident outside the training range where they are wrong."""
    shares = {name: share_covered(sweep) for name, sweep in sweeps.items()}
    percent = ", ".join(f"{name} {100 * share:.0f} %" for name, share in shares.items())
    return Claim(
        what="Maximum likelihood stays confident outside the training range, where it is wrong.",
        holds=all(share < RELIABLE for share in shares.values()),
        evidence="Forces outside for which the error is inside the 95 % band: "
        f"{percent} (not reliable: < {100 * RELIABLE:.0f} %).",
        better=True,
    )


def growing(sweeps: dict[str, ForceSweep]) -> Claim:
    """Test whether uncertainty grows steadily outside the training range, above the noise."""
    growths = {name: sweep.growth for name, sweep in sweeps.items()}
    ratios = {
        name: sweep.at(END, sweep.std) / float(sweep.std[~sweep.outside].max())
        for name, sweep in sweeps.items()
    }
    return Claim(
        what="With variational Bayes, uncertainty grows outside the training range.",
        holds=min(growths.values()) >= GROWTH and min(ratios.values()) > 1,
        evidence=f"Rank correlation with the force outside: {join_named(growths)} (≥ {GROWTH}); "
        f"standard deviation at {END:g} N over the largest inside: {join_named(ratios)} (> 1).",
    )


def noise_table(sweeps: dict[str, ForceSweep]) -> Table:
    """Table of standard deviations with noise, without, and outside the range, with errors."""
    rows = []
    for name, sweep in sweeps.items():
        far = [
            MM * sweep.at(force, values)
            for force in FAR
            for values in (sweep.std, np.abs(sweep.error))
        ]
        rows.append((name, noise_ratio(sweep), MM * sweep.std[without_noise(sweep)].mean(), *far))
    return Table(
        caption="Total standard deviation σ and error of the loaded node's displacement in the "
        "direction of the force: where the training's forces have noise, where they have none, and "
        "outside the training range (mean of both senses of the force).",
        head=(
            "network",
            "σ / σ of the noise, median",
            "mean σ where no noise [mm]",
            *(f"{what} at {force:g} N [mm]" for force in FAR for what in ("σ", "error")),
        ),
        rows=tuple(rows),
    )


STUDY = Experiment(
    name="noisy-data",
    title="Networks trained on noisy data",
    labels=("fig: MLEvsBayes",),
    question="In training, the displacements under small forces have noise: is the predicted "
    "uncertainty that of the noise, and does it grow outside the training range? Networks trained "
    "without noise are drawn for comparison.",
    measure=measure,
    datasets=tuple(SWEEPS.values()),
    runs=(*RUNS, *NOISE_FREE.values()),
)
