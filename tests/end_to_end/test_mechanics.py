"""Energy, forces and tangents of the learner's solid are those of the factory's."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import torch
from scipy.sparse import coo_array, csr_array

from shared_schema.materials import VOLUMETRIC_TERMS, NeoHookean, Volumetric
from surrogate.mechanics.solids.mixed_elements import MeanDilationSolid
from surrogate.mechanics.solids.solid import Solid
from tests.end_to_end.commands import DATAGEN, execute

# writes the states of bodies under a smooth displacement plus noise, as dolfinx assembles them
FACTORY = """
import sys
import numpy as np
from mpi4py import MPI
from datagen.cases.body import make_body
from datagen.cases.case import read_case

def write_state(name, volumetric, element, out):
    case = read_case(name, volumetric=volumetric).model_copy(update={"element": element})
    body = make_body(case, MPI.COMM_SELF)
    x, problem = body.mesh.coordinates, body.problem
    size, rng = np.ptp(x, axis=0).max(), np.random.default_rng(0)
    spacing = size / len(x) ** (1 / x.shape[1])
    u = 0.2 * (x / size) ** 2 * size * rng.normal(size=x.shape[1])
    u += 0.02 * spacing * rng.normal(size=x.shape)
    u[body.clamped] = 0
    problem.set_displacement(u)
    assert problem._min_j.value() > 0.2
    d, nodes = problem.dimension, problem.numbering.node_of_block
    number = (nodes[:, None] * d + np.arange(d)).ravel()
    indptr, indices, data = problem.tangent().getValuesCSR()
    row = number[np.repeat(np.arange(len(number)), np.diff(indptr))]
    np.savez(out, coordinates=x, cells=body.mesh.cells, cell_type=body.mesh.cell_type,
             clamped=body.clamped, u=u, reactions=problem.reactions(), energy=problem.energy(),
             row=row, column=number[indices], tangent=data)

for words in sys.argv[1:]:
    write_state(*words.split("\\t"))
"""
WHOLE = ("beam2d", "lshape2d", "beam3d")  # their cells' volumes may change as a whole
FINGER = str(Path(__file__).parent / "bodies" / "notched_finger.yaml")
MATERIALS = dict.fromkeys(("beam2d", "lshape2d", "plate2d", "beam3d"), (500.0, 0.4)) | {
    FINGER: (5e5, 0.4)
}


SOLIDS = [*((case, Solid) for case in MATERIALS), *((c, MeanDilationSolid) for c in WHOLE)]
ELEMENTS = {Solid: "linear", MeanDilationSolid: "incompressible"}


@pytest.fixture(scope="module")
def states(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder of the states of all bodies, made by one process."""
    folder = tmp_path_factory.mktemp("states")
    wanted = [
        f"{case}\t{volumetric}\t{ELEMENTS[kind]}\t{folder / state_of(case, kind, volumetric)}"
        for case, kind in SOLIDS
        for volumetric in VOLUMETRIC_TERMS
    ]
    execute(DATAGEN.parent / "python", "-c", FACTORY, *wanted)
    return folder


def state_of(case: str, kind: type[Solid], volumetric: Volumetric) -> str:
    """Name of the file with the state of a body."""
    return f"{Path(case).stem}-{kind.__name__}-{volumetric}.npz"


@pytest.mark.slow
@pytest.mark.parametrize("volumetric", VOLUMETRIC_TERMS)
@pytest.mark.parametrize(("case", "kind"), SOLIDS)
def test_the_two_programs_have_one_solid(
    case: str, kind: type[Solid], volumetric: Volumetric, states: Path
) -> None:
    """All cells, `incompressible` ones too: forces to 1e-10, tangents to 1e-9."""
    with np.load(states / state_of(case, kind, volumetric)) as body:
        young, poisson = MATERIALS[case]
        material = NeoHookean(young_modulus=young, poisson_ratio=poisson, volumetric=volumetric)
        cells = body["cells"].astype(np.int64)
        solid = kind(body["coordinates"], cells, str(body["cell_type"]), material)
        u = torch.from_numpy(body["u"])[None]
        assert solid.inverted(u) == 0
        assert solid.energy(u).item() == pytest.approx(float(body["energy"]), rel=1e-12)
        forces, expected = solid.internal_forces(u)[0].numpy(), body["reactions"]
        assert np.abs(forces - expected).max() < 1e-10 * np.abs(expected).max()

        d, size = u.shape[2], u.numel()
        dofs = (cells[:, :, None] * d + np.arange(d)).reshape(len(cells), -1)
        entries = solid.compiled.cell_tangents(u.numpy())[0].numpy()
        rows, columns = np.broadcast_arrays(dofs[:, :, None], dofs[:, None, :])
        found = coo_array((entries.ravel(), (rows.ravel(), columns.ravel())), shape=(size, size))
        place = body["row"], body["column"]
        reference = csr_array((body["tangent"], place), shape=(size, size))
        free = np.flatnonzero(np.repeat(~body["clamped"], d))
        found, reference = (matrix.tocsr()[free][:, free] for matrix in (found, reference))
        assert abs(found - reference).max() < 1e-9 * abs(reference).max()
