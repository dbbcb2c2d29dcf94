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
    relative_tip_error, tip_displacement : float
        Of the example shown, the latter in m.
    training_minutes : float
        On one V100 (Table "training_times").
    parameters : float
        Trainable ones.
    """

    mean_error: float
    std_error: float
    slope: float
    relative_tip_error: float
    tip_displacement: float
    training_minutes: float
    parameters: float


PUBLISHED: dict[tuple[str, str], Published] = {
    ("beam2d", "deterministic"): Published(0.3e-3, 0.2e-3, 0.0008, 0.006, 0.95, 131, 7.5e6),
}
