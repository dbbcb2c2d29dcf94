"""Training and validation loss over the epochs (Figure "loss")."""

from __future__ import annotations

from surrogate.evaluation.paper import PAPER
from surrogate.presentation import figures
from surrogate.studies.accuracy import name_of
from surrogate.studies.record import Claim, Table
from surrogate.studies.study import Outcome, Study
from surrogate.studies.workshop import Workshop

Losses = dict[str, list[float]]  # of every epoch, by example

RUNS = ("beam2d-det", "lshape2d-det")
FALL = 0.1  # of the smallest training loss in the last tenth of the epochs, at most
RISE = 1.1  # of the last validation loss over the smallest, at most


def conduct(workshop: Workshop) -> Outcome:
    """Draw the losses of both cases, and judge how they end."""
    rows, curves, said = [], {}, []
    training: Losses = {}
    validation: Losses = {}
    for run in RUNS:
        lines, name = workshop.trained(run).metric_lines(), name_of(workshop, run)
        unit = float(workshop.surrogate(run).network.unit)
        said.append(f"{name}, {figures.loss_name(workshop.scale.config_of(run))}, {unit:.3g} m")
        training[name], curves[name] = [line["train_loss"] for line in lines], lines
        watched = [line["validation_loss"] for line in lines if "validation_loss" in line]
        if watched:
            validation[name] = watched
        rows.append((name, len(lines), training[name][-1], *last_and_smallest(watched)))
    outcome = Outcome(claims=[convergence_claim(training)])
    if validation:
        outcome.claims.append(overfitting_claim(training, validation))
    head = ("example", "epochs", "training loss, last", "validation loss, last", "smallest")
    outcome.tables.append(Table(caption="Scaled losses.", head=head, rows=tuple(rows)))
    outcome.figures["loss-curves"] = (
        figures.loss_curves(curves),
        "Training and validation loss over the epochs, displacements in units of their root mean "
        f"square: {'; '.join(said)}. The paper's loss is the {PAPER.training_loss}.",
    )
    return outcome


def last_and_smallest(losses: list[float]) -> tuple[float | None, float | None]:
    """The last and the smallest of some losses, if there are any."""
    return (losses[-1], min(losses)) if losses else (None, None)


def last_fall(losses: list[float]) -> float:
    """Smallest loss of the last tenth of the epochs over the smallest one before."""
    tenth = max(1, round(len(losses) / 10))
    return min(losses[-tenth:]) / min(losses[:-tenth] or losses)


def convergence_claim(training: Losses) -> Claim:
    """Claim on how far training losses still fall."""
    falls = {name: last_fall(losses) for name, losses in training.items()}
    said = ", ".join(f"{fall:.3g} of {name}" for name, fall in falls.items())
    return Claim(
        what="The training has converged: in the last tenth of the epochs the training loss no "
        "longer falls.",
        holds=min(falls.values()) >= 1 - FALL,
        evidence=f"Its smallest value there over the smallest before: {said} (≥ {1 - FALL:g}).",
    )


def overfitting_claim(training: Losses, validation: Losses) -> Claim:
    """Claim on the last validation losses over the smallest ones."""
    rises = {name: losses[-1] / min(losses) for name, losses in validation.items()}
    said = ", ".join(f"{rise:.3f} of {name}" for name, rise in rises.items())
    ratios = ", ".join(
        f"{losses[-1] / training[name][-1]:.2f} of {name}" for name, losses in validation.items()
    )
    return Claim(
        what="The validation loss does not rise towards the end: nothing is overfitted.",
        holds=max(rises.values()) <= RISE,
        evidence=f"The last over the smallest: {said} (≤ {RISE}); over the training loss at the "
        f"end: {ratios}.",
    )


STUDY = Study(
    name="loss-curves",
    title="Loss curves",
    labels=("fig: loss",),
    question="Has the training converged, without overfitting?",
    conduct=conduct,
    runs=RUNS,
)
