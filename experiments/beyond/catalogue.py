"""All studies beyond the paper in the order of their report."""

from pathlib import Path

from experiments.beyond import (
    certificates,
    coverage,
    force_sizes,
    loads_by_number,
    places,
    times,
    training_samples,
    uncertainty_outside,
)
from experiments.framework.experiment import Experiment
from experiments.framework.report import Report
from experiments.framework.resources import Resources

STUDIES: tuple[Experiment[Resources], ...] = (
    loads_by_number.STUDY,
    places.STUDY,
    force_sizes.STUDY,
    training_samples.STUDY,
    coverage.STUDY,
    uncertainty_outside.STUDY,
    certificates.STUDY,
    times.STUDY,
)
BEYOND = Report("beyond", "Beyond the paper", STUDIES, Path(__file__).parent / "scales")
