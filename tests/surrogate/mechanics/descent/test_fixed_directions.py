"""Directions of exported files are those of `surrogate.mechanics.descent.descent`."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import torch

from shared_schema.common.errors import InputError
from surrogate.command_line import main
from surrogate.learning.data.dataset import Dataset
from surrogate.learning.inference.export import load_exported
from surrogate.learning.inference.loading import load
from surrogate.learning.training.loop import train
from surrogate.mechanics.certify.correction import correct
from surrogate.mechanics.descent import DrivenBody
from surrogate.mechanics.descent.directions import Directions
from surrogate.mechanics.descent.driven_body import longest
from surrogate.mechanics.descent.fixed_directions import FixedDirections
from surrogate.mechanics.equilibrium.linear_response import LinearResponse
from tests.surrogate.mechanics.bodies import MATERIAL, end_load
from tests.surrogate.mechanics.descent.test_carried_compliance import body_of


def in_turn(
    body: DrivenBody, force: np.ndarray, start: np.ndarray, count: int
) -> tuple[np.ndarray, float]:
    """Some directions one by one: displacement and length of the last one."""
    directions, state = Directions(body, force), body.state(start, force)
    assert state is not None
    for left in reversed(range(count)):
        d = directions.direction(state)
        if left == 0:
            return state.u + d, longest(d)
        taken = directions.step(state, d)
        assert taken is not None
        state = taken
    raise AssertionError(count)


@pytest.mark.parametrize(
    "kind", ["quad", "triangle, rollers", "hexahedron", "tetra, rollers", "triangle, zones"]
)
def test_the_same_directions(kind: str) -> None:
    """A load as it is, twice it, and none; from the linear response, and half of it from rest.

    Some steps are shortened, once, since the force along them turns round.
    """
    body = body_of(kind)
    driven, d = DrivenBody.of(body), body.geometry.dimension
    single = end_load(body.geometry, *(3.0, -9.0, 5.0)[:d]) * body.free
    forces = np.stack([single, 2 * single, 0 * single, single / 2])
    starts = body.linear_response(forces / 3)
    starts[3] = 0
    response = LinearResponse(body.geometry, body.solid.materials, False, torch.float64)
    for count in (1, 6):
        fixed = FixedDirections(body, response, count)
        found, estimates = fixed(torch.from_numpy(forces), torch.from_numpy(starts))
        assert not found[2].any()
        assert estimates[2] == 0
        for row in (0, 1, 3):
            u, estimate = in_turn(driven, forces[row], starts[row], count)
            np.testing.assert_allclose(found[row], u, atol=1e-9 * longest(u))
            assert estimates[row] == pytest.approx(estimate, rel=1e-6)
    truth = correct(body, single, found[0].numpy()).displacement
    assert longest(found[0].numpy() - truth) < 3e-2 * longest(truth)


def test_two_materials() -> None:
    """Directions whose steps are shortened once at most."""
    body = body_of("quad, two materials")
    forces = np.stack([end_load(body.geometry, 3.0, -9.0) * body.free])
    starts = body.linear_response(forces / 3)
    response = LinearResponse(body.geometry, body.solid.materials, False, torch.float64)
    found, _ = FixedDirections(body, response, 3)(*map(torch.from_numpy, (forces, starts)))
    u, _ = in_turn(DrivenBody.of(body), forces[0], starts[0], 3)
    np.testing.assert_allclose(found[0], u, atol=1e-9 * longest(u))


def test_no_step_inverts_cells() -> None:
    """A prediction with inverted cells has no estimate; large directions are cut."""
    body = body_of("quad")
    response = LinearResponse(body.geometry, MATERIAL, False, torch.float64)
    force = 60 * end_load(body.geometry, 3.0, -9.0)[None] * body.free
    forces = torch.from_numpy(np.concatenate([force, force]))
    starts = torch.zeros_like(forces)
    starts[1] = torch.from_numpy(-3 * body.geometry.coordinates * body.free)
    assert body.inverted(body.linear_response(force))[0]
    found, estimates = FixedDirections(body, response, 3)(forces, starts)
    assert not body.inverted(found[:1].numpy())[0]
    assert 0 < estimates[0] < torch.inf
    assert estimates[1] == torch.inf


def test_refused_bodies() -> None:
    for kind, count, message in [
        ("quad", 0, "directions 0: expected 1 to 100"),
        (
            "quad, points between",
            2,
            "directions 2: expected a body of linear elements, under dead",
        ),
        ("quad, mean dilation", 2, "linear elements"),
    ]:
        body = body_of(kind)
        response = LinearResponse(body_of("quad").geometry, MATERIAL, False, torch.float64)
        with pytest.raises(InputError, match=message):
            FixedDirections(body, response, count)


@pytest.mark.slow
def test_exported(dataset: Dataset, tmp_path: Path) -> None:
    """The file of a linear response; two directions reduce its error thirty times."""
    run, path = tmp_path / "run", tmp_path / "model.onnx"
    model = train({"model": "series", "series_order": 1}, dataset, run)
    options = ["--format", "onnx", "--out", str(path), "--directions", "2"]
    assert main(["export", str(run), *options]) == 0
    model = load(run)
    force = np.zeros((1, *model.geometry.coordinates.shape), np.float32)
    force[0, np.flatnonzero(model.geometry.loadable)[-1]] = 0.5, -1.5
    found = load_exported(path)(torch.from_numpy(force))
    assert list(found) == ["displacement", "estimate"]
    nodal = force[0].astype(np.float64)
    plain = model.predict(nodal)
    u, estimate = in_turn(model.body.driven_body, nodal, plain, 2)
    np.testing.assert_allclose(found["displacement"][0], u, atol=1e-6 * longest(u))
    assert float(found["estimate"][0]) == pytest.approx(estimate, rel=1e-3)
    truth = model.correct(nodal).displacement
    assert longest(u - truth) < longest(plain - truth) / 30
