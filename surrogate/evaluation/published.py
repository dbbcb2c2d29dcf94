"""Results that Deshpande, Lengiewicz, Bordas (CMAME 2022) report, to stand beside ours."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Published:
    """The paper's results for one case and likelihood.

    Attributes
    ----------
    mean_error, std_error : float
        ē and σ(e) in m (Table "det_metrics" or "bayesian_table").
    slope : float
        Of the regression line of e_m over displacement.
    training_minutes : float
        On one V100 (Table "training_times").
    parameters : float
        Trainable ones.
    relative_tip_error, tip_displacement : float or None
        Of the example shown, the latter in m, where one is shown with its numbers.
    """

    mean_error: float
    std_error: float
    slope: float
    training_minutes: float
    parameters: float
    relative_tip_error: float | None = None
    tip_displacement: float | None = None


PUBLISHED: dict[tuple[str, str], Published] = {
    ("beam2d", "deterministic"): Published(0.3e-3, 0.2e-3, 0.0008, 131, 7.5e6, 0.006, 0.95),
    ("lshape2d", "deterministic"): Published(0.8e-3, 0.4e-3, 0.0005, 78, 7.5e6, 0.004, 2.39),
    ("beam3d", "deterministic"): Published(0.6e-3, 0.3e-3, 0.001, 1060, 94.1e6, 0.006, 1.1),
    ("beam2d", "variational_bayes"): Published(1.3e-3, 1.3e-3, 0.005, 226, 15.1e6),
    ("lshape2d", "variational_bayes"): Published(5.3e-3, 3.7e-3, 0.006, 143, 14.6e6),
}
