"""All studies in the order of the report: the paper's tables, then its figures."""

from pathlib import Path

from experiments.framework.experiment import Experiment
from experiments.framework.report import Report
from experiments.framework.resources import Resources
from experiments.paper import (
    bayesian_accuracy,
    constant_channels,
    datasets,
    deterministic_accuracy,
    error_against_displacement,
    force_sweeps,
    linear_network,
    loads_away,
    loss_curves,
    multiple_loads,
    node_order,
    noisy_data,
    prediction_times,
    single_predictions,
    training_ranges,
    training_times,
    uncertainty_fields,
)
from experiments.paper.published_numbers import PAPER

STUDIES: tuple[Experiment[Resources], ...] = (
    datasets.STUDY,
    linear_network.STUDY,
    node_order.STUDY,
    deterministic_accuracy.STUDY,
    bayesian_accuracy.STUDY,
    prediction_times.STUDY,
    training_times.STUDY,
    constant_channels.STUDY,
    single_predictions.STUDY,
    error_against_displacement.STUDY,
    multiple_loads.STUDY,
    loss_curves.STUDY,
    loads_away.STUDY,
    uncertainty_fields.STUDY,
    force_sweeps.BEAM,
    training_ranges.STUDY,
    force_sweeps.LSHAPE,
    noisy_data.STUDY,
)
REPRODUCTION = Report(
    "reproduction",
    "The paper's tables and figures",
    STUDIES,
    Path(__file__).parent / "scales",
    PAPER.title_of,
)
