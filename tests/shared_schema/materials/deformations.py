"""Deformations, their invariants by linear algebra, and stresses by jets."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from shared_schema.materials import ARRAYS, FibreInvariants, Invariants, Material
from shared_schema.materials.material import JETS, Jet

Array = NDArray[np.float64]


def invariants(f: Array, directions: Sequence[Array] = ()) -> Invariants:
    """Invariants of F, (3, 3), with K₄ from the matrix of cofactors of F."""
    c, cofactor = f.T @ f, np.linalg.det(f) * np.linalg.inv(f).T
    i1 = np.trace(c)
    i2 = (i1**2 - np.trace(c @ c)) / 2
    fibres = tuple(
        FibreInvariants(float(a @ c @ a), float(np.sum((cofactor @ a) ** 2))) for a in directions
    )
    return Invariants(float(i1), float(i2), float(np.linalg.det(f)), fibres)


def energy(material: Material, f: Array, directions: Sequence[Array] = ()) -> float:
    """W(F) in J/m³."""
    return float(material.energy(invariants(f, directions), ARRAYS))


def stress(material: Material, f: Array, directions: Sequence[Array] = ()) -> Array:
    """P = ∂W/∂F in Pa, (3, 3), by jets in the nine components of F."""
    entries = np.array(Jet.variables(*f.ravel()), dtype=object).reshape(3, 3)
    c = entries.T @ entries
    i1 = c[0, 0] + c[1, 1] + c[2, 2]
    squares = sum((x * x for x in c.ravel()[1:]), c[0, 0] * c[0, 0])
    i2 = (i1**2 - squares) / 2
    j = sum(
        (
            sign * entries[0, i] * entries[1, k] * entries[2, m]
            for sign, (i, k, m) in (
                (1.0, (1, 2, 0)),
                (1.0, (2, 0, 1)),
                (-1.0, (0, 2, 1)),
                (-1.0, (1, 0, 2)),
                (-1.0, (2, 1, 0)),
            )
        ),
        entries[0, 0] * entries[1, 1] * entries[2, 2],
    )
    fibres = []
    for a in directions:
        row = [c[i, 0] * a[0] + c[i, 1] * a[1] + c[i, 2] * a[2] for i in range(3)]
        stretch = a[0] * row[0] + a[1] * row[1] + a[2] * row[2]
        fifth = row[0] ** 2 + row[1] ** 2 + row[2] ** 2
        fibres.append(FibreInvariants(stretch, fifth - i1 * stretch + i2))
    w = material.energy(Invariants(i1, i2, j, tuple(fibres)), JETS)
    return np.asarray(w.gradient.reshape(3, 3))


def rotation(seed: int) -> Array:
    """A random rotation."""
    q = np.linalg.qr(np.random.default_rng(seed).normal(size=(3, 3)))[0]
    return np.asarray(q * np.sign(np.linalg.det(q)))
