"""Training and validation loss over the epochs (Figure "loss")."""

from __future__ import annotations

from experiments.framework.experiment import Experiment, Findings
from experiments.framework.record import Claim, Table
from experiments.framework.resources import Resources
from experiments.measures.errors_on_test_split import name_of
from experiments.paper.published_numbers import PAPER
from surrogate.figures import loss_curves

Losses = dict[str, list[float]]  # losses of every epoch, by example

RUNS = ("beam2d-det", "lshape2d-det")
FALL = 0.1  # largest relative fall of the training loss in the last tenth of the epochs
RISE = 1.1  # largest ratio of the last validation loss and the smallest


def measure(resources: Resources) -> Findings:
    """Draw the losses of both cases, and test convergence and overfitting."""
    rows, curves, losses = [], {}, []
    training: Losses = {}
    validation: Losses = {}
    for run in RUNS:
        lines, name = resources.trained(run).metric_lines(), name_of(resources, run)
        unit = float(resources.surrogate(run).network.displacement_rms)
        losses.append(f"{name}, {resources.config_of(run).objective}, {unit:.3g} m")
        training[name], curves[name] = [line["train_loss"] for line in lines], lines
        watched = [line["validation_loss"] for line in lines if "validation_loss" in line]
        if watched:
            validation[name] = watched
        rows.append((name, len(lines), training[name][-1], *last_and_smallest(watched)))
    result = Findings(claims=[convergence_claim(training)])
    if validation:
        result.claims.append(overfitting_claim(training, validation))
    head = ("example", "epochs", "training loss, last", "validation loss, last", "smallest")
    result.tables.append(Table(caption="Scaled losses.", head=head, rows=tuple(rows)))
    result.figures["loss-curves"] = (
        loss_curves(curves),
        "Training and validation loss over the epochs, displacements in units of their root mean "
        f"square: {'; '.join(losses)}. The paper's loss is the {PAPER.training_loss}.",
    )
    return result


def last_and_smallest(losses: list[float]) -> tuple[float | None, float | None]:
    """Last and smallest loss, or None for an empty list."""
    return (losses[-1], min(losses)) if losses else (None, None)


def last_fall(losses: list[float]) -> float:
    """Smallest loss of the last tenth of the epochs over the smallest loss before."""
    tenth = max(1, round(len(losses) / 10))
    return min(losses[-tenth:]) / min(losses[:-tenth] or losses)


def convergence_claim(training: Losses) -> Claim:
    """Claim on the fall of the training losses at the end."""
    falls = {name: last_fall(losses) for name, losses in training.items()}
    listed = ", ".join(f"{fall:.3g} of {name}" for name, fall in falls.items())
    return Claim(
        what="The training has converged: in the last tenth of the epochs the training loss no "
        "longer falls.",
        holds=min(falls.values()) >= 1 - FALL,
        evidence=f"Its smallest value there over the smallest before: {listed} (≥ {1 - FALL:g}).",
    )


def overfitting_claim(training: Losses, validation: Losses) -> Claim:
    """Claim on the ratios of the last and the smallest validation losses."""
    rises = {name: losses[-1] / min(losses) for name, losses in validation.items()}
    listed = ", ".join(f"{rise:.3f} of {name}" for name, rise in rises.items())
    ratios = ", ".join(
        f"{losses[-1] / training[name][-1]:.2f} of {name}" for name, losses in validation.items()
    )
    return Claim(
        what="The validation loss does not rise towards the end: nothing is overfitted.",
        holds=max(rises.values()) <= RISE,
        evidence=f"The last over the smallest: {listed} (≤ {RISE}); over the training loss at the "
        f"end: {ratios}.",
    )


STUDY = Experiment(
    name="loss-curves",
    title="Loss curves",
    labels=("fig: loss",),
    question="Has the training converged, without overfitting?",
    measure=measure,
    runs=RUNS,
)
