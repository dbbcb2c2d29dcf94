"""Wrong arguments of public functions and methods: one line that names them."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

import surrogate
from shared_schema.common.errors import InputError

NODES = (64, 2)  # of beam2d_any
ZERO = np.zeros(NODES)
NO_FIELDS: dict[str, Any] = {
    "None": None,
    "text": "abc",
    "path": Path("x"),
    "dict": {},
    "set": {1},
    "ragged": [[1], [1, 2]],
    "objects": np.array([object()]),
    "dates": ZERO.astype("datetime64[s]"),
    "complex": ZERO + 0j,
    "complex tensor": torch.zeros(NODES, dtype=torch.complex64),
    "masked": np.ma.masked_array(ZERO, mask=ZERO == 0),
    "no mask": np.ma.masked_array(ZERO),
    "number": 1.0,
    "nothing": np.zeros(0),
    "too short": ZERO[1:],
    "batch of batches": np.zeros((1, 1, *NODES)),
}
PATHS: tuple[Any, ...] = (None, 3, b"x", ["a"], True, float("nan"), "", "a\0b", "x" * 5000)


@pytest.fixture(scope="module")
def model() -> surrogate.Surrogate:
    return surrogate.load("beam2d_any")


@pytest.mark.parametrize("kind", NO_FIELDS)
def test_what_is_no_field_at_the_nodes(model: surrogate.Surrogate, kind: str) -> None:
    wrong = NO_FIELDS[kind]
    calls: list[Callable[[], object]] = [
        lambda: model.predict(wrong),
        lambda: model.averaged_passes(wrong),
        lambda: model.certify(wrong),
        lambda: model.correct(wrong),
        lambda: model.stresses(wrong),
        lambda: model.reactions(wrong),
        lambda: model.solve(wrong),
    ]
    if wrong is not None:
        calls += [
            lambda: model.certify(ZERO, wrong),
            lambda: model.correct(ZERO, wrong),
            lambda: model.reactions(ZERO, wrong),
        ]
    for call in calls:
        with pytest.raises(InputError) as found:
            call()
        assert "\n" not in str(found.value)


def test_other_arrays_are_numbers_in_double_precision(model: surrogate.Surrogate) -> None:
    """Numbers that all of these types hold."""
    force = np.zeros((2, *NODES))
    force[1, -1] = 0.5, -1
    expected = model.certify(force).error
    for kind in (np.float32, np.float16):
        np.testing.assert_array_equal(model.certify(force.astype(kind)).error, expected)
    tensor = torch.from_numpy(force).requires_grad_()
    for given in (tensor, tensor.bfloat16(), force.tolist()):
        np.testing.assert_array_equal(model.certify(given).error, expected)
    assert model.predict(tensor.bfloat16()).dtype == torch.bfloat16


def test_batches_and_no_loads(model: surrogate.Surrogate) -> None:
    """Stresses and reactions of several displacements are those of each; of none, none."""
    u = np.random.default_rng(0).normal(0, 1e-3, (3, *NODES)) * model.body.equilibrium.free
    pushed = np.random.default_rng(1).normal(size=u.shape)
    reactions, stresses = model.reactions(u, pushed), model.stresses(u)
    for k in range(3):
        np.testing.assert_allclose(reactions[k], model.reactions(u[k], pushed[k]), rtol=1e-12)
        for name, values in model.stresses(u[k]).items():
            np.testing.assert_allclose(stresses[name][k], values, rtol=1e-9)
    none = np.zeros((0, *NODES))
    assert model.reactions(none).shape == model.predict(none).shape == none.shape
    assert model.stresses(none)["von_mises"].shape[0] == 0
    assert model.certify(none).summary() == "0 predictions"


@pytest.mark.parametrize(
    ("options", "part"),
    [
        ({"certify": "quick"}, "certify = 'quick': expected 'fast' or 'full'"),
        ({"certify": True}, "certify = True: expected 'fast' or 'full'"),
        ({"certify": "full", "tolerance": "1"}, "tolerance = '1': expected a number"),
        ({"certify": "full", "tolerance": -1.0}, "tolerance -1.0: expected a positive number"),
        (
            {"certify": "full", "tolerance": float("nan")},
            "tolerance nan: expected a positive number",
        ),
        ({"certify": "fast", "level": "a"}, "level = 'a': expected a number"),
        ({"conformal": "x"}, "conformal = 'x': expected 'marginal' or 'simultaneous'"),
        ({"correct": "yes"}, "correct = 'yes': expected a bool"),
        ({"stresses": 1}, "stresses = 1: expected a bool"),
        ({"passes": 1.5}, "passes = 1.5: expected a whole number"),
        ({"passes": True}, "passes = True: expected a whole number"),
        ({"seed": "3"}, "seed = '3': expected a whole number"),
    ],
)
def test_options_of_solve(model: surrogate.Surrogate, options: dict[str, Any], part: str) -> None:
    with pytest.raises(InputError, match=part):
        model.solve("4,1:0,-1", **options)


def test_unknown_options_are_errors_of_the_program(model: surrogate.Surrogate) -> None:
    with pytest.raises(TypeError, match=r"solve\(\): got an unexpected keyword argument 'levels'"):
        model.solve("4,1:0,-1", levels=3)  # type: ignore[call-arg]


@pytest.mark.parametrize("path", PATHS, ids=lambda path: repr(path)[:10])
def test_paths(
    model: surrogate.Surrogate, path: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Nothing is written, also not into the working directory, which an empty text would name."""
    monkeypatch.chdir(tmp_path)
    out = tmp_path / "out"
    calls: list[Callable[[], object]] = [
        lambda: surrogate.load(path),
        lambda: surrogate.read_dataset(path),
        lambda: surrogate.read_config(path),
        lambda: surrogate.read_published(path),
        lambda: surrogate.train(path, out, out),
        lambda: surrogate.train("reduced", out, path),
        lambda: surrogate.evaluate(path, out),
        lambda: surrogate.evaluate("beam2d_any", path),
        lambda: surrogate.compare([path]),
        lambda: surrogate.compare(path),
        lambda: surrogate.first_config(path),
        lambda: surrogate.export(path, out, format="onnx"),
        lambda: surrogate.export("beam2d_any", path, format="onnx"),
        lambda: surrogate.shelve(path, "name"),
        lambda: surrogate.write_page(path, out),
        lambda: surrogate.write_report("beam2d_any", path),
        lambda: model.solve("4,1:0,-1").save(path),
    ]
    for call in calls:
        with pytest.raises(InputError) as found:
            call()
        assert "\n" not in str(found.value)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("device", [None, "foo", "meta", "mps", 3, "cuda:99"])
def test_devices(device: Any) -> None:
    with pytest.raises(InputError, match="device"):
        surrogate.load("beam2d_any", device)


def test_a_gpu_that_is_not_there(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(torch.cuda, "device_count", lambda: 0)
    with pytest.raises(InputError, match="--device 'cuda': none here, expected 'cpu' or 'auto'"):
        surrogate.load("beam2d_any", "cuda")


@pytest.mark.parametrize("value", [None, "a", 0, -1, 1.5, True, float("nan"), 10**30, [1]])
def test_numbers(model: surrogate.Surrogate, value: Any, tmp_path: Path) -> None:
    calls: list[Callable[[], object]] = [
        lambda: surrogate.write_page("beam2d_any", tmp_path / "a", largest=value),
        lambda: surrogate.shelve("beam2d_any", value),
        lambda: surrogate.train("reduced", tmp_path, tmp_path / "run", stop_after=value),
        lambda: surrogate.read_config("beam2d-reduced", changes=[value]),
    ]
    for call in calls:
        with pytest.raises(InputError) as found:
            call()
        assert "\n" not in str(found.value)
