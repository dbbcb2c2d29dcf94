"""Time of training, and size of the networks (Table "training_times")."""

from __future__ import annotations

from typing import NamedTuple

from surrogate.evaluation.paper import PAPER
from surrogate.probabilistic.likelihoods import Likelihood
from surrogate.studies.accuracy import BODIES, name_of
from surrogate.studies.record import Cell, Claim, Table, cell, compare
from surrogate.studies.study import Outcome, Study
from surrogate.studies.workshop import Workshop

PLANE = ("beam2d", "lshape2d")
RUNS = ("beam2d-det", "beam2d-vb", "lshape2d-det", "lshape2d-vb", "beam3d-det")


class Duration(NamedTuple):
    """Epochs of a training, and the minutes that they took."""

    epochs: int
    minutes: float

    @property
    def per_epoch(self) -> float:
        """In s."""
        return 60 * self.minutes / self.epochs


def papers(case: str, likelihood: Likelihood) -> Duration:
    """Duration of the paper's training."""
    paper = PAPER.networks[case][likelihood]
    return Duration(paper.epochs, paper.training_minutes)


def conduct(workshop: Workshop) -> Outcome:
    """Put minutes beside the paper's; the networks' sizes are a choice, and stand in the table."""
    rows: list[tuple[Cell, ...]] = []
    outcome, durations = Outcome(), {}
    for run in RUNS:
        name, case = name_of(workshop, run), workshop.case_of(run)
        record, config = workshop.run_record(run), workshop.scale.config_of(run)
        paper = papers(case, config.likelihood)
        durations[run] = here = Duration(record.epochs, record.minutes)
        samples, training = workshop.dataset_of(run).info.train, config.training
        held_out = 100 * (training.validation_fraction + training.calibration_fraction)
        papers_samples = PAPER.datasets[case].training_samples
        papers_parameters = PAPER.networks[case][config.likelihood].parameters
        rows += [
            (name, "here", samples, held_out, *here, record.parameters / 1e6, record.hardware),
            (name, "paper", papers_samples, None, *paper, papers_parameters / 1e6, PAPER.hardware),
        ]
        outcome.comparisons.append(compare(f"{name}: training", "min", here.minutes, paper.minutes))
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
    outcome.tables.append(Table(caption=caption, head=head, rows=tuple(rows)))
    outcome.claims += [bayes_is_longer(case, durations) for case in PLANE]
    outcome.claims.append(space_is_longer(durations))
    return outcome


def bayes_is_longer(case: str, durations: dict[str, Duration]) -> Claim:
    """Whether an epoch of variational Bayes takes longer than one of the deterministic U-Net.

    Parameters
    ----------
    case : str
    durations : dict of str to Duration
        By run.
    """
    bayes, deterministic = durations[f"{case}-vb"], durations[f"{case}-det"]
    paper = papers(case, "variational_bayes"), papers(case, "deterministic")
    return Claim(
        what=f"{BODIES[case]}: the Bayesian U-Net takes longer to train than the deterministic, "
        "epoch for epoch.",
        holds=bayes.per_epoch > deterministic.per_epoch,
        evidence=f"{in_words(bayes)} and {in_words(deterministic)}; the paper: "
        f"{in_words(paper[0])} and {in_words(paper[1])}.",
    )


def in_words(duration: Duration) -> str:
    """Such as "12.5 s an epoch (16.6 min)"."""
    return f"{cell(duration.per_epoch)} s an epoch ({cell(duration.minutes)} min)"


def space_is_longer(durations: dict[str, Duration]) -> Claim:
    """Whether the 3D beam trains longer than the plane cases; `durations` by run."""
    here = {case: durations[f"{case}-det"].minutes for case in BODIES}
    paper = [papers(case, "deterministic").minutes for case in BODIES]
    return Claim(
        what="The 3D beam takes longer to train than the plane cases, all deterministic.",
        holds=here["beam3d"] > max(here[case] for case in PLANE),
        evidence=f"{', '.join(map(cell, here.values()))} min of {', '.join(BODIES.values())}; "
        f"the paper: {', '.join(map(cell, paper))} min.",
    )


STUDY = Study(
    name="training-times",
    title="Time of training",
    labels=("Tab: training_times",),
    question="How long does training take, and how many parameters are trained?",
    conduct=conduct,
    runs=RUNS,
)
