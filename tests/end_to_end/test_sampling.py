"""Samples of the learner are those of the factory, on small variants of the shipped cases."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from shared_schema.dataset_reader import DatasetReader
from tests.end_to_end.commands import DATAGEN, SURROGATE, execute

NAMES = ("number", "loaded_nodes", "force", "displacement")
EXACT = ("--set", "solver.tolerance=1e-10")  # what Newton's method leaves is not compared
CASES = {
    "beam2d": EXACT,
    "beam2d_any": EXACT,
    "lshape2d": EXACT,
    "plate2d": EXACT,
    "plate2d_shapes": EXACT,
    "beam2d_sweep": EXACT,
    "beam3d": (*EXACT, "--set", "mesh.elements=[8,3,3]"),
    "beam3d_any": (*EXACT, "--set", "mesh.elements=[8,3,3]"),
}
CLOSE = ("--set", "solver.relative_tolerance=1e-11")
OTHERS = {
    "beam2d_places": ("--set", "element=quadratic"),
    "breast3d": CLOSE,
    "finger3d": (),
    "liver3d_touch": CLOSE,
}


@pytest.mark.parametrize(
    "case", [*CASES, *(pytest.param(name, marks=pytest.mark.slow) for name in OTHERS)]
)
def test_the_same_samples(case: str, tmp_path: Path) -> None:
    """Loads to the last bit, displacements to 1e-8 of the largest; structured and read alike."""
    changes, count = (CASES | OTHERS)[case], "10" if case in CASES else "4"
    body, theirs, ours = (tmp_path / name for name in ("body", "theirs", "ours"))
    execute(DATAGEN, "body", case, *changes, "--out", body)
    execute(DATAGEN, "run", case, *changes, "--samples", count, "--out", theirs)
    execute(SURROGATE, "sample", body, "--count", count, "--out", ours)
    execute(DATAGEN, "check", ours)
    readers = [DatasetReader(folder, "nodal") for folder in (theirs, ours)]
    shapes = ("parameters", "coordinates") if "shapes" in case else ()
    names = [f"samples/{name}" for name in (*NAMES, *shapes)]
    a, b = (reader.joined(names) for reader in readers)
    for name in shapes:
        assert np.allclose(a[f"samples/{name}"], b[f"samples/{name}"], rtol=0, atol=1e-14)
    for name in NAMES[:-1]:
        scale = np.abs(a[f"samples/{name}"]).max()
        assert np.allclose(a[f"samples/{name}"], b[f"samples/{name}"], rtol=0, atol=1e-12 * scale)
    u, v = a["samples/displacement"], b["samples/displacement"]
    assert (np.abs(u - v).max((1, 2)) < 1e-8 * np.abs(u).max((1, 2))).all()
    assert readers[0].manifest.case_digest == readers[1].manifest.case_digest
    for folder in (theirs, ours):
        execute(DATAGEN, "structure", folder, "--out", folder.with_suffix(".grid"))
