"""Segmented images, whose labels become groups of cells."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from datagen.cases.case import read_case
from datagen.cases.placed_body import placed
from datagen.mesh.mesh_file import MeshFile
from shared_schema.common.bodies.groups import RawMesh
from shared_schema.common.errors import InputError
from tests.datagen.mesh.test_mesh_file import CASE

sitk = pytest.importorskip("SimpleITK")
R, SMALL, AT = 12, 6, np.array([3.0, 0.0, 0.0])  # voxels: radii of two balls, centre of the second
TURNED = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])


def balls(finer: int = 1) -> NDArray[np.uint8]:
    """A ball about the centre of 28³ voxels, label 3, and a smaller one in it, label 7.

    With `finer` voxels along each of these.
    """
    along = (np.arange(28.0 * finer) + 0.5) / finer - 14
    x = np.stack(np.meshgrid(*[along] * 3, indexing="ij"), axis=-1)
    labels = 3 * (np.linalg.norm(x, axis=-1) <= R).astype(np.uint8)
    labels[np.linalg.norm(x - AT, axis=-1) <= SMALL] = 7
    return labels


def write_image(
    path: Path, voxels: NDArray[Any], turn: NDArray[np.float64] = TURNED, finer: int = 1
) -> Path:
    """Voxels i, j, k of 1 × 1 × 2 mm, or a part of it."""
    image = sitk.GetImageFromArray(voxels.T)
    image.SetSpacing((1.0 / finer, 1.0 / finer, 2.0 / finer))
    image.SetOrigin((100.0, 0.0, -50.0))
    image.SetDirection(turn.ravel().tolist())
    sitk.WriteImage(image, str(path))
    return path


def mesh_of(path: Path, **keys: Any) -> RawMesh:
    wanted = MeshFile(kind="file", path=path.name, **{"size": 3, "scale": 1e-3, **keys})
    return wanted.found_from(path.parent).raw_mesh()


def volumes(mesh: RawMesh) -> dict[str, float]:
    x = mesh.coordinates[mesh.cells]
    each = np.abs(np.linalg.det(x[:, 1:] - x[:, :1])) / 6
    return {name: float(each[cells].sum()) for name, cells in mesh.cell_groups.items()}


@pytest.mark.parametrize(("ending", "finer"), [(".nii.gz", 1), (".nrrd", 1), (".nrrd", 3)])
def test_a_ball_in_a_ball(ending: str, finer: int, tmp_path: Path) -> None:
    """Volumes are 4/3 π r³ of what smoothing leaves, r − σ²/r; cells of 3 mm cut 2 to 4 % off.

    Of finer voxels, every third is looked at.
    """
    path = write_image(tmp_path / f"organ{ending}", balls(finer), TURNED, finer)
    mesh = mesh_of(path, labels={"tissue": 3, "tumour": 7})
    voxel = 2e-9  # m³
    found = volumes(mesh)
    whole = 4 / 3 * np.pi * (R - 1 / R) ** 3 * voxel
    small = 4 / 3 * np.pi * (SMALL - 1 / SMALL) ** 3 * voxel
    assert sum(found.values()) == pytest.approx(whole, rel=0.04)
    assert found["tumour"] == pytest.approx(small, rel=0.08)
    assert sorted(np.concatenate(list(mesh.cell_groups.values()))) == [*range(len(mesh.cells))]
    # i runs along y and j against x
    half = 14 - 0.5 / finer
    centre = np.array([100 - half, half, -50 + 2 * half]) * 1e-3
    middle = (mesh.coordinates.min(axis=0) + mesh.coordinates.max(axis=0)) / 2
    assert middle == pytest.approx(centre, abs=4e-4)
    size = np.ptp(mesh.coordinates, axis=0)
    assert size == pytest.approx(2 * R * np.array([1, 1, 2]) * 1e-3, rel=0.04)
    x = mesh.coordinates[mesh.cells[mesh.cell_groups["tumour"]]].mean(axis=(0, 1))
    assert x - centre == pytest.approx([0, 3e-3, 0], abs=7e-4)


def test_all_labels_and_some(tmp_path: Path) -> None:
    """Labels without names have their numbers; those left out are outside, here a cavity."""
    path = write_image(tmp_path / "organ.nii", balls().astype(np.float32), np.eye(3))
    every = mesh_of(path, size=5)
    assert sorted(every.cell_groups) == ["3", "7"]
    hollow = mesh_of(path, labels={"tissue": 3}, size=4)
    expected = (R - 1 / R) ** 3 - (SMALL + 1 / SMALL) ** 3
    assert volumes(hollow)["tissue"] == pytest.approx(4 / 3 * np.pi * expected * 2e-9, rel=0.08)


def test_a_label_has_its_own_material(tmp_path: Path) -> None:
    write_image(tmp_path / "organ.nii.gz", balls())
    mesh = {"kind": "file", "path": "organ.nii.gz", "size": 4, "scale": 1e-3}
    labels = {"tissue": 3, "tumour": 7}
    material = [
        {"group": name, "young_modulus": E, "poisson_ratio": 0.4}
        for name, E in (("tissue", 3e3), ("tumour", 3e4))
    ]
    case = {
        **CASE,
        "mesh": {**mesh, "path": str(tmp_path / "organ.nii.gz"), "labels": labels},
        "material": material,
        "supports": [{"z": "< -0.04"}],
        "load": {"family": "body_force", "range": [-1, 1]},
    }
    read = read_case(case)
    parts = placed(read, read.mesh.raw_mesh()).parts
    assert parts is not None
    assert 0.03 < parts.mean() < 0.25  # one cell of eight is of the small ball


@pytest.mark.parametrize(
    ("voxels", "keys", "said"),
    [
        (balls() * 0, {}, "all voxels are 0"),
        (balls(), {"labels": {"bone": 4}}, r"labels\.bone = 4: no voxel has it, .* one of 3, 7"),
        (balls() + 0.5, {}, "another value than a whole number"),
        (np.arange(8000).reshape(20, 20, 20), {}, "7999 different labels"),
        (np.stack([balls()] * 2), {}, "of 3 dimensions with 2 values a voxel"),
        (np.eye(28)[:, :, None] * np.eye(28)[0], {}, "vanish by smoothing over 1 voxels"),
    ],
)
def test_what_is_no_segmentation(
    voxels: NDArray[Any], keys: dict[str, Any], said: str, tmp_path: Path
) -> None:
    path = tmp_path / "organ.nii"
    if voxels.ndim == 3:
        write_image(path, voxels)
    else:
        sitk.WriteImage(sitk.GetImageFromArray(voxels.T), str(path))
    with pytest.raises(InputError, match=f"key 'mesh.path' = 'organ.nii': .*{said}"):
        mesh_of(path, **keys)


def test_what_cannot_be_read(tmp_path: Path) -> None:
    path = tmp_path / "organ.nrrd"
    path.write_text("no image")
    with pytest.raises(InputError, match="SimpleITK reads no image from it"):
        mesh_of(path)
    with pytest.raises(InputError, match=r"'size' of 'organ\.nrrd': expected that of the cells"):
        read_case({**CASE, "mesh": {"kind": "file", "path": "organ.nrrd"}})
    with pytest.raises(InputError, match=r"'labels' of 'own\.stl': expected none, it is no image"):
        read_case({**CASE, "mesh": {"kind": "file", "path": "own.stl", "labels": {"a": 1}}})
