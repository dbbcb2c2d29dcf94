"""Load families: pure functions of seed and sample number, against counts and integrals by hand."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mpi4py import MPI

from datagen.cases.body import Body, make_body
from datagen.cases.case import Case, read_case
from datagen.cases.placed_body import placed
from datagen.farm.farm import run
from datagen.mesh.distributed_mesh import make_mesh
from datagen.mesh.geometries import Box
from datagen.solver.load_stepping import solve_load_case
from shared_schema.checker import check_dataset
from shared_schema.common.bodies.distributed_loads import facet_points
from shared_schema.common.errors import InputError
from shared_schema.load_cases import LoadCases, write_load_cases
from shared_schema.loads import LoadableNodes, LoadFamily, load_family
from shared_schema.loads.distributed_forces import point_areas, surface_of
from shared_schema.loads.forces_at_nodes import GivenLoads
from shared_schema.loads.regions import Region
from shared_schema.shard import read_shard

PLACE = LoadableNodes(
    nodes=np.array([4, 7, 9, 12]),
    coordinates=np.random.default_rng(0).uniform(size=(20, 2)),
    cells=np.arange(20).reshape(5, 4),
    cell_type="quad",
)
RANDOM_NODE = {"family": "random_node", "region": {"y": 1}, "range": [-2.5, 2.5]}
TRIANGLE = np.array([[[0.0, 0.0, 1.0], [2.0, 0.0, 1.0], [0.0, 1.0, 1.0]]])
SQUARE = np.array([[[0.0, 0.0, 0.0], [2.0, 0.0, 0.0], [2.0, 0.0, 3.0], [0.0, 0.0, 3.0]]])
EDGE = np.array([[[1.0, 1.0], [1.0, 3.0]]])


def test_random_nodes_differ_and_vary_in_number() -> None:
    top = place({"y": 1, "x": "> 0"})
    several = family("random_nodes", range=[-1, 1], count=[2, 3])
    several.check(top)
    counts = []
    for number in range(200):
        load = several.draw(number, 0, top)
        assert len(set(load.nodes)) == len(load.nodes)
        assert set(load.nodes) <= set(top.nodes)
        assert np.abs(load.forces).max() <= 1
        counts.append(len(load.nodes))
    assert set(counts) == {2, 3}
    assert several.loads_per_sample(top) == 3
    with pytest.raises(ValueError, match="the region has 4 nodes"):
        family("random_nodes", range=[-1, 1], count=[2, 9]).check(top)


def test_each_node_in_turn_from_the_top() -> None:
    """On the paper's free edge the first node is on the training line y = 1, the last at y = 0."""
    edge = place({"x": 4})
    each = family("each_node", force=[0, -1.5])
    heights = [float(edge.coordinates[each.draw(i, 0, edge).nodes[0], 1]) for i in range(4)]
    assert heights == pytest.approx([1.0, 0.5, 0.0, 1.0])
    assert each.draw(2, 0, edge).forces.tolist() == [[0.0, -1.5]]
    with pytest.raises(ValueError, match="expected 2 components"):
        family("each_node", force=[0, 0, 1]).check(edge)


def test_sweep() -> None:
    """−8 … 8 N in 5 steps: −8, −4, 0, 4, 8."""
    corner = place({"x": 4, "y": 1})
    sweep = family("sweep", direction=[0, 2], range=[-8, 8], steps=5)
    sweep.check(corner)
    assert [sweep.draw(i, 0, corner).forces[0, 1] for i in range(6)] == [-8, -4, 0, 4, 8, -8]
    assert not any(sweep.draw(i, 0, corner).forces[0, 0] for i in range(5))
    with pytest.raises(ValueError, match="one to sweep at"):
        sweep.check(place({"x": 4}))


def test_traction_on_an_edge() -> None:
    """Edge of length 1 in two elements: trapezoidal rule, 1/4, 1/2, 1/4."""
    edge = place({"x": 4})
    order = np.argsort(edge.coordinates[edge.nodes, 1])
    assert point_areas(edge)[edge.nodes][order] == pytest.approx([0.25, 0.5, 0.25])
    pull = family("traction", range=[-3, 3])
    load = pull.draw(0, 0, edge)
    total = load.forces.sum(axis=0)
    assert np.abs(total).max() <= 3
    assert load.forces == pytest.approx(np.outer(point_areas(edge)[edge.nodes], total))


def test_traction_on_a_face() -> None:
    """Face of 1 m² in 2 x 2 elements: corners 1/16, edges 1/8, centre 1/4."""
    face = place({"x": 4}, (4, 2, 2))
    assert np.sort(point_areas(face)[face.nodes]) == pytest.approx(
        [1 / 16] * 4 + [1 / 8] * 4 + [1 / 4]
    )


def test_traction_needs_facets() -> None:
    with pytest.raises(ValueError, match="belongs to no facet"):
        family("traction", range=[-1, 1]).check(place({"x": 4, "y": 1}))


@pytest.mark.parametrize(
    ("name", "keys", "said"),
    [
        ("random_nodes", {"range": [-1, 1], "count": [3, 2]}, "fewest <= most"),
        ("random_nodes", {"range": [1, 1]}, "low < high"),
        ("sweep", {"direction": [0, 0], "range": [-1, 1], "steps": 3}, "other than zero"),
        ("sweep", {"direction": [0, 1], "range": [-1, 1], "steps": 1}, "greater than 1"),
        ("each_node", {"force": [1]}, "at least 2"),
        ("traction", {"range": [2, 1]}, "low < high"),
    ],
)
def test_wrong_keys(name: str, keys: dict[str, Any], said: str) -> None:
    with pytest.raises(ValueError, match=said):
        family(name, **keys)


def place(region: dict[str, Any], elements: tuple[int, ...] = (4, 2)) -> LoadableNodes:
    """Loadable nodes of a 4 x 1 (x 1) box in a region."""
    upper = (4.0, 1.0, 1.0)[: len(elements)]
    lower = (0.0,) * len(elements)
    mesh = make_mesh(Box(lower=lower, upper=upper, elements=elements), MPI.COMM_SELF)
    nodes = np.flatnonzero(Region(**region).select(mesh.coordinates))
    return LoadableNodes(nodes, mesh.coordinates, mesh.cells, mesh.cell_type)


def family(name: str, **keys: Any) -> LoadFamily:
    return load_family({"family": name, "region": {}, **keys})


def test_a_load_depends_on_seed_and_number_alone() -> None:
    family = load_family(RANDOM_NODE)
    forward = [family.draw(i, 7, PLACE) for i in range(20)]
    backward = [family.draw(i, 7, PLACE) for i in reversed(range(20))][::-1]
    for one, other in zip(forward, backward, strict=True):
        assert np.array_equal(one.forces, other.forces)
        assert np.array_equal(one.nodes, other.nodes)
    assert not np.array_equal(forward[0].forces, family.draw(0, 8, PLACE).forces)
    assert len({tuple(load.forces[0]) for load in forward}) == 20


def test_balanced_nodes_are_loaded_equally_often() -> None:
    family = load_family(RANDOM_NODE)
    loaded = [int(family.draw(i, 0, PLACE).nodes[0]) for i in range(400)]
    assert np.unique(loaded, return_counts=True)[1].tolist() == [100, 100, 100, 100]


def test_unbalanced_nodes_are_drawn() -> None:
    """400 draws of 4 nodes: each within 5 standard deviations (8.7) of 100."""
    family = load_family(RANDOM_NODE | {"balanced": False})
    loaded = [int(family.draw(i, 0, PLACE).nodes[0]) for i in range(400)]
    counts = np.unique(loaded, return_counts=True)[1]
    assert counts.tolist() != [100] * 4
    assert np.all(np.abs(counts - 100) < 44)


def test_force_components_are_uniform() -> None:
    """U(−2.5, 2.5): mean 0, standard deviation 2.5/√3, within 5 standard errors of 4000 draws."""
    family = load_family(RANDOM_NODE)
    forces = np.array([family.draw(i, 1, PLACE).forces[0] for i in range(2000)])
    assert np.abs(forces).max() <= 2.5
    assert abs(forces.mean()) < 5 * 2.5 / np.sqrt(3 * 4000)
    assert forces.std() == pytest.approx(2.5 / np.sqrt(3), rel=0.03)
    assert abs(np.corrcoef(forces.T)[0, 1]) < 5 / np.sqrt(2000)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"family": "wind"}, "load family 'wind'"),
        ({"family": "missing.py:Wind"}, "own classes are read with a case file only"),
        ({"family": "shared_schema.loads.regions:Region"}, "expected one of random_node"),
        ({"family_sha256": "0" * 64}, "load family 'random_node' is no file"),
        ({"family": 3}, "expected 'family'"),
        ({"range": [2.5, -2.5]}, "low < high"),
        ({"magnitude": 3}, "unknown key 'magnitude'"),
        ({"region": {"y": "high"}}, "a comparison"),
    ],
)
def test_invalid_families(change: dict[str, Any], said: str) -> None:
    with pytest.raises(ValueError, match=said):
        load_family(RANDOM_NODE | change)


@pytest.fixture
def file(beam: Body, tmp_path: Path) -> Path:
    """Two load cases: one force at the beam's corner; three on its upper edge."""
    x = beam.mesh.coordinates
    edge = np.flatnonzero((x[:, 1] == 1) & (x[:, 0] > 3.4))
    forces = np.zeros((2, *x.shape))
    forces[0, edge[-1]] = 0.5, -1.0
    forces[1, edge[:3]] = [[0.1, 0.2], [0.3, -0.4], [-0.5, 0.6]]
    path = tmp_path / "loads.h5"
    write_load_cases(path, LoadCases.of(x, forces), beam.mesh.cell_type)
    return path


def test_loads_of_a_file_are_solved(file: Path, beam: Body, tmp_path: Path) -> None:
    case = read_case("beam2d", loads=file)
    assert case.dataset.samples == 2
    manifest = run(case, tmp_path / "nodal", comm=MPI.COMM_SELF)
    assert (manifest.samples, manifest.failed) == (2, 0)
    assert check_dataset(tmp_path / "nodal") == []
    shard = read_shard(tmp_path / "nodal" / "shard-00000.h5", "nodal")
    for number in range(2):
        assert isinstance(case.load, GivenLoads)
        nodes, forces = case.load.cases.load(number)
        order = np.argsort(nodes)
        kept = shard["samples/loaded_nodes"][number] >= 0
        np.testing.assert_array_equal(shard["samples/loaded_nodes"][number][kept], nodes[order])
        np.testing.assert_array_equal(shard["samples/force"][number][kept], forces[order])
        solve_load_case(beam.problem, nodes, forces, case.solver)
        np.testing.assert_allclose(
            shard["samples/displacement"][number], beam.problem.displacement(), atol=1e-12
        )


def test_dataset_knows_the_file_by_its_checksum(file: Path, tmp_path: Path) -> None:
    """A copy elsewhere is the same case; reading a dataset's case needs no file."""
    case = read_case("beam2d", loads=file)
    copy = tmp_path / "copy.h5"
    copy.write_bytes(file.read_bytes())
    assert read_case("beam2d", loads=copy).digest() == case.digest()
    assert "file" not in case.plain()["load"]
    again = Case.model_validate(case.plain())
    assert again.digest() == case.digest()


def test_wrong_files(file: Path, tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no such file of load cases"):
        read_case("beam2d", loads=tmp_path / "none.h5")
    damaged = tmp_path / "damaged.h5"
    damaged.write_bytes(file.read_bytes()[:-300])
    with pytest.raises(InputError, match="damaged"):
        read_case("beam2d", loads=damaged)
    with pytest.raises(InputError, match="--samples 5: --loads"):
        read_case("beam2d", samples=5, loads=file)
    with pytest.raises(InputError, match="its loads are for another mesh"):
        make_body(read_case("lshape2d", loads=file), MPI.COMM_SELF)


def test_loads_outside_the_region(beam: Body, tmp_path: Path) -> None:
    """The region of `beam2d` is the upper edge."""
    x = beam.mesh.coordinates
    forces = np.zeros((1, *x.shape))
    forces[0, np.flatnonzero((x[:, 1] == 0) & (x[:, 0] == 4))] = 1.0
    path = tmp_path / "loads.h5"
    write_load_cases(path, LoadCases.of(x, forces), beam.mesh.cell_type)
    with pytest.raises(InputError, match="expected some of the 15 nodes of the region"):
        make_body(read_case("beam2d", loads=path), MPI.COMM_SELF)


@pytest.mark.parametrize(
    ("corners", "area", "square"),
    [
        (EDGE, 2.0, 26 / 3),  # ∫ y² from 1 to 3
        (TRIANGLE, 1.0, 2 / 3),  # ∫ x² = 2³ · 1 / 12
        (SQUARE, 6.0, 8.0),  # ∫ x² = 3 · 2³ / 3
    ],
    ids=["edge", "triangle", "quadrilateral"],
)
def test_quadrature_is_exact_for_squares(corners: np.ndarray, area: float, square: float) -> None:
    positions, areas, values = facet_points(corners)
    assert areas.sum() == pytest.approx(area, rel=1e-14)
    coordinate = positions[..., 1 if corners is EDGE else 0]
    assert (areas * coordinate**2).sum() == pytest.approx(square, rel=1e-14)
    np.testing.assert_allclose(values.sum(axis=1), 1, rtol=1e-14)
    shares = areas[0] @ values
    np.testing.assert_allclose(shares, area / corners.shape[1], rtol=1e-14)


@pytest.mark.parametrize(
    ("region", "elements", "integral"),
    [
        ({"y": 1, "x": "> 0"}, (160, 4), 16 / 15 * 0.4),  # ∫ (1 − s²/R²)² ds = 16 R / 15
        ({"z": 1, "x": "> 0"}, (80, 20, 2), np.pi * 0.4**2 / 3),  # over a disc: π R² / 3
    ],
    ids=["edge", "face"],
)
def test_resultant(region: dict[str, object], elements: tuple[int, ...], integral: float) -> None:
    """Patches whose disc lies inside the region: the sum of the forces is traction times integral.

    With 20 elements to the diameter or more the quadrature is right to 1e-3.
    """
    loadable, radius = place(region, elements), 0.4
    patch = family("traction_patch", range=[-3, 3], radius=radius)
    x = loadable.coordinates
    seen = 0
    for number in range(60):
        load = patch.draw(number, 0, loadable)
        middle = (x[load.nodes].min(axis=0) + x[load.nodes].max(axis=0)) / 2
        inside = 0.5 < middle[0] < 3.5 and (len(middle) == 2 or 0.45 < middle[1] < 0.55)
        if not inside:
            continue
        seen += 1
        ratio = load.forces / load.forces[0]
        np.testing.assert_allclose(ratio, ratio[:, :1].repeat(len(middle), axis=1), rtol=1e-9)
        traction = load.forces.sum(axis=0) / integral
        assert np.abs(traction).max() <= 3 * (1 + 2e-3)
        weight = np.linalg.norm(load.forces.sum(axis=0)) / integral
        again = np.random.default_rng([0, number])
        again.integers(len(loadable))
        drawn = again.uniform(-3, 3, size=len(middle))
        assert weight == pytest.approx(np.linalg.norm(drawn), rel=2e-3)
    assert seen >= 2


def test_forces_are_in_the_region_and_within_reach() -> None:
    loadable = place({"y": 1, "x": "> 0"}, (16, 4))
    patch = family("traction_patch", range=[-1, 1], radius=0.6)
    patch.check(loadable)
    places = set()
    for number in range(100):
        load = patch.draw(number, 0, loadable)
        assert set(load.nodes) <= set(loadable.nodes)
        assert len(load.nodes) <= patch.loads_per_sample(loadable)
        x = loadable.coordinates[load.nodes, 0]
        assert np.ptp(x) <= 2 * (0.6 + 0.25)
        places.add(x.mean().round(2))
    assert len(places) > 10


def test_a_radius_that_reaches_nothing_is_refused() -> None:
    loadable = place({"y": 1, "x": "> 0"}, (16, 4))
    with pytest.raises(ValueError, match=r"key 'radius' = 0.01: a patch about the node at"):
        family("traction_patch", range=[-1, 1], radius=0.01).check(loadable)
    family("traction_patch", range=[-1, 1], radius=0.2).check(loadable)


def test_several_patches_of_random_radius() -> None:
    """The forces are the sum of single patches, drawn in turn: centre, traction, radius."""
    loadable = place({"y": 1, "x": "> 0"}, (32, 4))
    several = family("traction_patch", range=[-2, 2], radius=[0.3, 0.7], count=[1, 3])
    several.check(loadable)
    counts = set()
    for number in range(20):
        random = np.random.default_rng([7, number])
        patches = random.integers(1, 4)
        counts.add(int(patches))
        expected = np.zeros(loadable.coordinates.shape)
        for _ in range(patches):
            centre = loadable.coordinates[loadable.nodes[random.integers(len(loadable))]]
            traction, radius = random.uniform(-2, 2, size=2), random.uniform(0.3, 0.7)
            expected += np.outer(surface_of(loadable).weights(centre, radius), traction)
        load = several.draw(number, 7, loadable)
        assert len(load.nodes) <= several.loads_per_sample(loadable)
        np.testing.assert_allclose(load.forces, expected[load.nodes], rtol=1e-13)
        assert not np.delete(expected, load.nodes, axis=0).any()
    assert counts == {1, 2, 3}


@pytest.mark.parametrize(
    ("keys", "said"),
    [({"radius": [0.7, 0.3]}, "low < high"), ({"radius": 0.5, "count": [0, 2]}, "1 <= fewest")],
)
def test_wrong_radius_and_count(keys: dict[str, object], said: str) -> None:
    with pytest.raises(ValueError, match=said):
        family("traction_patch", range=[-1, 1], **keys)


def test_patches_on_quadratic_elements() -> None:
    """A case draws them as on linear ones: the resultant is the same to 1e-2, the quadrature's."""
    resultants = []
    for element in ("linear", "quadratic"):
        changes = [
            f"element={element}",
            "load={family: traction_patch, range: [-3, 3], radius: 0.6}",
        ]
        case = read_case("beam2d", changes=changes)
        body = placed(case, case.mesh.raw_mesh())
        loads = [body.loads[number] for number in range(5)]
        assert all((load.between is not None) == (element == "quadratic") for load in loads)
        resultants.append([load.forces.sum(axis=0) for load in loads])
    np.testing.assert_allclose(resultants[0], resultants[1], rtol=1e-2)
