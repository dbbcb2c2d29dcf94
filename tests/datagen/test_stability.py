"""Slender columns that buckle: stability by all ways, against eigenvalues, Euler and his elastica.

They are clamped at x = 0 and compressed along their axis.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from mpi4py import MPI
from numpy.typing import NDArray

import datagen
from datagen.command_line import main
from datagen.discretisation.element import Element
from datagen.mesh.distributed_mesh import distributed
from datagen.mesh.geometries import Box
from datagen.solver.equilibrium import EquilibriumProblem
from datagen.solver.load_stepping import solve_load_case
from datagen.solver.settings import LinearSolver, SolverSettings
from datagen.stability import (
    NOT_LEFT,
    UNSTABLE,
    SymmetricFactor,
    is_stable,
    pressures_of,
    unstable_modes,
    with_stability,
)
from datagen.transforms.reindexing import structure
from shared_schema.actuators import pressed
from shared_schema.common.bodies.cells import outward_facets
from shared_schema.common.bodies.following_loads import PressedSurface
from shared_schema.common.errors import WorkError
from shared_schema.dataset_reader import DatasetReader
from shared_schema.layout import Arrays
from shared_schema.load_cases import LoadCases, write_load_cases
from shared_schema.loads import LoadableNodes
from shared_schema.loads.distributed_forces import point_areas
from shared_schema.manifest import Manifest, write_manifest
from shared_schema.materials import NeoHookean
from shared_schema.samples.results import SolveReport
from shared_schema.shard import read_shard, write_shard
from tests.datagen.farm_runs import assert_same, finish
from tests.datagen.farm_runs import datagen as words
from tests.datagen.solver.cantilever import box

MODULUS = 500.0  # Pa
LENGTH, HEIGHT = 10.0, 0.5  # m
SHARDS = ("dataset.shard_size=3", "load.region={x: '> 0'}")
Runner = Callable[..., Manifest]


class Column:
    """A column whose end is under a compressive dead force.

    Parameters
    ----------
    elements : tuple of d ints
        Cells along every axis.
    element, simplices, linear_solver, ratio
        Kind of the elements and the solver; Poisson's ratio.
    """

    def __init__(
        self,
        elements: tuple[int, ...],
        element: Element = "linear",
        simplices: bool = False,
        linear_solver: LinearSolver = "lu",
        ratio: float = 0.0,
    ) -> None:
        upper = (LENGTH, *[HEIGHT] * (len(elements) - 1))
        mesh = distributed(box(upper, elements, simplices), MPI.COMM_SELF)
        self.x = mesh.coordinates
        self.end = np.flatnonzero(np.isclose(self.x[:, 0], LENGTH))
        self.areas = point_areas(LoadableNodes(self.end, self.x, mesh.cells, mesh.cell_type))[
            self.end
        ]
        self.settings = SolverSettings(linear_solver=linear_solver, first_step=0.5)
        material = NeoHookean(young_modulus=MODULUS, poisson_ratio=ratio)
        clamped = np.isclose(self.x[:, 0], 0.0)
        self.problem = EquilibriumProblem(mesh, material, clamped, self.settings, element)

    @property
    def euler(self) -> float:
        """π² E I / (4 L²) in N, with I = A h² / 12 (in the plane the body is 1 m thick)."""
        inertia = self.areas.sum() * HEIGHT**2 / 12
        return float(np.pi**2 * MODULUS * inertia / (4 * LENGTH**2))

    def solve(self, force: float) -> SolveReport:
        """Compress the column from rest by a force in N, spread evenly over its end."""
        forces = np.zeros((len(self.end), self.x.shape[1]))
        forces[:, 0] = -force * self.areas / self.areas.sum()
        report = solve_load_case(self.problem, self.end, forces, self.settings)
        assert report.solved
        return report

    def end_displacement(self) -> NDArray[np.float64]:
        """Mean displacement of the end in m."""
        mean: NDArray[np.float64] = self.problem.displacement()[self.end].mean(axis=0)
        return mean


def eigenvalues(problem: EquilibriumProblem) -> NDArray[np.float64]:
    """Eigenvalues of K, dilations and pressures eliminated: those of the Hessian of the energy."""
    matrix = problem.tangent()
    k = matrix.getValues(range(problem.size), range(problem.size))
    u = np.zeros(problem.size, dtype=bool)
    u[problem.unknowns.point_dofs.ravel()] = True
    rest = k[~u][:, ~u]
    reduced = k[u][:, u] - k[u][:, ~u] @ np.linalg.solve(rest, k[~u][:, u]) if rest.size else k
    return np.linalg.eigvalsh((reduced + reduced.T) / 2)


@pytest.mark.parametrize(
    ("element", "simplices", "elements", "linear_solver"),
    [
        ("linear", False, (12, 2), "lu"),
        ("linear", True, (12, 2), "corotated"),
        ("quadratic", False, (6, 1), "multigrid"),
        ("quadratic", True, (6, 1), "lu"),
        ("incompressible", False, (12, 2), "multigrid"),
        ("incompressible", True, (6, 1), "lu"),
        ("incompressible", True, (6, 1), "corotated"),
        ("linear", False, (8, 1, 1), "multigrid"),
        ("linear", True, (8, 1, 1), "corotated"),
        ("incompressible", False, (8, 1, 1), "lu"),
        ("incompressible", True, (4, 1, 1), "corotated"),
    ],
)
def test_inertia_is_that_of_all_eigenvalues(
    element: Element, simplices: bool, elements: tuple[int, ...], linear_solver: LinearSolver
) -> None:
    """Far below and above the first critical load of the elements, in space of two modes."""
    column = Column(elements, element, simplices, linear_solver, ratio=0.3)
    problem, found = column.problem, []
    is_mixed = element == "incompressible" and simplices
    assert (pressures_of(problem) > 0) == is_mixed
    for part in (0.1, 4.0, 15.0, 60.0):
        column.solve(part * column.euler)
        stable = is_stable(problem)
        negative = int((eigenvalues(problem) < 0).sum())
        assert unstable_modes(problem) == negative
        assert stable == (negative == 0)
        found.append(negative)
    assert found[0] == 0
    assert found[-1] >= len(elements) - 1  # one mode, or two at once in a square column


@pytest.mark.parametrize("linear_solver", ["lu", "corotated"])
def test_critical_load_is_that_of_euler(linear_solver: LinearSolver) -> None:
    """π² E I / (4 L²) within 0.5 %, by halving of an interval; plane, ν = 0.

    Compression and shear change it by the order of the critical strain,
    π² h² / (48 L²) = 0.05 %; quadratic elements of h / 2 bend to 0.1 %.
    """
    column = Column((40, 2), "quadratic", linear_solver=linear_solver)
    low, high = 0.9 * column.euler, 1.1 * column.euler
    while high - low > 1e-3 * column.euler:
        middle = (low + high) / 2
        column.solve(middle)
        low, high = (middle, high) if is_stable(column.problem) else (low, middle)
    assert low == pytest.approx(column.euler, rel=5e-3)


@pytest.mark.parametrize(
    ("angle", "part", "x", "y"),
    [(20, 1.015, 0.970, 0.220), (60, 1.152, 0.741, 0.593), (120, 1.884, 0.123, 0.803)],
)
def test_elastica(angle: int, part: float, x: float, y: float) -> None:
    """Place of the end over the length, by the force over Euler's.

    Timoshenko and Gere, *Theory of Elastic Stability*, 1961, Table 2-4, by the angle of the end;
    its three digits of the force leave the smallest deflection to 2 %. Strains are below 2 %.
    """
    column = Column((40, 2), "quadratic")
    settings = column.settings
    report = with_stability(column.problem, column.solve(part * column.euler), settings)
    assert report.solved
    assert report.stable
    along, across = column.end_displacement() / LENGTH
    assert 1 + along == pytest.approx(x, abs=0.015)
    assert abs(across) == pytest.approx(y, rel=0.02 if angle > 20 else 0.04)
    turned = column.problem.displacement()[column.end]
    high, low = turned[column.x[column.end, 1].argmax()], turned[column.x[column.end, 1].argmin()]
    slope = np.arctan2(*((low - high) + [0, -HEIGHT]) * [1, -1])
    assert abs(np.degrees(slope)) == pytest.approx(angle, abs=2.5)


def test_kept_below_the_critical_load() -> None:
    """The straight state, and no iteration more than without a check."""
    column = Column((20, 2))
    report = column.solve(0.9 * column.euler)
    assert with_stability(column.problem, report, column.settings) is report


@pytest.mark.parametrize(
    ("stability", "solved", "text"), [("fail", False, UNSTABLE), ("allow", True, "CONVERGED")]
)
def test_refused_or_kept(stability: str, solved: bool, text: str) -> None:
    column = Column((20, 2))
    before = column.solve(3 * column.euler)
    straight = column.problem.displacement()
    settings = SolverSettings.model_validate({"stability": stability})
    report = with_stability(column.problem, before, settings)
    assert (report.solved, report.stable) == (solved, False)
    assert text in report.explanation
    assert report.load_factor == 1.0
    np.testing.assert_array_equal(column.problem.displacement(), straight)


def test_mirror_image_by_the_seed() -> None:
    """Ten imperfections lead to one state or its mirror image, to both of them; repeatably."""
    column = Column((20, 2))
    mirror = [
        np.flatnonzero(np.isclose(column.x, [a, HEIGHT - b]).all(axis=1))[0] for a, b in column.x
    ]
    found = []
    for seed in (*range(10), 0):
        settings = column.settings.model_copy(update={"imperfection": seed})
        assert with_stability(column.problem, column.solve(4 * column.euler), settings).solved
        found.append(column.problem.displacement())
    assert np.array_equal(found[-1], found[0])
    ups = [displacement[column.end, 1].mean() > 0 for displacement in found]
    assert 0 < sum(ups) < len(ups)
    for displacement, up in zip(found, ups, strict=True):
        same = displacement if up == ups[0] else displacement[mirror] * [1, -1]
        np.testing.assert_allclose(same, found[0], atol=1e-6)


@pytest.mark.parametrize(
    ("element", "simplices", "elements", "linear_solver"),
    [
        ("linear", True, (12, 2), "multigrid"),
        ("quadratic", True, (6, 1), "corotated"),
        ("incompressible", False, (12, 2), "corotated"),
        ("incompressible", True, (6, 1), "lu"),
        ("linear", False, (8, 1, 1), "corotated"),
        ("incompressible", True, (4, 1, 1), "corotated"),
    ],
)
def test_left_with_every_element(
    element: Element, simplices: bool, elements: tuple[int, ...], linear_solver: LinearSolver
) -> None:
    """The end moves sideways, by a tenth of the length at least; the energy is less."""
    column = Column(elements, element, simplices, linear_solver, ratio=0.3)
    report = column.solve(15 * column.euler)
    assert not is_stable(column.problem)
    energy = column.problem.potential()
    found = with_stability(column.problem, report, column.settings)
    assert found.solved
    assert found.stable
    assert found.left
    assert found.residual_norm <= column.problem.tolerance()
    assert found.newton_iterations > report.newton_iterations
    assert np.linalg.norm(column.end_displacement()[1:]) > LENGTH / 10
    assert column.problem.potential() < energy


def test_failure_is_said(monkeypatch: pytest.MonkeyPatch) -> None:
    """Without steps no state is found; the unstable one is kept."""
    monkeypatch.setattr("datagen.stability.STEPS", 1)
    column = Column((20, 2))
    before = column.solve(3 * column.euler)
    straight = column.problem.displacement()
    report = with_stability(column.problem, before, column.settings)
    assert (report.solved, report.explanation) == (False, NOT_LEFT)
    np.testing.assert_array_equal(column.problem.displacement(), straight)


def test_pressure_that_turns_with_the_end() -> None:
    """It has no static buckling (Beck 1952), though the symmetric part of K is not definite.

    All eigenvalues are positive at ten times Euler's load. A dead force beside it, above Euler's,
    buckles the column; then the straight state is left.
    """
    raw = box((LENGTH, HEIGHT), (20, 2), False)
    x = raw.coordinates
    facets = outward_facets(x, raw.cells, raw.cell_type)
    end = facets[(x[facets][:, :, 0] == LENGTH).all(axis=1)]
    mesh, settings = distributed(raw, MPI.COMM_SELF), SolverSettings()
    material = NeoHookean(young_modulus=MODULUS, poisson_ratio=0.0)
    problem = EquilibriumProblem(
        mesh, material, x[:, 0] == 0, settings, following=[PressedSurface(end)]
    )
    euler = np.pi**2 * MODULUS * HEIGHT**3 / 12 / (4 * LENGTH**2)
    nodes = np.unique(end)
    dead = np.tile([-1.0, 0.0], (len(nodes), 1)) / len(nodes)
    for force, pressure, stable in ((0.0, 10 * euler / HEIGHT, True), (3 * euler, 1e-3, False)):
        load = nodes, force * dead, settings, pressed([pressure])
        report = solve_load_case(problem, *load)
        assert report.solved
        factor = SymmetricFactor(problem)
        factor.close()
        assert factor.excess > 0
        assert is_stable(problem) == stable
        found = with_stability(problem, report, settings)
        assert found.solved
        assert found.stable
        assert np.abs(problem.displacement()[:, 1]).max() > LENGTH / 10 or stable


@pytest.fixture(scope="module")
def loads(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Nine forces of −16, −12 … 16 N along the axis; the beam buckles at 8.8 N."""
    x = Box(lower=(0, 0), upper=(4, 1), elements=(15, 3)).raw_mesh().coordinates
    forces = np.zeros((9, *x.shape))
    forces[:, x[:, 0] == 4, 0] = np.linspace(-4, 4, 9)[:, None]
    path = tmp_path_factory.mktemp("loads") / "axial.h5"
    write_load_cases(path, LoadCases.of(x, forces), "quad")
    return path


@pytest.fixture(scope="module")
def run(loads: Path) -> Runner:
    def run_axial(out: Path, *changes: str) -> Manifest:
        # the region of the given loads is the whole body but for the support
        return datagen.run(
            "beam2d", out, loads=loads, changes=(*SHARDS, *changes), comm=MPI.COMM_SELF
        )

    return run_axial


@pytest.fixture(scope="module")
def followed(run: Runner, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("followed") / "nodal"
    run(folder)
    return folder


def samples(folder: Path) -> Arrays:
    names = ("samples/number", "samples/displacement", "samples/stable")
    return DatasetReader(folder).joined(names)


def test_followed(followed: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """−16 and −12 N buckle the beam, all others leave it straight; every state is stable."""
    found = samples(followed)
    assert found["samples/stable"].all()
    sideways = np.abs(found["samples/displacement"][:, -1, 1])
    assert (sideways[:2] > 1.0).all()
    assert (sideways[2:] < 0.1).all()
    manifest = DatasetReader(followed).manifest
    assert manifest.solver is not None
    assert (manifest.solver.stability, manifest.solver.imperfection) == ("follow", 0)
    assert "stability" not in manifest.case["solver"]  # so older cases keep their digest
    assert main(["check", str(followed)]) == 0
    assert "unstable" not in capsys.readouterr().out
    assert datagen.info(followed)["stability"] == "no unstable samples"


def test_mirror_images_by_the_imperfection(followed: Path, run: Runner, tmp_path: Path) -> None:
    """All samples of a dataset lie on one branch; some seed below 10 gives the other one."""
    ups = set()
    for seed in range(10):
        run(tmp_path / str(seed), f"solver.imperfection={seed}")
        sideways = samples(tmp_path / str(seed))["samples/displacement"][:2, -1, 1]
        assert abs(np.sign(sideways).sum()) == 2
        ups.add(bool(sideways[0] > 0))
        if len(ups) == 2:
            break
    assert len(ups) == 2


def test_allowed(run: Runner, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """The straight states are recorded; `check` and `info` name them, also on the grid."""
    run(tmp_path / "nodal", "solver.stability=allow")
    datagen.add_noise(tmp_path / "nodal", tmp_path / "noisy", relative=0.1, threshold=1.0, seed=1)
    structure(tmp_path / "nodal", tmp_path / "grid")
    structure(tmp_path / "nodal", tmp_path / "embedded", grid=(9, 4))
    for name in ("nodal", "noisy", "grid", "embedded"):
        assert main(["check", str(tmp_path / name)]) == 0
        assert "intact; 2 unstable samples, numbers 0, 1" in capsys.readouterr().out
        assert datagen.info(tmp_path / name)["stability"] == "2 unstable samples, numbers 0, 1"
    found = samples(tmp_path / "nodal")
    assert found["samples/stable"].tolist() == [False] * 2 + [True] * 7
    assert np.abs(found["samples/displacement"][:, -1, 1]).max() < 0.1


def test_failed(run: Runner, tmp_path: Path) -> None:
    manifest = run(tmp_path / "nodal", "solver.stability=fail")
    assert (manifest.samples, manifest.failed) == (7, 2)
    failed = DatasetReader(tmp_path / "nodal").joined(("failed/number", "failed/reason"))
    assert failed["failed/number"].tolist() == [0, 1]
    assert set(failed["failed/reason"]) == {"unstable equilibrium"}


def test_one_load(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Four forces of −5 N: the straight state has −1.31 J, the buckled one −36.5 J."""
    load = [f"4,{y}:-5,0" for y in ("0", "0.333333333333", "0.666666666667", "1")]
    straight = datagen.solve("beam2d", load, nearest=True, changes=["solver.stability=allow"])
    buckled = datagen.solve("beam2d", load, nearest=True)
    assert (straight.report.stable, buckled.report.stable) == (False, True)
    assert straight.largest_displacement == pytest.approx(0.137, abs=0.003)
    assert buckled.largest_displacement > 5.0
    line = ["solve", "beam2d", "--load", "4,0:-10,0", "--load", "4,1:-10,0", "--out"]
    assert main([*line, str(tmp_path / "buckled.npz")]) == 0
    assert "past an unstable equilibrium" in capsys.readouterr().out
    allowed = ["--set", "solver.stability=allow"]
    assert main([*line, str(tmp_path / "straight.npz"), *allowed]) == 0
    assert ", an unstable equilibrium" in capsys.readouterr().out
    with pytest.raises(WorkError, match=r"unstable equilibrium .*'solver.stability' = 'fail'"):
        datagen.solve("beam2d", load, nearest=True, changes=["solver.stability=fail"])


def test_datasets_of_earlier_versions(followed: Path, tmp_path: Path) -> None:
    """Without `samples/stable` a dataset is read as before, and nothing is said of it."""
    manifest, entries = DatasetReader(followed).manifest, []
    (tmp_path / "nodal").mkdir()
    for entry in manifest.shards:
        arrays = read_shard(followed / entry.file, "nodal")
        del arrays["samples/stable"]
        path = tmp_path / "nodal" / entry.file
        digest = write_shard(path, "nodal", arrays, manifest.case_digest, "quad")
        entries.append(entry.model_copy(update={"sha256": digest}))
    stiffness = (followed / "stiffness.h5").read_bytes()
    (tmp_path / "nodal" / "stiffness.h5").write_bytes(stiffness)
    update = {"shards": tuple(entries)}
    write_manifest(tmp_path / "nodal", manifest.model_copy(update=update))
    assert datagen.check(tmp_path / "nodal") == []
    assert DatasetReader(tmp_path / "nodal").unstable() is None
    assert "stability" not in datagen.info(tmp_path / "nodal")
    structure(tmp_path / "nodal", tmp_path / "grid")
    assert datagen.check(tmp_path / "grid") == []


@pytest.mark.mpi
@pytest.mark.slow
@pytest.mark.parametrize("shared", [1, 2])
def test_same_on_two_ranks(followed: Path, loads: Path, tmp_path: Path, shared: int) -> None:
    """Two ranks find the same states, and the same mirror images, apart or in one solve."""
    out = tmp_path / "nodal"
    changes = [word for each in SHARDS for word in ("--set", each)]
    changes += ["--loads", str(loads), "--ranks-per-solve", str(shared)]
    result = finish(words("run", "beam2d", "--out", out, *changes, ranks=2))
    assert result.returncode == 0, result.stderr
    if shared == 1:
        assert_same(out, followed)
    one, two = samples(followed), samples(out)
    np.testing.assert_array_equal(one["samples/stable"], two["samples/stable"])
    np.testing.assert_allclose(
        one["samples/displacement"], two["samples/displacement"], rtol=0, atol=1e-6
    )
