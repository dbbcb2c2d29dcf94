"""Time of training, and size of the networks (Table "training_times")."""

from __future__ import annotations

from surrogate.published import PUBLISHED
from surrogate.studies.accuracy import BODIES, name_of
from surrogate.studies.record import Cell, Claim, Comparison, Table, compare
from surrogate.studies.study import Outcome, Study
from surrogate.studies.workshop import Workshop

PLANE = ("beam2d", "lshape2d")
RUNS = ("beam2d-det", "beam2d-vb", "lshape2d-det", "lshape2d-vb", "beam3d-det")
PAPER_SAMPLES = {"beam2d": 5700, "lshape2d": 3800, "beam3d": 33688}
PAPER_HARDWARE = "one V100"


def conduct(workshop: Workshop) -> Outcome:
    """Put minutes and parameters beside the paper's."""
    rows: list[tuple[Cell, ...]] = []
    comparisons: list[Comparison] = []
    minutes = {}
    for run in RUNS:
        case, name, record = workshop.case_of(run), name_of(workshop, run), workshop.run_record(run)
        paper = PUBLISHED[case, workshop.scale.config_of(run).likelihood]
        samples, parameters = workshop.dataset_of(run).info.train, record.parameters / 1e6
        minutes[run] = record.minutes
        papers = (paper.training_minutes, paper.parameters / 1e6)
        rows += [
            (name, "here", samples, record.minutes, parameters, record.hardware),
            (name, "paper", PAPER_SAMPLES[case], *papers, PAPER_HARDWARE),
        ]
        comparisons += [
            compare(f"{name}: training", "min", record.minutes, papers[0]),
            compare(f"{name}: trainable parameters", "million", parameters, papers[1]),
        ]
    table = Table(
        caption="Training of deterministic (D) and Bayesian (VB) U-Nets.",
        head=("example", "", "N", "training [min]", "parameters [M]", "on"),
        rows=tuple(rows),
    )
    claims = [*(bayes_is_longer(case, minutes) for case in PLANE), space_is_longer(minutes)]
    return Outcome([table], comparisons, claims)


def bayes_is_longer(case: str, minutes: dict[str, float]) -> Claim:
    """Whether variational Bayes trains longer than the deterministic U-Net; `minutes` by run."""
    bayes, deterministic = minutes[f"{case}-vb"], minutes[f"{case}-det"]
    papers = [
        PUBLISHED[case, kind].training_minutes for kind in ("variational_bayes", "deterministic")
    ]
    return Claim(
        what=f"{BODIES[case]}: the Bayesian U-Net takes longer to train than the deterministic.",
        holds=bayes > deterministic,
        evidence=f"{bayes:.3g} and {deterministic:.3g} min, {bayes / deterministic:.2g} times; "
        f"the paper: {papers[0] / papers[1]:.2g} times.",
    )


def space_is_longer(minutes: dict[str, float]) -> Claim:
    """Whether the 3D beam trains longer than the plane cases; `minutes` by run."""
    found = [minutes[f"{case}-det"] for case in BODIES]
    papers = [PUBLISHED[case, "deterministic"].training_minutes for case in BODIES]
    return Claim(
        what="The 3D beam takes longer to train than the plane cases, all deterministic.",
        holds=minutes["beam3d-det"] > max(minutes[f"{case}-det"] for case in PLANE),
        evidence=f"{', '.join(f'{m:.3g}' for m in found)} min of {', '.join(BODIES.values())}; "
        f"the paper: {', '.join(f'{m:g}' for m in papers)} min.",
    )


STUDY = Study(
    name="training-times",
    title="Time of training",
    labels=("Tab: training_times",),
    question="How long does training take, and of how many parameters?",
    conduct=conduct,
    runs=RUNS,
)
