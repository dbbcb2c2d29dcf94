"""Noise of the noisy datasets beside the standard deviations that networks predict."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

from experiments.framework.resources import SEED, Resources
from experiments.measures.errors_on_test_split import MM
from experiments.paper.published_numbers import PAPER
from shared_schema.common.drawing import NETWORK, REFERENCE, make_figure, styled
from surrogate.data import NodalSamples
from surrogate.figures import OTHER
from surrogate.measures import Extrapolation, ForceSweep, force_sweep

Array = NDArray[np.float64]
NOISY = PAPER.noise.largest_force_newton  # samples under larger forces have no noise in training
END, STEP = PAPER.noise.sweep_end_newton, 0.05  # end and step of the forces in N
FLOOR = 0.1  # mm, lower end of the axis


def predict_sweep(resources: Resources, run: str, sweep: str) -> ForceSweep:
    """Predict a sweep up to ±4 N in small steps of the force."""
    surrogate = resources.surrogate(run)
    samples = refined(resources.nodal(sweep).samples)
    predicted = surrogate.predict_distribution(samples.force, resources.scale.passes, SEED)
    return force_sweep(Extrapolation(sweep, surrogate, samples, predicted))


def refined(samples: NodalSamples) -> NodalSamples:
    """Refine a sweep of one force component; displacements by cubic splines."""
    component = samples.force.sum(axis=(1, 2))
    order, steps = np.argsort(component), round(END / STEP)
    forces = np.arange(-steps, steps + 1) * STEP
    force, displacement = (
        CubicSpline(component[order], values[order])(forces)
        for values in (samples.force, samples.displacement)
    )
    return NodalSamples(force, displacement)


def with_noise(sweep: ForceSweep) -> NDArray[np.bool_]:
    """Mask of the forces with noise in training, without 0 N, (N,)."""
    magnitude = np.abs(sweep.force)
    result: NDArray[np.bool_] = (magnitude > STEP / 2) & (magnitude < NOISY + STEP / 2)
    return result


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
