"""Vertical forces up to 8 N at the 2D beam's corner (Fig. "fa2half_deform")."""

from __future__ import annotations

from surrogate.evaluation.force_sweep import force_sweep
from surrogate.studies.force_sweeps import captured_outside, sweep_outcome
from surrogate.studies.study import Outcome, Study
from surrogate.studies.workshop import Workshop

VARIATIONAL, DETERMINISTIC, SWEEP = "beam2d-vb", "beam2d-det", "beam2d_sweep"


def conduct(workshop: Workshop) -> Outcome:
    """Compare both networks with the finite elements along the sweep."""
    variational, deterministic = (
        workshop.predicted_loads(run, SWEEP) for run in (VARIATIONAL, DETERMINISTIC)
    )
    outcome = sweep_outcome(variational, deterministic)
    outcome.claims.append(captured_outside(force_sweep(variational)))
    return outcome


STUDY = Study(
    name="force-sweep-beam",
    title="2D beam under growing forces",
    labels=("fig: fa2half_deform",),
    question="Vertical forces up to 3.2 times those of the training act at the corner: how far are "
    "the predictions off, and does the uncertainty say so?",
    conduct=conduct,
    datasets=(SWEEP,),
    runs=(VARIATIONAL, DETERMINISTIC),
)
