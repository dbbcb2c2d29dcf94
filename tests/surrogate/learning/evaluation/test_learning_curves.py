"""Error over the number of training samples."""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import yaml

from shared_schema.common.units import Units
from surrogate.command_line import main
from surrogate.learning.data.dataset import Dataset
from surrogate.learning.evaluation.learning_curves import (
    LearningCurve,
    Point,
    PowerLaw,
    config_of,
    default_counts,
)
from surrogate.learning.evaluation.run_evaluation import evaluate
from surrogate.learning.models.unet_model import UNetModel
from surrogate.learning.runs.folder import RunFolder
from tests.surrogate.figures.pictures import assert_is_picture


def point(samples: int, error: float) -> Point:
    return Point(samples, 1, error, 0.0, 0.0)


def test_power_law() -> None:
    """ē = 0.1 N^(−1/2) m: 10⁻³ m need 10 000 samples."""
    law = PowerLaw.of([point(n, 0.1 * n**-0.5) for n in (100, 400, 1600)])
    assert law.exponent == pytest.approx(0.5)
    assert law.error(2500) == pytest.approx(2e-3)
    assert law.samples(1e-3) == pytest.approx(1e4)
    assert PowerLaw.of([point(100, 1e-3), point(200, 2e-3)]).samples(1e-4) == math.inf


def test_halves() -> None:
    assert default_counts(5700) == [356, 712, 1425, 2850, 5700]
    assert default_counts(50) == [25, 50]
    assert default_counts(3) == [3]


def test_trainings_have_as_many_steps(make_config: Callable[..., UNetModel]) -> None:
    """Half of the samples are seen twice as often."""
    config = config_of(make_config(epochs=6), 100, 200)
    assert isinstance(config, UNetModel)
    assert (config.training.samples, config.training.epochs) == (100, 12)
    assert (config.name, config.recipe) == ("small-n100", "custom")


def test_command(
    data: Path,
    dataset: Dataset,
    tmp_path: Path,
    make_config: Callable[..., UNetModel],
    capsys: pytest.CaptureFixture[str],
) -> None:
    total = len(dataset.training)
    config, out = tmp_path / "small.yaml", tmp_path / "curve"
    config.write_text(yaml.safe_dump(make_config(epochs=1).plain()))
    command = ["learn-curve", str(config), "--data", str(data), "--out", str(out)]
    assert main([*command, "--samples", f"{total + 1}"]) == 2
    assert f"--samples {total + 1}: expected 1 to {total}" in capsys.readouterr().err
    assert not out.exists()
    command += ["--samples", f"{total},{total // 2}", "--goal", "1e-9"]
    assert main(command) == 0
    printed = capsys.readouterr().out.splitlines()
    assert [line.split()[0] for line in printed[1:3]] == [f"{total // 2}", f"{total}"]
    assert "fitted: ē falls as" in printed[3]
    assert "far beyond those that were tried" in printed[4]
    content = json.loads((out / "learning-curve.json").read_text())
    assert [found["epochs"] for found in content["points"]] == [2, 1]
    measures = evaluate(out / f"n{total}", data).measures
    assert content["points"][1]["mean_error"] == measures.mean_error
    weights = RunFolder(out / f"n{total}").model.stat().st_mtime_ns
    assert main(command) == 0  # nothing is trained again
    assert RunFolder(out / f"n{total}").model.stat().st_mtime_ns == weights


def test_units_of_the_case(make_config: Callable[..., UNetModel]) -> None:
    """Numbers of a body in mm are written and drawn in mm; where digits would be lost, in µm."""
    points = tuple(point(n, 1e-3 * n**-0.5) for n in (100, 400))
    in_mm = Units(length="mm")
    curve = LearningCurve(make_config(), points, PowerLaw.of(points), in_mm)
    assert "1.00e-04 mm" in repr(curve)
    fitted, goal = curve.outlook(1e-5)
    assert fitted.endswith("800 samples would have 3.54e-05 mm")
    assert goal.startswith("ē = 1.00e-05 mm needs about 1e+04 training samples")
    (axes,) = curve.plot().axes
    assert axes.get_ylabel() == "mean error [µm]"
    assert np.asarray(axes.lines[0].get_ydata()) == pytest.approx([0.1, 0.05])


def test_figure(tmp_path: Path, make_config: Callable[..., UNetModel]) -> None:
    points = tuple(point(n, 0.1 * n**-0.5) for n in (100, 400, 1600))
    figure = LearningCurve(make_config(), points, PowerLaw.of(points)).plot()
    assert_is_picture(figure, tmp_path)
    measured, fitted = figure.axes[0].lines
    assert np.asarray(measured.get_ydata()) == pytest.approx([10, 5, 2.5])  # mm
    assert np.asarray(fitted.get_xdata())[-1] == 3200
