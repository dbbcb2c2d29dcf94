"""Training and validation loss over the epochs (Figure "loss")."""

from __future__ import annotations

from surrogate import figures
from surrogate.studies.accuracy import name_of
from surrogate.studies.record import Claim, Table
from surrogate.studies.study import Outcome, Study
from surrogate.studies.workshop import Workshop

RUNS = ("beam2d-det", "lshape2d-det")
RISE = 1.1  # of the last validation loss over the smallest, at most


def conduct(workshop: Workshop) -> Outcome:
    """Draw the losses of both cases, and compare the last validation loss with the smallest."""
    outcome, rows, rises = Outcome(), [], {}
    for run in RUNS:
        lines, name = workshop.trained(run).metric_lines(), name_of(workshop, run)
        loss = figures.loss_name(workshop.scale.config_of(run))
        validation = [line["validation_loss"] for line in lines if "validation_loss" in line]
        rows.append((name, len(lines), lines[-1]["train_loss"], *last_and_smallest(validation)))
        if validation:
            rises[name] = validation[-1] / min(validation)
        caption = f"{name}: {loss} of training and validation part over the epochs."
        outcome.figures[workshop.case_of(run)] = (figures.loss_curves(lines, loss), caption)
    head = ("example", "epochs", "training loss, last", "validation loss, last", "smallest")
    outcome.tables.append(Table(caption="Scaled losses.", head=head, rows=tuple(rows)))
    if rises:
        outcome.claims.append(overfitting_claim(rises))
    return outcome


def last_and_smallest(losses: list[float]) -> tuple[float | None, float | None]:
    """The last and the smallest of some losses, if there are any."""
    return (losses[-1], min(losses)) if losses else (None, None)


def overfitting_claim(rises: dict[str, float]) -> Claim:
    """Claim on the last validation losses over the smallest ones."""
    said = ", ".join(f"{rise:.3f} ({name})" for name, rise in rises.items())
    return Claim(
        what="The validation loss does not rise towards the end: nothing is overfitted.",
        holds=max(rises.values()) <= RISE,
        evidence=f"The last over the smallest: {said} (≤ {RISE}).",
    )


STUDY = Study(
    name="loss-curves",
    title="Loss curves",
    labels=("fig: loss",),
    question="Has the training converged, without overfitting?",
    conduct=conduct,
    runs=RUNS,
)
