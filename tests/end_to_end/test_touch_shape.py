"""`surrogate touch` leads from a closed surface to a page."""

from __future__ import annotations

import itertools
import os
import re
from pathlib import Path

import meshio
import numpy as np
import pytest
import yaml

import surrogate
from shared_schema.common.errors import InputError
from shared_schema.dataset_reader import DatasetReader
from surrogate.page import shape
from surrogate.page.shape import region_of
from tests.end_to_end.commands import ROOT, SURROGATE, execute

SIZES = np.array([0.04, 0.04, 0.1])  # of a block in m
HELD = ("--support", "z<0.001", "--young-modulus", "5000", "--no-browser")
LINEAR = ("--set", "element=linear")


@pytest.fixture
def block(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A closed surface in mm."""
    corners = np.array(list(itertools.product((0, 1), repeat=3))) * SIZES * 1000
    quads = [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]]
    triangles = [[a, b, c] for a, b, c, d in quads] + [[a, c, d] for a, b, c, d in quads]
    path = tmp_path / "block one.stl"
    meshio.Mesh(corners, [("triangle", np.array(triangles))]).write(path)
    programs = ROOT / ".venv-datagen" / "bin"
    monkeypatch.setenv("PATH", f"{programs}{os.pathsep}{os.environ['PATH']}")
    return path


def test_a_page_of_a_surface(block: Path) -> None:
    """The largest force moves the tip of the linear body by a tenth of its diagonal, 11.5 mm."""
    folder = block.with_name("made")
    material = (*LINEAR, "--poisson-ratio", "0.45")
    of = ("--scale", "0.001", "--size", "16", "--out", folder, *material)
    said = execute(SURROGATE, "touch", block, *HELD, *of).stderr
    assert said.count("linear elements are too stiff for a Poisson's ratio of 0.45") == 1
    assert (folder / "block one.html").stat().st_size > 1e5
    model = surrogate.load(folder / "series")
    x, tip = model.geometry.coordinates, model.geometry.tip
    sides = " x ".join(f"{side:.3g}" for side in SIZES)
    counts = f"{len(x)} nodes, {len(model.geometry.cells)} tetra cells"
    assert f"{folder}: {sides} m, {counts}\n" in said
    assert np.ptp(x, axis=0) == pytest.approx(SIZES, rel=1e-6)
    assert model.geometry.clamped.tolist() == (x[:, 2] < 1e-3).tolist()
    force = np.zeros((3, *x.shape))
    force[range(3), tip, range(3)] = model.description.data.case["load"]["range"][1]
    moved = np.linalg.norm(model.body.equilibrium.linear_response(force)[:, tip], axis=1).max()
    assert moved == pytest.approx(0.1 * np.linalg.norm(SIZES), rel=0.05)  # two digits
    page = (folder / "block one.html").stat()
    execute(SURROGATE, "touch", block, *HELD, *of)  # nothing is left to do
    assert (folder / "block one.html").stat() == page
    execute(SURROGATE, "touch", block, *HELD, *of, "--poisson-ratio", "0.4", code=2)
    told = execute(
        SURROGATE,
        "predict",
        folder / "series",
        "--load",
        "0.04,0.04,0.1:0.001,0,0",
        "--out",
        folder / "u.npz",
    ).stderr
    assert told.count("linear elements are too stiff") == 1


def test_a_file_in_mm_without_a_scale(block: Path) -> None:
    """It is warned of; a wrong key is named without the file that nobody has written."""
    of = (*HELD, *LINEAR, "--size", "40", "--out", block.with_name("made"))
    said = execute(SURROGATE, "touch", block, *of, "--set", "mesh.szie=4", code=2).stderr
    assert said == "surrogate: error: case: unknown key 'mesh.szie'\n"
    said = execute(SURROGATE, "touch", block, *of).stderr
    assert "; of a file in mm, --scale 0.001 makes metres\n" in said


def test_elements_that_do_not_lock(block: Path) -> None:
    """They are chosen for a plane body of 5 × 1 m, whose end they let move more."""
    script = block.with_name("strip.geo")
    script.write_text(
        'SetFactory("OpenCASCADE"); Rectangle(1) = {0, 0, 0, 5, 1}; Mesh.MeshSizeMax = 0.5;'
        'Physical Surface("all") = {1};\n'
    )
    held = ("--support", "x<0.001", "--young-modulus", "5000", "--poisson-ratio", "0.49")
    moved = []
    elements: tuple[tuple[str, ...], ...] = ((), LINEAR)
    for number, words in enumerate(elements):
        folder = block.with_name(f"strip-{number}")
        to = ("--no-browser", "--out", folder)
        said = execute(SURROGATE, "touch", script, *held, *words, *to).stderr
        assert ("triangle cells, element incompressible for a Poisson" in said) == (not words)
        assert ("too stiff for a Poisson's ratio of 0.49" in said) == bool(words)
        model = surrogate.load(folder / "series")
        moved.append(np.abs(model.solve("5,1:0,-1").displacement).max())
    assert yaml.safe_load((folder / "case.yaml").read_text())["element"] == "linear"
    assert moved[1] < 0.5 * moved[0]


def test_a_body_too_large_for_a_page(block: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The series stays; larger cells are proposed."""
    folder = block.with_name("made")
    monkeypatch.setattr(shape, "BAND", 20_000)
    of = (*HELD, *LINEAR, "--scale", "0.001", "--out")
    for _ in range(2):  # also where body and series are there
        said = execute(SURROGATE, "touch", block, *of, folder, "--size", "16", code=1).stderr
        assert f"surrogate predict {folder / 'series'}" in said.splitlines()[-1]
    assert surrogate.load(folder / "series").geometry.tip > 0
    found = re.search(r"--size (\d+) or more, or --network", said)
    assert found is not None
    assert 16 < float(found[1]) < 32


@pytest.mark.slow
def test_an_open_surface_with_a_zone(block: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A block without a triangle is closed, with a hard middle; paths are those of this folder."""
    mesh = meshio.read(block)
    meshio.Mesh(mesh.points, [("triangle", mesh.cells_dict["triangle"][:-1])]).write(block)
    quads = [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]]
    corners = np.array(list(itertools.product((0, 1), repeat=3))) * 0.6 + 0.2
    meshio.Mesh(corners * SIZES * 1000, [("quad", np.array(quads))]).write(
        block.with_name("hard.ply")
    )
    monkeypatch.chdir(block.parent)
    words = ("--zone", "hard=hard.ply:50000", "--poisson-ratio", "0.4")
    of = ("--scale", "0.001", "--size", "16", "--repair", "--out", "made", *words)
    execute(SURROGATE, "touch", block, *HELD, *of)
    case = yaml.safe_load(Path("made/case.yaml").read_text())
    assert case["mesh"]["path"] == "repaired.stl"
    given = [(each["group"], each["young_modulus"]) for each in case["material"]]
    assert given == [("rest", 5e3), ("hard", 5e4)]
    parts = DatasetReader(Path("made/body")).body["mesh/material"]
    assert 0.1 < (parts == 1).mean() < 0.4  # 0.6³ of the volume


def test_what_is_refused_leaves_nothing(block: Path) -> None:
    before = sorted(block.parent.iterdir())
    for arguments, said in (
        (("--support", "w<0.01", "--young-modulus", "5000"), "support 'w<0.01': expected"),
        (("--support", "z<-1", "--young-modulus", "5000"), "supports"),
        ((*HELD, "--poisson-ratio", "0.7"), "poisson_ratio"),
        ((*HELD, "--zone", "hard=hard.ply"), "--zone 'hard=hard.ply': expected NAME=FILE:E"),
        ((*HELD, "--zone", "rest=hard.ply:5"), "each name once and none 'rest'"),
        ((*HELD, "--set", f"mesh.zones={{a: {block}}}"), "zones.a': no material, load or support"),
    ):
        out = ("--no-browser", "--out", block.with_name("made"))
        told = execute(SURROGATE, "touch", block, *arguments, *out, code=2).stderr
        assert said in told
        assert len(told.strip().splitlines()) == 1
    assert sorted(block.parent.iterdir()) == before


def test_without_the_factory(block: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PATH", "")
    with pytest.raises(InputError, match="no program datagen on the PATH"):
        surrogate.page_of_shape(block, ["z<0.001"], 5000.0, out=block.with_name("made"))


@pytest.mark.parametrize(
    ("text", "region"),
    [
        ("z<0.01", {"z": "< 0.01"}),
        ("x>0.1, x<=0.2,y=1", {"x": "> 0.1 and <= 0.2", "y": 1.0}),
        ("sphere:0,0,0.1:0.02", {"sphere": [0.0, 0.0, 0.1, 0.02]}),
        ("patch:0,0,0.1:0.02:30", {"patch": [0.0, 0.0, 0.1, 0.02, 30.0]}),
        ("plane:0,0,0.1:0,1,1", {"plane": [0.0, 0.0, 0.1, 0.0, 1.0, 1.0]}),
    ],
)
def test_regions(text: str, region: dict[str, object]) -> None:
    assert region_of(text) == region


@pytest.mark.parametrize(
    "text", ["", "z", "z<", "z<a", "z==1", "x=1,x<2", "sphere:1", "sphere:a:1"]
)
def test_texts_that_mean_no_region(text: str) -> None:
    with pytest.raises(InputError, match="expected conditions such as"):
        region_of(text)


@pytest.mark.slow
def test_a_network_of_a_surface(block: Path) -> None:
    """A plan first, then samples, network, bounds and page; once more, all of it is there.

    The network has learned if its errors are less than those of linear elasticity; they are half of
    them, under forces on single nodes of a coarse block, of which it has seen 171.
    """
    folder = block.with_name("made")
    of = (*HELD, *LINEAR, "--scale", "0.001", "--size", "16", "--out", folder, "--network", "200")
    said = execute(SURROGATE, "touch", block, *of).stderr
    assert said.index("reduced network, 48 → 3 × 128 → 96") < said.index("200/200 samples")
    assert (folder / "network.html").stat().st_size > 1e5
    network, data = surrogate.load(folder / "network"), surrogate.read_dataset(folder / "grid")
    assert len(data.train) + len(data.test) == 200
    force, displacement = data.nodal_test.force, data.nodal_test.displacement
    beyond = displacement - network.body.equilibrium.linear_response(force)
    error = network.predict(force) - displacement
    assert np.abs(error).mean() < 0.7 * np.abs(beyond).mean()
    assert network.solve(force[0], certify="fast").certificate is not None
    (folder / "network.html").unlink()
    made = (folder / "network" / "model.safetensors").stat().st_mtime_ns
    assert "samples/s" not in execute(SURROGATE, "touch", block, *of).stderr
    assert (folder / "network.html").is_file()
    assert (folder / "network" / "model.safetensors").stat().st_mtime_ns == made
