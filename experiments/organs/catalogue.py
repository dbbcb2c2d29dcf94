"""All studies of the organs in the order of their report."""

from pathlib import Path

from experiments.framework.experiment import Experiment
from experiments.framework.report import Report
from experiments.framework.resources import Resources
from experiments.organs import accuracy, pictures, published_load

STUDIES: tuple[Experiment[Resources], ...] = (
    accuracy.STUDY,
    published_load.STUDY,
    pictures.STUDY,
)
ORGANS = Report("organs", "Organs", STUDIES, Path(__file__).parent / "scales")
