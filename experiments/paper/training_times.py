"""Time of training, and size of the networks (Table "training_times")."""

from __future__ import annotations

from typing import NamedTuple

from experiments.framework.experiment import Experiment, Findings
from experiments.framework.record import Cell, Claim, Table, compare, format_cell
from experiments.framework.resources import Resources
from experiments.measures.errors_on_test_split import BODIES, name_of
from experiments.paper.published_numbers import PAPER
from surrogate.learning.probabilistic import Likelihood

PLANE = ("beam2d", "lshape2d")
RUNS = ("beam2d-det", "beam2d-vb", "lshape2d-det", "lshape2d-vb", "beam3d-det")


class Duration(NamedTuple):
    """Number of epochs of a training, and its duration in minutes."""

    epochs: int
    minutes: float

    @property
    def per_epoch(self) -> float:
        """Duration of an epoch in s."""
        return 60 * self.minutes / self.epochs


def papers_duration(case: str, likelihood: Likelihood) -> Duration:
    """Duration of the training in the paper."""
    paper = PAPER.networks[case][likelihood]
    return Duration(paper.epochs, paper.training_minutes)


def measure(resources: Resources) -> Findings:
    """Compare the minutes with the paper's; the sizes of the networks are in the table only."""
    rows: list[tuple[Cell, ...]] = []
    result, durations = Findings(), {}
    for run in RUNS:
        name, case = name_of(resources, run), resources.case_of(run)
        record, config = resources.run_record(run), resources.config_of(run)
        paper = papers_duration(case, config.likelihood)
        durations[run] = here = Duration(record.epochs, record.minutes)
        samples, training = resources.dataset_of(run).info.train, config.training
        held_out = 100 * (training.validation_fraction + training.calibration_fraction)
        papers_samples = PAPER.datasets[case].training_samples
        papers_parameters = PAPER.networks[case][config.likelihood].parameters
        rows += [
            (name, "here", samples, held_out, *here, record.parameters / 1e6, record.hardware),
            (name, "paper", papers_samples, None, *paper, papers_parameters / 1e6, PAPER.hardware),
        ]
        result.comparisons.append(compare(f"{name}: training", "min", here.minutes, paper.minutes))
    head = (
        "example",
        "",
        "N",
        "held out [%]",
        "epochs",
        "training [min]",
        "parameters [M]",
        "on",
    )
    caption = (
        "Training of deterministic (D) and Bayesian (VB) U-Nets. Of the N samples of the training "
        "split some are held out for validation and calibration."
    )
    result.tables.append(Table(caption=caption, head=head, rows=tuple(rows)))
    result.claims += [bayes_is_longer(case, durations) for case in PLANE]
    result.claims.append(space_is_longer(durations))
    return result


def bayes_is_longer(case: str, durations: dict[str, Duration]) -> Claim:
    """Test whether an epoch of variational Bayes takes longer than one of the deterministic U-Net.

    Parameters
    ----------
    case : str
    durations : dict of str to Duration
        Durations by run.
    """
    bayes, deterministic = durations[f"{case}-vb"], durations[f"{case}-det"]
    paper = [papers_duration(case, kind) for kind in ("variational_bayes", "deterministic")]
    return Claim(
        what=f"{BODIES[case]}: the Bayesian U-Net takes longer to train than the deterministic, "
        "epoch for epoch.",
        holds=bayes.per_epoch > deterministic.per_epoch,
        evidence=f"{describe(bayes)} and {describe(deterministic)}; the paper: "
        f"{describe(paper[0])} and {describe(paper[1])}.",
    )


def describe(duration: Duration) -> str:
    """Write a duration, such as "12.5 s an epoch (16.6 min)"."""
    return f"{format_cell(duration.per_epoch)} s an epoch ({format_cell(duration.minutes)} min)"


def space_is_longer(durations: dict[str, Duration]) -> Claim:
    """Test whether the 3D beam trains longer than the plane cases; `durations` by run."""
    here = {case: durations[f"{case}-det"].minutes for case in BODIES}
    ours = ", ".join(map(format_cell, here.values()))
    papers = ", ".join(
        format_cell(papers_duration(case, "deterministic").minutes) for case in BODIES
    )
    return Claim(
        what="The 3D beam takes longer to train than the plane cases, all deterministic.",
        holds=here["beam3d"] > max(here[case] for case in PLANE),
        evidence=f"{ours} min of {', '.join(BODIES.values())}; the paper: {papers} min.",
    )


STUDY = Experiment(
    name="training-times",
    title="Time of training",
    labels=("Tab: training_times",),
    question="How long does training take, and how many parameters are trained?",
    measure=measure,
    runs=RUNS,
)
