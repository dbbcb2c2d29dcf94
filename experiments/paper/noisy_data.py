"""Networks trained on noisy data: maximum likelihood and variational Bayes (Fig. "MLEvsBayes")."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

from experiments.framework.experiment import Experiment, Findings
from experiments.framework.record import Claim, Table, join_named
from experiments.framework.resources import SEED, Resources
from experiments.measures.errors_on_test_split import BODIES, MM
from experiments.paper.force_sweeps import GROWTH
from experiments.paper.published_numbers import PAPER
from shared_schema.common.drawing import NETWORK, REFERENCE, make_figure, styled
from surrogate.figures import OTHER
from surrogate.learning.data import NodalSamples
from surrogate.learning.measures import Extrapolation, ForceSweep, force_sweep

Array = NDArray[np.float64]
NOISY = PAPER.noise.largest_force_newton  # samples under larger forces have no noise in training
END, STEP = PAPER.noise.sweep_end_newton, 0.05  # end and step of the forces in N
FLOOR = 0.1  # mm, lower end of the axis
NOISE_FREE = {"beam2d": "beam2d_f1-vb", "lshape2d": "lshape2d-vb"}
RUNS = tuple(f"{body}_noisy-{kind}" for body in NOISE_FREE for kind in ("mle", "vb"))
SWEEPS = {body: f"{body}_sweep" for body in NOISE_FREE}
FAR = (2.0, 4.0)  # forces outside the training range, in N
CAPTURED = 2.0  # factor within which the noise is captured
RELIABLE = 0.5  # share of errors inside the 95 % band below which σ is not reliable


def measure(resources: Resources) -> Findings:
    """Compare the uncertainties of both kinds of networks with noise and errors, on both bodies."""
    mle = predicted_by(resources, "mle")
    vb = predicted_by(resources, "vb")
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


def predict_sweep(resources: Resources, run: str, sweep: str) -> ForceSweep:
    """Predict a sweep up to ±4 N in small steps of the force."""
    surrogate = resources.surrogate(run)
    samples = refined(resources.nodal(sweep).samples)
    predicted = surrogate.averaged_passes(samples.force, resources.scale.passes, SEED)
    return force_sweep(Extrapolation(sweep, surrogate, samples, predicted))


def refined(samples: NodalSamples) -> NodalSamples:
    """Refine a sweep of one force component; displacements by cubic splines."""
    component = samples.force.sum(axis=(1, 2))
    order, steps = np.argsort(component), round(END / STEP)
    forces = np.arange(-steps, steps + 1) * STEP
    force = CubicSpline(component[order], samples.force[order])(forces)
    displacement = CubicSpline(component[order], samples.displacement[order])(forces)
    return NodalSamples(force, displacement)


def with_noise(sweep: ForceSweep) -> NDArray[np.bool_]:
    """Mask of the forces with noise in training, without 0 N, (N,)."""
    magnitude = np.abs(sweep.force)
    return (magnitude > STEP / 2) & (magnitude < NOISY + STEP / 2)


def without_noise(sweep: ForceSweep) -> NDArray[np.bool_]:
    """Mask of the forces in the training range without noise, (N,)."""
    return ~sweep.outside & (np.abs(sweep.force) > NOISY + STEP / 2)


def true_std(sweep: ForceSweep) -> Array:
    r"""σ of the noise in m, (N,): :math:`a |u| / \sqrt 3` with :math:`\gamma \sim U(-a, a)`."""
    return np.where(
        with_noise(sweep), PAPER.noise.amplitude / np.sqrt(3) * np.abs(sweep.reference), 0.0
    )


def noise_ratio(sweep: ForceSweep) -> float:
    """Median ratio of predicted and true standard deviation at the forces with noise."""
    zone = with_noise(sweep)
    return float(np.median(sweep.std[zone] / true_std(sweep)[zone]))


@styled
def draw_uncertainties(
    left: dict[str, ForceSweep], right: dict[str, ForceSweep], noise_free: Sequence[ForceSweep]
) -> Figure:
    """Draw standard deviations and errors over the force, one row for each body.

    Parameters
    ----------
    left, right : dict of str to ForceSweep
        Sweeps by networks trained on noisy data, by their names.
    noise_free : sequence of ForceSweep
        Sweeps by networks trained without noise, drawn on the right as well.
    """
    figure = make_figure(8.0, 5.6)
    panels = figure.subplots(len(noise_free), 2, sharey="row")
    for column, sweeps in zip(panels.T, (left, right), strict=True):
        for axes, (name, sweep) in zip(column, sweeps.items(), strict=True):
            draw_panel(axes, sweep)
            axes.set_title(name, fontsize=10)
    for axes, sweep in zip(panels[:, 1], noise_free, strict=True):
        axes.plot(
            sweep.force, MM * sweep.std, color=OTHER, lw=0.9, label="total σ, trained without noise"
        )
    for axes in panels[:, 0]:
        axes.set_ylabel("standard deviation, error [mm]")
    handles, labels = panels[0, 1].get_legend_handles_labels()
    figure.legend(handles, labels, loc="upper center", bbox_to_anchor=(0.5, 0.0), ncols=3)
    return figure


def draw_panel(axes: Axes, sweep: ForceSweep) -> None:
    """Draw predicted standard deviations, that of the noise, and the error of one network."""
    axes.axvspan(-sweep.limit, sweep.limit, color="0.93", lw=0)
    axes.axvspan(-NOISY, NOISY, color="0.85", lw=0)
    x, noise = sweep.force, np.where(with_noise(sweep), true_std(sweep), np.nan)
    axes.plot(x, MM * noise, color=REFERENCE, lw=2.0, label="σ of the noise")
    axes.plot(x, MM * sweep.std, color=NETWORK, label="total σ")
    axes.plot(x, MM * sweep.std_epistemic, color=NETWORK, ls="dashed", lw=0.9, label="epistemic σ")
    axes.plot(x, MM * sweep.std_aleatoric, color=NETWORK, ls="dotted", label="aleatoric σ")
    axes.plot(x, MM * np.abs(sweep.error), color="black", lw=0.7, label="error")
    axes.set_xlabel(f"force component {'xyz'[sweep.axis]} at the node [N]")
    axes.set_yscale("log")
    axes.set_xlim(x[0], x[-1])
    axes.set_ylim(bottom=FLOOR)


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
