"""Directions of fibres in a case: vectors, files of every cell, and what datasets hold of them."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from mpi4py import MPI

from datagen.cases.body import make_body
from datagen.cases.case import read_case
from datagen.command_line import main
from datagen.farm.farm import run
from datagen.materials import fibres_of_cells
from datagen.output.dataset_figure import draw
from datagen.output.nodal_samples import NodalSamples
from shared_schema.common.bodies.groups import RawMesh
from shared_schema.common.errors import InputError
from shared_schema.dataset_reader import DatasetReader
from shared_schema.manifest import read_manifest
from shared_schema.materials import HolzapfelGasserOgden, Material, NeoHookean
from tests.datagen.refusal import refusal

ARTERY = {"model": "holzapfel_gasser_ogden", "c10": 100, "k1": 80, "k2": 0.8, "bulk_modulus": 900}
SOFT = NeoHookean(young_modulus=500, poisson_ratio=0.3)
MESH = RawMesh(np.zeros((12, 2)), np.zeros((6, 4), dtype=np.int64), "quad")


def fibrous(folder: Path, fibres: Any) -> Path:
    """The beam of 8 × 2 squares, 4 samples."""
    content = {
        "name": "artery",
        "mesh": {"kind": "box", "lower": [0, 0], "upper": [4, 1], "elements": [8, 2]},
        "material": {**ARTERY, "fibres": fibres},
        "supports": [{"x": 0}],
        "load": {"family": "random_node", "region": {"x": 4}, "range": [-1, 1]},
        "dataset": {"samples": 4, "seed": 1, "shard_size": 2},
    }
    path = folder / "case.yaml"
    path.write_text(yaml.safe_dump(content))
    return path


def angles(count: int = 16) -> np.ndarray:
    """Two families at angles that grow from cell to cell, of length 2."""
    t = np.linspace(0, 1, count)
    return 2 * np.stack([np.stack([np.cos(t), s * np.sin(t)], axis=1) for s in (1, -1)], axis=1)


def of(*fibres: tuple[float, ...]) -> HolzapfelGasserOgden:
    return HolzapfelGasserOgden.model_validate({**ARTERY, "fibres": fibres})


def test_vectors_of_several_materials() -> None:
    """Unit vectors in the cells of their material, 0 elsewhere."""
    materials: list[Material] = [of((3.0, 4.0)), SOFT, of((1.0, 0.0), (0.0, -2.0))]
    found = fibres_of_cells(materials, np.array([0, 0, 1, 2, 1, 2]), MESH)
    assert found is not None
    one, none, two = [[0.6, 0.8], [0, 0]], [[0, 0], [0, 0]], [[1, 0], [0, -1]]
    np.testing.assert_allclose(found, np.array([one, one, none, two, none, two]), atol=1e-15)
    assert fibres_of_cells([SOFT], None, MESH) is None


@pytest.mark.parametrize(
    ("values", "said"),
    [
        (angles(15), "has shape (15, 2, 2), expected (16, 1 to 2, 2): cells, families, components"),
        (np.ones((16, 3, 2)), "has shape (16, 3, 2), expected (16, 1 to 2, 2)"),
        (np.ones((16, 3)), "has shape (16, 1, 3), expected (16, 1 to 2, 2)"),
        (np.where(np.arange(16) == 5, 0.0, 1.0)[:, None] * np.ones((16, 2)), "of cell 5, family 0"),
        (np.where(np.arange(16) == 7, np.nan, 1.0)[:, None] * np.ones((16, 2)), "of cell 7, fam"),
        (np.array(["along"] * 16), "'directions.npy': cannot be read"),
    ],
)
def test_unfit_files(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], values: np.ndarray, said: str
) -> None:
    np.save(tmp_path / "directions.npy", values)
    path = fibrous(tmp_path, {"file": "directions.npy"})
    out = str(tmp_path / "out.npz")
    assert said in refusal(["solve", str(path), "--load", "4,1:0,-1", "--out", out], capsys)


@pytest.mark.parametrize(
    ("fibres", "said"),
    [
        ([1, 0, 0], "key 'material.fibres' = [[1.0, 0.0, 0.0]]: expected 2 components each"),
        ([0, 0], "key 'material.fibres': the vector [0.0, 0.0] has no direction"),
        ({"file": "none.npy"}, "key 'material.fibres.file' = 'none.npy': no such file"),
        ({"file": "none.npy", "size": 1}, "unknown key 'material.fibres.size'"),
        (None, "key 'material.fibres' = None: expected a vector"),
        ([1e10, 0], "key 'material.fibres': expected a vector, one for each family"),
    ],
)
def test_wrong_keys(tmp_path: Path, fibres: Any, said: str) -> None:
    with pytest.raises(InputError) as error:
        make_body(read_case(str(fibrous(tmp_path, fibres))), MPI.COMM_SELF)
    assert said in str(error.value)


def test_a_dataset_has_the_directions(tmp_path: Path) -> None:
    """Nodal and structured datasets hold them, without the file; figures draw them."""
    np.save(tmp_path / "directions.npy", angles())
    nodal, grid = tmp_path / "nodal", tmp_path / "grid"
    run(read_case(str(fibrous(tmp_path, {"file": "directions.npy"}))), nodal, comm=MPI.COMM_SELF)
    (tmp_path / "directions.npy").unlink()
    assert main(["check", str(nodal)]) == 0
    assert main(["structure", str(nodal), "--out", str(grid)]) == 0
    assert main(["check", str(grid)]) == 0
    for folder in (nodal, grid):
        np.testing.assert_allclose(DatasetReader(folder).body["mesh/fibres"], angles() / 2)
    named = read_manifest(nodal).case["material"]["fibres"]
    assert len(named["sha256"]) == 64
    figure = draw(NodalSamples(nodal))
    segments = [len(each.get_segments()) for each in figure.axes[0].collections[1:3]]  # type: ignore[attr-defined]
    assert segments == [16, 16]
    assert main(["export", str(nodal), "--stresses", "--out", str(tmp_path / "all.pvd")]) == 0


def test_a_changed_file_is_another_case(tmp_path: Path) -> None:
    np.save(tmp_path / "directions.npy", angles())
    path = fibrous(tmp_path, {"file": "directions.npy"})
    before = read_case(str(path))
    np.save(tmp_path / "directions.npy", -angles())
    assert read_case(str(path)).digest() != before.digest()
    fibres = {"file": "directions.npy", "sha256": before.plain()["material"]["fibres"]["sha256"]}
    with pytest.raises(InputError, match=r"key 'material\.fibres\.sha256' = "):
        read_case(str(fibrous(tmp_path, fibres)))
