r"""Rigid motions that the supports of a body, and the connections of its parts, leave free.

Cells that share a facet move together as one rigid part: u = t + ω × x on each. Parts that share
single nodes or an edge only, as by a hinge, have the same displacement there,

.. math:: t_p + ω_p × x = t_q + ω_q × x, \quad \text{and } t_p + ω_p × x = 0

in the held components. The body is held if these equations have the zero solution only.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from shared_schema.common.bodies.cells import components, parts_of
from shared_schema.common.bodies.groups import RawMesh

Array = NDArray[np.float64]
Ints = NDArray[np.int64]
FREE = 1e-6  # singular value of a motion that nothing holds


def motion_problem(mesh: RawMesh, held: NDArray[np.bool_]) -> str | None:
    """Say which part of a body can move without a strain; None if none can.

    Parameters
    ----------
    mesh : RawMesh
    held : array of bool, (n_nodes, d)
        Components of displacement that supports hold.
    """
    x, count = mesh.coordinates, len(mesh.coordinates)
    first = np.repeat(mesh.cells[:, 0], mesh.cells.shape[1])
    body = components(first, mesh.cells.ravel(), count)
    loose = np.flatnonzero(~np.isin(body, body[held.any(axis=1)]))
    if loose.size:
        at = _at(x[loose[0]])
        return f"{loose.size} nodes are not connected to a clamped one, the first at {at}"
    part_of_cell = parts_of(mesh.cells, mesh.cell_type)
    pairs = np.unique(
        np.stack([mesh.cells.ravel(), np.repeat(part_of_cell, mesh.cells.shape[1])]), axis=1
    )
    node, part = pairs[:, np.argsort(pairs[1], kind="stable")]
    members = np.split(node, np.flatnonzero(np.diff(part)) + 1)
    shared = np.bincount(node, minlength=count) > 1
    for nodes in members:
        if _can_move(x[nodes], held[nodes] | shared[nodes, None]):
            return _moving(x, nodes, shared)
    body_of_part = body[[nodes[0] for nodes in members]]
    several = np.flatnonzero(np.bincount(body_of_part, minlength=1) > 1)
    for number in several:
        together = [members[part] for part in np.flatnonzero(body_of_part == number)]
        moving = _moving_part(x, held, together)
        if moving is not None:
            return _moving(x, together[moving], shared)
    return None


def rigid_modes(positions: Array) -> Array:
    """Displacements of the rigid motions of a part, rotations about its middle.

    Parameters
    ----------
    positions : array, (n_nodes, d)
        In m; the modes have no unit, lengths are relative to the size of the part.

    Returns
    -------
    array, (n_nodes, d, 3 or 6)
    """
    count, d = positions.shape
    x = (positions - positions.mean(axis=0)) / max(float(np.ptp(positions, axis=0).max()), 1e-300)
    modes = [np.tile(np.eye(d)[axis], (count, 1)) for axis in range(d)]
    for a in range(d):
        for b in range(a + 1, d):
            turned = np.zeros((count, d))
            turned[:, a], turned[:, b] = -x[:, b], x[:, a]
            modes.append(turned)
    return np.stack(modes, axis=-1)


def _can_move(positions: Array, held: NDArray[np.bool_]) -> bool:
    """True if a rigid part can move although it is held, (n_nodes, d) both."""
    modes = rigid_modes(positions)
    rows = modes[held]
    return int(np.linalg.matrix_rank(rows, tol=FREE)) < modes.shape[-1] if len(rows) else True


def _moving_part(x: Array, held: NDArray[np.bool_], parts: list[Ints]) -> int | None:
    """Of the parts of one body, the one that moves most in a motion that nothing holds."""
    modes = [rigid_modes(x[nodes]) for nodes in parts]
    width = int(modes[0].shape[-1])
    equations = []

    def require(terms: dict[int, Array]) -> None:
        """Add equations, Σ rows[part] · motion of the part = 0, as few as say the same."""
        small = np.asarray(np.linalg.qr(np.concatenate([*terms.values()], axis=1), mode="r"))
        wide = np.zeros((len(small), len(parts) * width))
        for place, part in enumerate(terms):
            wide[:, part * width :][:, :width] = small[:, place * width :][:, :width]
        equations.append(wide)

    at = [dict(zip(nodes.tolist(), range(len(nodes)), strict=True)) for nodes in parts]
    owner: dict[int, int] = {}
    joints: dict[tuple[int, int], list[int]] = {}
    for number, nodes in enumerate(parts):
        require({number: modes[number][held[nodes]]})
        for node in nodes.tolist():
            other = owner.setdefault(node, number)
            if other != number:
                joints.setdefault((other, number), []).append(node)
    for (one, two), nodes_between in joints.items():
        rows = {
            part: sign * modes[part][[at[part][n] for n in nodes_between]].reshape(-1, width)
            for part, sign in ((one, 1.0), (two, -1.0))
        }
        require(rows)
    equations.append(np.zeros((len(parts) * width,) * 2))  # as many as there are motions
    _, values, motions = np.linalg.svd(np.concatenate(equations), full_matrices=False)
    if values[-1] > FREE:
        return None
    return int(np.linalg.norm(motions[-1].reshape(-1, width), axis=1).argmax())


def _moving(x: Array, nodes: Ints, shared: NDArray[np.bool_]) -> str:
    """Name the part that can move by its first node, and where it is joined to others."""
    joints = nodes[shared[nodes]]
    if not len(joints):
        return (
            f"the body at {_at(x[nodes[0]])} can still move or turn as a whole, expected it to be "
            "held"
        )
    own = nodes[~shared[nodes]]
    return (
        f"the part at {_at(x[(own if len(own) else nodes)[0]])} can still move or turn, it shares "
        f"{len(joints)} nodes but no facet with others, the first at {_at(x[joints[0]])}; expected "
        "it to be held or joined by facets"
    )


def _at(position: Array) -> str:
    return ",".join(f"{value:g}" for value in position)
