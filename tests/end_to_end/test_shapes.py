"""Networks of a family of shapes: trained, evaluated, right on shapes that they have not seen."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import torch
import yaml

import surrogate
from surrogate.learning.inference.surrogate import Surrogate
from surrogate.learning.probabilistic.stochastic_passes import PASSES
from tests.end_to_end.commands import DATAGEN, SURROGATE, execute

SCRIPT = """// A plate with a hole. Lengths in m.
SetFactory("OpenCASCADE");
DefineConstant[ radius = 0.3, width = 2 ];
Rectangle(1) = {0, 0, 0, width, 1};
Disk(2) = {width / 2, 0.5, 0, radius};
BooleanDifference{ Surface{1}; Delete; }{ Surface{2}; Delete; }
Mesh.MeshSizeMax = 0.3;
"""
CASE = {
    "name": "plate",
    "mesh": {
        "kind": "file",
        "path": "plate.geo",
        "parameters": {"radius": [0.15, 0.3], "width": [1.8, 2.2]},
    },
    "material": {"young_modulus": 500, "poisson_ratio": 0.4},
    "supports": [{"x": 0}],
    "load": {"family": "random_node", "region": {"x": "> 1.9"}, "range": [-5, 5]},
    "solver": {"tolerance": 1e-9},
    "dataset": {"samples": 200, "seed": 1, "shard_size": 100, "test_fraction": 0.1},
}
SMALL = ("training.epochs=100", "network={input_modes: 12, output_modes: 20, width: 64, depth: 2}")


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Case, samples, and a reduced network trained on them."""
    folder = tmp_path_factory.mktemp("shapes")
    (folder / "plate.geo").write_text(SCRIPT)
    (folder / "plate.yaml").write_text(yaml.safe_dump(CASE))
    execute(DATAGEN, "body", folder / "plate.yaml", "--out", folder / "body")
    surrogate.sample(folder / "body", folder / "nodal", 200)
    execute(*(DATAGEN, "structure", folder / "nodal", "--grid", "nodes", "--out", folder / "row"))
    execute(DATAGEN, "structure", folder / "nodal", "--grid", "8,6", "--out", folder / "grid")
    changes = [word for change in ("case=plate", *SMALL) for word in ("--set", change)]
    of = "--data", folder / "row", "--out", folder / "reduced"
    execute(SURROGATE, "train", "reduced-fast", *changes, *of)
    return folder


@pytest.fixture(scope="module")
def model(folder: Path) -> Surrogate:
    return surrogate.load(folder / "reduced")


def test_the_network_learns_from_shapes(folder: Path, model: Surrogate) -> None:
    """Errors on unseen shapes are a small part of those of the linear response of each."""
    measures = surrogate.evaluate(folder / "reduced", folder / "row").measures
    data = surrogate.read_dataset(folder / "row")
    test, names = data.nodal_test, ("radius", "width")
    assert test.parameters is not None
    errors = []
    for force, u, values in zip(test.force, test.displacement, test.parameters, strict=True):
        shape = model.body.of_shape(dict(zip(names, values.tolist(), strict=True)))
        linear = shape.equilibrium.linear_response(force[None])[0]
        errors.append(np.abs(linear - u).mean() / np.linalg.norm(u, axis=1).max())
    print("ERR", measures.relative_error_mean, np.mean(errors))
    assert measures.relative_error_mean < 0.4 * np.mean(errors)


def test_both_ways_to_predict_a_shape_agree(folder: Path, model: Surrogate) -> None:
    """Rows of the encoder that are solved for, and responses that are."""
    shape = model.of_shape({"radius": 0.2, "width": 1.9})
    assert shape.geometry.shape is not None
    assert shape.geometry.shape.tolist() == pytest.approx([-1 / 3, -0.5], abs=1e-6)
    force = surrogate.read_dataset(folder / "row").nodal_test.force[:3]
    assert shape.predictor.at_nodes is not None
    found = shape.predictor.batched.distribution(force, PASSES, 0).mean
    assert shape.predict(force) == pytest.approx(found, abs=1e-5 * np.abs(found).max())
    another = model.of_shape({"radius": 0.25, "width": 1.9}).predict(force)
    assert np.abs(another - found).max() > 1e-3 * np.abs(found).max()


def test_an_unseen_shape_within_the_tolerance(folder: Path) -> None:
    shape = ("--parameter", "radius=0.21", "--parameter", "width=2.13")
    load = ("--load", "2.13,0:1,-5")
    predicted, solved = folder / "predicted.npz", folder / "solved.npz"
    execute(DATAGEN, "solve", folder / "plate.yaml", *shape, *load, "--out", solved)
    execute(
        *(SURROGATE, "predict", folder / "reduced", *shape, *load),
        *("--tolerance", "5e-3", "--out", predicted),
    )
    with np.load(predicted) as ours, np.load(solved) as theirs:
        assert ours["coordinates"] == pytest.approx(theirs["coordinates"], abs=1e-12)
        u = theirs["displacement"]
        error = np.linalg.norm(ours["displacement"] - u, axis=1).max()
        assert error < 5e-3 * np.linalg.norm(u, axis=1).max()


def test_a_file_of_one_shape(folder: Path, model: Surrogate) -> None:
    """The exported network is that of the shape, whose stiffness it contains."""
    out, shape = folder / "shape.pt2", {"radius": 0.2}
    command = (SURROGATE, "export", folder / "reduced", "--format", "pt2", "--out", out)
    execute(*command, "--parameter", "radius=0.2")
    force = surrogate.read_dataset(folder / "row").nodal_test.force[:2]
    program = torch.export.load(out).module()
    found = program(torch.from_numpy(force).float())["displacement"].detach().numpy()
    expected = model.predict(force, parameters=shape)
    assert found == pytest.approx(expected, abs=1e-5 * np.abs(expected).max())


def test_warnings_and_refusals(folder: Path) -> None:
    begin = (SURROGATE, "predict", folder / "reduced", "--load", "2,0:1,-5")
    end = ("--out", folder / "p.npz")
    outside = execute(*begin, "--parameter", "radius=0.31", *end)
    assert "parameter radius = 0.31, outside of its range, 0.15 to 0.3" in outside.stderr
    for given, said in (
        ("depth=1", "--parameter depth=1.0: no such parameter, expected radius, width"),
        ("radius=0.9", "--parameter radius = 0.9, width = 2: "),
    ):
        out = "--out", folder / "q.npz"
        refused = execute(*begin, "--parameter", given, *out, code=2)
        assert said in refused.stderr
        assert not (folder / "q.npz").exists()
    with pytest.raises(SystemExit) as ended:
        execute(*begin, "--parameter", "radius", *end)
    assert ended.value.code == 2
    train = (SURROGATE, "train", "reduced-fast", "--set", "case=plate", "--data", folder / "grid")
    refused = execute(*train, "--out", folder / "none", code=2)
    assert "on samples of many shapes: expected a dataset" in refused.stderr


def test_a_unet_takes_parameters_as_channels(folder: Path) -> None:
    config = {
        "name": "unet",
        "case": "plate",
        "network": {"levels": 2, "channels": 8, "padding": 0, "batch_norm": False},
        "training": {"epochs": 1, "validation_fraction": 0.1},
    }
    model = surrogate.train(config, folder / "grid", folder / "unet", device="cpu")
    force = np.zeros(model.geometry.coordinates.shape)
    force[model.geometry.tip] = 1.0, -5.0
    found = [model.predict(force, parameters={"radius": r}) for r in (0.15, 0.225, 0.3)]
    assert np.abs(found[0] - found[2]).max() > 0
    assert found[1] == pytest.approx(model.predict(force), abs=1e-7)  # the middle of the range
    tolerant = model.predict(force, parameters={"radius": 0.2}, tolerance=1e-3)
    truth = model.of_shape({"radius": 0.2}).correct(force).displacement
    error = np.linalg.norm(tolerant - truth, axis=1).max()
    assert error < 1e-3 * np.linalg.norm(truth, axis=1).max()
