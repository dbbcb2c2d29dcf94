"""Messages have the units of the case, and lengths that can be read at any size."""

from __future__ import annotations

import logging

import numpy as np
import pytest

import surrogate
from shared_schema.common.bodies.equilibrium import UNITS as CONSISTENT
from surrogate.learning.inference.surrogate import Surrogate, make_surrogate
from surrogate.learning.runs.folder import RunFolder
from surrogate.learning.runs.shelf import find_run
from tests.surrogate.scaled import scaled

TIMES = "times that of the training data"


@pytest.fixture(scope="module")
def in_millimetres() -> Surrogate:
    folder = RunFolder(find_run("beam2d_any"))
    description = folder.description()
    case = {**description.data.case, "units": {"length": "mm", "force": "N"}}
    data = description.data.model_copy(update={"case": case})
    return make_surrogate(folder.read_tensors(), description.model_copy(update={"data": data}))


def test_labels_of_the_case(in_millimetres: Surrogate) -> None:
    solution = in_millimetres.solve(
        "4,1:0,-1.5", certify="full", correct=True, tolerance=1.0, stresses=True
    )
    text = repr(solution)
    assert " mm at (" in text
    assert text.count(" MPa") == 1
    assert " N," in text
    for word in (" mm", " mean", " most", " mesh"):
        text = text.replace(word, "")
    assert " m" not in text
    usual = scaled("beam2d_any")[0].solve("4,1:0,-1.5", stresses=True)
    assert " mm at (4, 1) m" in repr(usual)
    assert " Pa" in repr(usual)


@pytest.mark.parametrize(("length", "unit"), [(1e-6, "µm"), (1.0, "mm"), (1e3, "m")])
def test_bodies_of_4_micrometres_and_4_kilometres(length: float, unit: str) -> None:
    model, factor = scaled("beam2d_any", length)
    force = np.zeros_like(model.geometry.coordinates)
    force[np.linalg.norm(model.geometry.coordinates, axis=1).argmax(), 1] = -0.5 * factor
    assert f" {unit} at (" in repr(model.solve(force))


@pytest.mark.parametrize(
    ("name", "load", "size", "end"),
    [
        ("beam2d_any", "4,1:0,-1e-6", "1e-07 of the body's size, 4", CONSISTENT),
        ("beam2d_any", "4,1:300,-300", "1.6 of the body's size, 4", CONSISTENT),
        ("finger3d", "0.088,0,0.0079:0,15,0", "10 of the body's size, 0.088", f"55.2 {TIMES}"),
        (
            "finger3d",
            "0.088,0,0.0079:0,1500,0",
            "1e+03 of the body's size, 0.088",
            f"5.52e+03 {TIMES}; are the units consistent?",
        ),
    ],
)
def test_a_displacement_of_an_unusual_size_is_warned_of(
    name: str, load: str, size: str, end: str, caplog: pytest.LogCaptureFixture
) -> None:
    """Fifty times the 0.14 N of a training are no other unit; a load series has no training."""
    model = surrogate.load(name)
    with caplog.at_level(logging.WARNING):
        model.solve(load, nearest=True)
    (message,) = (text for text in caplog.messages if "of the body's size" in text)
    assert message.startswith(f"the largest predicted displacement is {size}; ")
    assert message.endswith(end)
    assert ("times that of" in message) == (name == "finger3d")
