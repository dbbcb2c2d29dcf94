"""The commands lead from a case to a surrogate, each in its own environment."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import meshio
import numpy as np
import pytest
import yaml

from shared_schema.load_cases import LoadCases, write_load_cases
from surrogate import load
from tests.end_to_end.commands import DATAGEN, MPIRUN, ROOT, SURROGATE, execute

CONFIG: dict[str, Any] = {
    "name": "small",
    "case": "beam2d",
    "network": {
        "levels": 3,
        "channels": 12,
        "padding": 0,
        "activation": "gelu",
        "batch_norm": False,
    },
    "training": {
        "epochs": 20,
        "batch_size": 16,
        "optimiser": {"name": "muon", "learning_rate": 5e-3},
        "schedule": {"name": "linear", "warmup": 0.05},
        "validation_fraction": 0.05,
    },
}


@pytest.fixture(scope="module")
def work(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Make a dataset of 600 samples, a trained network, its evaluation and its report."""
    folder = tmp_path_factory.mktemp("pipeline")
    config = folder / "small.yaml"
    config.write_text(yaml.safe_dump(CONFIG))
    nodal, grid, run = folder / "nodal", folder / "grid", folder / "run"
    execute(*MPIRUN, DATAGEN, "run", "beam2d", "--samples", "600", "--out", nodal)
    execute(DATAGEN, "structure", nodal, "--out", grid)
    for dataset in (nodal, grid):
        execute(DATAGEN, "check", dataset)
    execute(SURROGATE, "train", config, "--data", grid, "--out", run)
    published = folder / "published.yaml"
    published.write_text(
        execute(SURROGATE.with_name("python"), "-m", "experiments", "published", run).stdout
    )
    beside = ("--beside", published)
    execute(SURROGATE, "evaluate", run, "--data", grid, *beside)
    page = folder / "report.html"
    execute(SURROGATE, "report", run, "--nodal", nodal, *beside, "--out", page)
    return folder


@pytest.mark.mpi
def test_the_surrogate_learns(work: Path) -> None:
    """Even a tiny network has an ē below a fifth of the mean displacement of 0.053 m."""
    test = json.loads((work / "run" / "evaluation.json").read_text())["test"]
    assert test["samples"] == 30
    assert test["mean_error"] < 0.2 * 0.053


@pytest.mark.mpi
def test_prediction_is_near_the_solution(work: Path) -> None:
    """`predict` and `solve` write the same keys, on the same nodes, for the same load."""
    load = ("--load", "4,1:0,-1.5")
    execute(DATAGEN, "solve", "beam2d", *load, "--out", work / "fem.npz")
    execute(SURROGATE, "predict", work / "run", *load, "--out", work / "net.npz")
    execute(SURROGATE, "predict", work / "run", *load, "--out", work / "net.vtu")
    with np.load(work / "fem.npz") as fem, np.load(work / "net.npz") as net:
        assert sorted(fem) == sorted(net) == ["coordinates", "displacement", "force"]
        assert np.array_equal(fem["coordinates"], net["coordinates"])
        assert np.array_equal(fem["force"], net["force"])
        difference = np.linalg.norm(fem["displacement"] - net["displacement"])
        assert difference < 0.3 * np.linalg.norm(fem["displacement"])
        vtu = meshio.read(work / "net.vtu").point_data["displacement"][:, :2]
        assert vtu == pytest.approx(net["displacement"])


@pytest.mark.slow
@pytest.mark.mpi
def test_a_corrected_prediction_is_the_solution(work: Path) -> None:
    """`predict --correct`, and `solve --start` from the prediction, both to 1e-8 m."""
    load, out = ("--load", "3.2,1:1,-2"), work / "corrected.npz"
    execute(DATAGEN, "solve", "beam2d", *load, "--out", work / "fem.npz")
    execute(SURROGATE, "predict", work / "run", *load, "--out", work / "net.npz")
    execute(SURROGATE, "predict", work / "run", *load, "--correct", "--out", out)
    start = ("--start", work / "net.npz")
    said = execute(DATAGEN, "solve", "beam2d", *load, *start, "--out", work / "started.npz").stdout
    assert "from " in said
    with np.load(work / "fem.npz") as fem:
        for path in (out, work / "started.npz"):
            with np.load(path) as found:
                difference = np.abs(found["displacement"] - fem["displacement"]).max()
                assert difference < 1e-8, path
    certify = ("--certify", "--tolerance", "1e-6", "--budget", "1e-12", "--out", out)
    refused = execute(SURROGATE, "predict", work / "run", *load, *certify, code=3)
    assert "not certified: estimated error" in refused.stderr


@pytest.mark.slow
@pytest.mark.mpi
def test_loads_of_a_file_are_solved_and_learned(work: Path) -> None:
    """40 loads of a file join the 600 samples of the run."""
    loads = ("--loads", work / "own.h5")
    body = load(work / "run").geometry
    forces = np.zeros((40, *body.coordinates.shape))
    forces[:, body.tip] = np.random.default_rng(0).uniform(-2, 2, (40, 2))
    cases = LoadCases.of(body.coordinates, forces)
    write_load_cases(loads[1], cases, body.cell_type)
    execute(DATAGEN, "run", "beam2d", *loads, "--out", work / "worst-nodal")
    execute(DATAGEN, "check", work / "worst-nodal")
    execute(DATAGEN, "structure", work / "worst-nodal", "--out", work / "worst")
    data = ("--data", work / "grid", "--data", work / "worst")
    execute(SURROGATE, "train", work / "small.yaml", *data, "--out", work / "joined")
    description = yaml.safe_load((work / "joined" / "config.yaml").read_text())
    assert description["data"]["info"]["train"] == 570 + 38
    execute(SURROGATE, "evaluate", work / "joined", "--data", work / "grid")


@pytest.mark.mpi
def test_loads_outside_the_training_are_warned_of(work: Path) -> None:
    """The network saw forces on the upper side; on the lower one it predicts next to nothing."""
    out = ("--out", work / "far.npz")
    far = execute(SURROGATE, "predict", work / "run", "--load", "4,1:0,-5", *out)
    assert "beyond those of the training data" in far.stderr
    below = execute(SURROGATE, "predict", work / "run", "--load", "4,0:0,-1", *out, code=3)
    assert "never loaded in the training data" in below.stderr
    assert "not certified: the forces are out of balance by more than the body" in below.stderr


@pytest.mark.slow
@pytest.mark.mpi
def test_everything_again_changes_nothing(work: Path) -> None:
    model = work / "run" / "model.safetensors"
    before = model.read_bytes(), model.stat().st_mtime_ns
    execute(DATAGEN, "run", "beam2d", "--samples", "600", "--out", work / "nodal")
    execute(SURROGATE, "train", work / "small.yaml", "--data", work / "grid", "--out", work / "run")
    assert (model.read_bytes(), model.stat().st_mtime_ns) == before


@pytest.mark.slow
@pytest.mark.mpi
def test_a_run_of_another_case_is_refused(work: Path) -> None:
    """Both cases have the same mesh; the other one has a stiffer material."""
    content = yaml.safe_load((ROOT / "datagen" / "configs" / "beam2d.yaml").read_text())
    content["material"]["young_modulus"] = 900
    (work / "stiff.yaml").write_text(yaml.safe_dump(content))
    execute(DATAGEN, "run", work / "stiff.yaml", "--samples", "30", "--out", work / "stiff-nodal")
    execute(DATAGEN, "structure", work / "stiff-nodal", "--out", work / "stiff")
    refused = execute(SURROGATE, "evaluate", work / "run", "--data", work / "stiff", code=2)
    assert refused.stderr.count("\n") == 1
    assert "material" in refused.stderr
    refused = execute(SURROGATE, "evaluate", work / "run", "--data", work / "nodal", code=2)
    assert "expected a structured one" in refused.stderr


@pytest.mark.mpi
def test_the_report_stands_alone(work: Path) -> None:
    page = (work / "report.html").read_text()
    assert page.count("data:image/png;base64,") == 5
    assert "http" not in page
    assert "0.3" in page  # ē of the paper in mm
