"""Cables and chambers in equilibrium: beam theory, other controls of one state, several ranks."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
import yaml
from mpi4py import MPI

import datagen
from datagen.cases.body import make_body
from datagen.cases.case import read_case
from datagen.mesh.distributed_mesh import distributed
from datagen.output.nodal_samples import NodalSamples
from datagen.solver.equilibrium import EquilibriumProblem
from datagen.solver.following_loads import found_actuation
from datagen.solver.load_stepping import solve_load_case
from datagen.solver.settings import SolverSettings
from datagen.stability import with_stability
from shared_schema.actuators import (
    Control,
    PlacedActuators,
    actuators_of,
    placed_actuators,
    pressed,
)
from shared_schema.common.bodies.groups import RawMesh
from shared_schema.common.errors import InputError, WorkError
from shared_schema.materials import Gent, Material, NeoHookean
from tests.datagen.farm_runs import datagen as words
from tests.datagen.farm_runs import finish
from tests.shared_schema.test_actuators import hollow

FOLLOWS = SolverSettings(linear_solver="lu")
NOTHING = np.empty(0, dtype=int), np.empty((0, 3))
LENGTH, HEIGHT, OFFSET, YOUNG = 1.0, 0.05, 0.02, 1e6
MATERIAL = {"young_modulus": YOUNG, "poisson_ratio": 0.0}
PLACES = [[x, OFFSET] for x in np.linspace(0, LENGTH, 21).tolist()]
BEAM: dict[str, Any] = {
    "name": "beam",
    "mesh": {
        "kind": "box",
        "lower": [0, -HEIGHT / 2],
        "upper": [LENGTH, HEIGHT / 2],
        "elements": [40, 2],
    },
    "material": MATERIAL,
    "element": "quadratic",
    "supports": [{"x": 0}],
    "actuators": {"top": {"cable": PLACES, "tension": [0, 5]}},
    "dataset": {"samples": 3, "seed": 1},
}
CHAMBER = """
SetFactory("OpenCASCADE");
Box(1) = {0, 0, 0, 4, 4, 4};
Box(2) = {1, 1, 1, 2, 2, 2};
BooleanDifference(3) = { Volume{1}; Delete; }{ Volume{2}; Delete; };
Physical Volume("body") = {3};
inner[] = Surface In BoundingBox {0.9, 0.9, 0.9, 3.1, 3.1, 3.1};
Physical Surface("cavity") = {inner[]};
Physical Surface("base") = Surface In BoundingBox {-1, -1, -0.1, 5, 5, 0.1};
Mesh.MeshSizeMin = 1.2;
Mesh.MeshSizeMax = 1.2;
"""


def chamber(folder: Path, **control: Any) -> dict[str, Any]:
    """A cube with a cubic cavity of 8 m³."""
    script = folder / "chamber.geo"
    script.write_text(CHAMBER)
    return {
        "name": "chamber",
        "mesh": {"kind": "file", "path": str(script)},
        "material": {"young_modulus": 1e5, "poisson_ratio": 0.3},
        "supports": [{"group": "base"}],
        "actuators": {"air": {"chamber": "cavity", **(control or {"pressure": [0, 2e4]})}},
        "dataset": {"samples": 2, "seed": 1},
    }


def test_a_cable_beside_the_axis_bends_a_beam_to_a_circle() -> None:
    """Curvature T d / (E I).

    The compression is T / (E A) = 0.3 %; between its points the cable is the chord of the circle,
    which is nearer to the axis by 0.3 % of d in the mean.
    """
    tension = 150.0
    found = datagen.solve(BEAM, actuate=[f"top={tension}"])
    axis = np.isclose(found.coordinates[:, 1], 0.0)
    x, y = (found.coordinates + found.displacement)[axis].T
    curvature = tension * OFFSET / (YOUNG * HEIGHT**3 / 12)
    assert curvature == pytest.approx(0.288)
    a = np.column_stack([2 * x, 2 * y, np.ones_like(x)])
    centre_x, centre_y, rest = np.linalg.lstsq(a, x**2 + y**2, rcond=None)[0]
    radius = np.sqrt(rest + centre_x**2 + centre_y**2)
    assert np.abs(np.hypot(x - centre_x, y - centre_y) / radius - 1).max() < 2e-4
    assert 1 / radius == pytest.approx(curvature, rel=1e-2)
    assert np.abs(found.reactions.sum(axis=0)).max() < 1e-9  # the cable pulls at the body alone


def test_length_and_tension_give_the_same_state() -> None:
    pulled = datagen.solve(BEAM, actuate=["top=150"])
    tension, length = pulled.actuators["top"].amplitude, pulled.actuators["top"].quantity
    assert tension == 150.0
    drawn = datagen.solve(BEAM, actuate=[f"top.length={length!r}"])
    assert drawn.actuators["top"].amplitude == pytest.approx(150.0, rel=1e-7)
    np.testing.assert_allclose(drawn.displacement, pulled.displacement, atol=1e-8)
    slack = datagen.solve(BEAM, ["1,0:0,0.01"], actuate=["top.length=1.5"])
    free = datagen.solve(BEAM, ["1,0:0,0.01"])
    assert slack.actuators["top"].amplitude == 0.0
    np.testing.assert_allclose(slack.displacement, free.displacement, atol=1e-9)


def test_length_and_tension_give_the_same_state_beside_a_tool() -> None:
    wall = "plane:0,0.06:0,-1"  # the beam bends up to it
    pulled = datagen.solve(BEAM, actuate=["top=150"], tool=wall)
    assert pulled.contact is not None
    assert pulled.contact.force.sum(axis=0)[1] < -0.1
    length = pulled.actuators["top"].quantity
    drawn = datagen.solve(BEAM, actuate=[f"top.length={length!r}"], tool=wall)
    assert drawn.actuators["top"].amplitude == pytest.approx(150.0, rel=1e-6)
    np.testing.assert_allclose(drawn.displacement, pulled.displacement, atol=1e-8)


def test_pressure_volume_and_gas_give_the_same_state(tmp_path: Path) -> None:
    """A gas of (A + v) V₀ = (A + p) V; the volume at rest is 8 m³."""
    case = chamber(tmp_path, pressure=[0, 2e4], ambient=1e5)
    blown = datagen.solve(case, actuate=["air=2e4"])
    volume = blown.actuators["air"].quantity
    assert volume > 8.2
    filled = datagen.solve(case, actuate=[f"air.volume={volume!r}"])
    amount = (1e5 + 2e4) * volume / 8 - 1e5
    gas = datagen.solve(case, actuate=[f"air.gas={amount!r}"])
    for other in (filled, gas):
        assert other.actuators["air"].amplitude == pytest.approx(2e4, rel=1e-7)
        np.testing.assert_allclose(other.displacement, blown.displacement, atol=1e-8)
    sucked = datagen.solve(case, actuate=["air=-1e4"])
    assert sucked.actuators["air"].quantity < 8.0
    assert np.linalg.norm(blown.force.sum(axis=0)) < 1e-9 * np.abs(blown.force).sum()


def test_a_closed_gas_holds_a_body_back(tmp_path: Path) -> None:
    """p V = const: A V₀ = (A + p) V under another load."""
    case = chamber(tmp_path, gas=[-10, 10], ambient=1e5)
    pushed = datagen.solve(case, ["body:0,0,-2e5"], actuate=["air=0"])
    pressure, volume = pushed.actuators["air"].amplitude, pushed.actuators["air"].quantity
    assert volume < 7.9
    assert (1e5 + pressure) * volume == pytest.approx(8e5, rel=1e-8)


def test_a_chamber_is_no_cable(tmp_path: Path) -> None:
    content = chamber(tmp_path)
    content["actuators"] = {"air": {"chamber": "base", "pressure": [0, 1]}}
    with pytest.raises(InputError, match=r"case 'chamber': key 'actuators.air.chamber'.*open"):
        make_body(read_case(content), MPI.COMM_SELF)
    content["actuators"] = {"air": {"chamber": "cavity", "pressure": [1, 0]}}
    with pytest.raises(InputError, match=r"actuators\.air.pressure.*low < high"):
        read_case(content)
    with pytest.raises(InputError, match="load"):
        read_case({name: value for name, value in content.items() if name != "actuators"})


def test_a_chamber_that_closes_ends_with_a_word(tmp_path: Path) -> None:
    with pytest.raises(WorkError, match="walls of the chamber 'air' pass through"):
        datagen.solve(chamber(tmp_path), actuate=["air.volume=1e-9"])


def test_a_dataset_holds_what_is_given_and_found(tmp_path: Path) -> None:
    """The recorded forces are those of the found amplitudes on the undeformed body."""
    case = chamber(tmp_path, gas=[-2e4, 2e4], ambient=1e5)
    rope = [{"fixed": [2, 2, -1]}, [0.5, 0.5, 0.5], [0.5, 0.5, 3.5], [3.5, 3.5, 3.5]]
    case["actuators"]["rope"] = {"cable": rope, "length": [9, 9.9]}
    datagen.run(case, tmp_path / "run")
    samples = NodalSamples(tmp_path / "run")
    with h5py.File(tmp_path / "run" / "shard-00000.h5") as file:
        given, found, sizes = (
            file[f"samples/{name}"][:] for name in ("actuation", "amplitude", "quantity")
        )
    assert samples.actuators.names == ("air", "rope")
    for row, number in enumerate(samples.numbers):
        sample, actuators = samples[number], samples.actuators
        np.testing.assert_array_equal(given[row], actuators.draw(number, case["dataset"]["seed"]))
        at_rest = actuators.forces_at_rest(found[row], samples.coordinates)
        at_rest[samples.held] = 0.0
        np.testing.assert_allclose(sample.force, at_rest, atol=1e-12 * np.abs(at_rest).max())
        deformed = samples.coordinates + sample.displacement
        for size, load in zip(sizes[row], actuators.loads, strict=True):
            assert load.quantity(deformed) == pytest.approx(size, rel=1e-12)
        amount = (1e5 + given[row, 0]) * actuators.rest[0]
        assert (1e5 + found[row, 0]) * sizes[row, 0] == pytest.approx(amount, rel=1e-8)
        assert sizes[row, 1] == pytest.approx(given[row, 1], rel=1e-8)
    said = datagen.info(tmp_path / "run")
    assert said["actuator air"].startswith("gas ")
    assert said["actuator rope"].startswith("length 9.")
    assert datagen.plot(tmp_path / "run", tmp_path / "figure.png")
    made = datagen.structure(tmp_path / "run", tmp_path / "grid", grid="nodes")
    with h5py.File(tmp_path / "grid" / made.shards[0].file) as file:
        np.testing.assert_array_equal(file["samples/amplitude"][:], found)
    assert datagen.check(tmp_path / "run") == datagen.check(tmp_path / "grid") == []


def shell(material: Material) -> tuple[EquilibriumProblem, PlacedActuators]:
    """A cube of 4³ cells with a cavity of 2³, which rolls on its lower side."""
    body = hollow(4)
    actuators = placed_actuators(actuators_of({"air": {"chamber": "hole", "volume": [8, 9]}}), body)
    mesh = distributed(RawMesh(body.coordinates, body.cells, body.cell_type), MPI.COMM_SELF)
    known = mesh, material, body.coordinates[:, 2] == 0, FOLLOWS
    return EquilibriumProblem(*known, "incompressible", following=actuators.loads), actuators


def test_volumes_lead_beyond_the_largest_pressure() -> None:
    """A balloon of Neo-Hooke has a largest pressure: about 0.308 E here, at 7 times its volume."""
    problem, actuators = shell(NeoHookean(young_modulus=1.0, poisson_ratio=0.45))
    pressures = []
    for volume in (24.0, 56.0, 96.0):
        filled = [Control("volume", volume, rest=actuators.rest[0])]
        report = solve_load_case(problem, *NOTHING, FOLLOWS, filled)
        assert report.solved
        assert with_stability(problem, report, FOLLOWS).stable  # the volume holds it
        pressures.append(float(found_actuation(problem, 1)[0, 0]))  # type: ignore[index]
    assert pressures[0] < pressures[2] < pressures[1] == pytest.approx(0.308, rel=0.01)


@pytest.mark.slow
def test_a_pressure_beyond_a_limit_point_is_reached_in_steps_of_volume() -> None:
    """Gent's solid stiffens: beyond its largest pressure and a smallest, the pressure rises."""
    problem, actuators = shell(Gent(model="gent", shear_modulus=0.345, bulk_modulus=3.3, limit=24))
    report = solve_load_case(problem, *NOTHING, FOLLOWS, pressed([0.312]))
    assert report.solved
    assert report.residual_norm <= problem.tolerance()
    pressure, volume = found_actuation(problem, 1)[0]  # type: ignore[index]
    assert pressure == 0.312
    assert volume > 20 * actuators.rest[0]  # the largest pressure has 8 times that at rest


@pytest.mark.mpi
@pytest.mark.slow
def test_same_on_two_ranks(tmp_path: Path) -> None:
    case = chamber(tmp_path, volume=[8, 9])
    rope = [{"fixed": [2, 2, -1]}, [0.5, 0.5, 0.5], [0.5, 0.5, 3.5], [3.5, 3.5, 3.5]]
    case["actuators"]["rope"] = {"cable": rope, "length": [9, 9.9]}
    (tmp_path / "case.yaml").write_text(yaml.safe_dump(case))
    given = [*("--actuate", "air=9"), *("--actuate", "rope=9.5")]
    found = []
    for ranks in (0, 2):
        out = tmp_path / f"{ranks}.npz"
        done = finish(words("solve", tmp_path / "case.yaml", *given, "--out", out, ranks=ranks))
        assert done.returncode == 0, done.stderr
        assert "rope: tension" in done.stdout
        with np.load(out) as fields:
            found.append(fields["displacement"])
    np.testing.assert_allclose(found[1], found[0], rtol=0, atol=1e-9)


@pytest.mark.slow
def test_shipped_actuators() -> None:
    """Chambers under 20 kPa bend the actuator down, away from them; a cable bends the trunk."""
    chambers = [f"{name}=2e4" for name in ("root", "middle", "tip")]
    bent = datagen.solve("actuator3d", actuate=chambers)
    assert 2000 <= len(bent.coordinates) <= 4000
    assert bent.displacement[bent.coordinates[:, 0].argmax(), 2] < -0.015
    for actuated in bent.actuators.values():
        assert actuated.quantity > 2 * 24e-3 * 14e-3 * 8e-3
    pulled = datagen.solve("trunk3d", actuate=["tip1=5"])
    assert 2000 <= len(pulled.coordinates) <= 4000
    tip = np.isclose(pulled.coordinates[:, 2], 0.3)
    assert pulled.displacement[tip, 0].mean() > 0.03
    assert abs(pulled.displacement[tip, 1].mean()) < 1e-5  # y = 0 is a plane of symmetry
