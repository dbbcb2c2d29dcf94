"""Numbers of the paper's tables and figures, by their labels in its source."""

from __future__ import annotations

TABLES = (
    "tab:datasets",
    "CNN_MLP",
    "order_table",
    "tab: det_metrics",
    "tab:bayesian_table",
    "Tab: prediction_times",
    "Tab: training_times",
    "const_channel",
)
FIGURES = (
    "schematic",
    "fig:CNN-2D",
    "fig:filter_application",
    "fig: three benchmark examples schematics",
    "L_padding",
    "node_order",
    "2d_beam_test",
    "2d_L_test",
    "fig: 3d_test",
    "fig: det_sensitivity",
    "fig: multiple_force",
    "fig: loss",
    "fig: training_away",
    "average_errors_bayesian",
    "fig: 2d_beam_error_uncertainty",
    "fig: 2d_multiplef_error_uncertainty",
    "fig: 2d_5Nf_error_uncertainty",
    "fig: fa2half_deform",
    "overlap_intervals",
    "fig: L_deform",
    "fig: MLEvsBayes",
)
SCHEMATICS = FIGURES[:3]  # of the method, without a result


def number_of(label: str) -> str:
    """What a label is called in the paper, such as "Table 4"."""
    if label in TABLES:
        return f"Table {TABLES.index(label) + 1}"
    return f"Figure {FIGURES.index(label) + 1}"
