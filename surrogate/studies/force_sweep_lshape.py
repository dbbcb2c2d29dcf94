"""Horizontal forces up to 6 N at the 2D L-shape's inner corner (Fig. "L_deform")."""

from __future__ import annotations

from surrogate.studies.force_sweeps import sweep_outcome
from surrogate.studies.study import Outcome, Study
from surrogate.studies.workshop import Workshop

VARIATIONAL, DETERMINISTIC, SWEEP = "lshape2d-vb", "lshape2d-det", "lshape2d_sweep"


def conduct(workshop: Workshop) -> Outcome:
    """Compare both networks with the finite elements along the sweep."""
    variational, deterministic = (
        workshop.predicted_loads(run, SWEEP) for run in (VARIATIONAL, DETERMINISTIC)
    )
    return sweep_outcome(variational, deterministic)


STUDY = Study(
    name="force-sweep-lshape",
    title="2D L-shape under growing forces",
    labels=("fig: L_deform",),
    question="Horizontal forces up to six times those of the training act at the inner corner: how "
    "far are the predictions off, and does the uncertainty say so?",
    conduct=conduct,
    datasets=(SWEEP,),
    runs=(VARIATIONAL, DETERMINISTIC),
)
