"""Equilibria by MFEM (https://mfem.org), as its example 10 solves: in its own Neo-Hookean law."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import mfem.ser as mfem
import numpy as np
from measured import measured

STEPS = 5


def prepared(p: dict[str, Any]) -> Callable[[Any], Any]:
    """Return what solves one load in W = μ/2 (J^(-2/d) tr C − d) + K/2 (J − 1)²."""
    (count, d), kind = p["x"].shape, str(p["type"])
    mesh = mfem.Mesh(d, count, len(p["cells"]))
    for point in p["x"]:
        mesh.AddVertex([float(value) for value in point])
    add = {"quad": mesh.AddQuad, "tetra": mesh.AddTet, "hexahedron": mesh.AddHex}[kind]
    for cell in p["cells"]:
        add([int(node) for node in cell])
    mesh.FinalizeMesh(0, False)
    elements = mfem.H1_FECollection(1, d)
    space = mfem.FiniteElementSpace(mesh, elements, d, mfem.Ordering.byVDIM)
    mu = float(p["young"] / 2 / (1 + p["poisson"]))
    lam = 2 * mu * float(p["poisson"] / (1 - 2 * p["poisson"]))
    model = mfem.NeoHookeanModel(mu, lam + 2 * mu / d)
    form = mfem.NonlinearForm(space)
    form.AddDomainIntegrator(mfem.HyperelasticNLFIntegrator(model))
    form.SetEssentialTrueDofs(mfem.intArray(np.flatnonzero(p["held"]).tolist()))
    smoother = mfem.DSmoother(1)
    linear = mfem.MINRESSolver()
    linear.SetRelTol(1e-10)
    linear.SetMaxIter(20000)
    linear.SetPreconditioner(smoother)
    newton = mfem.NewtonSolver()
    newton.SetSolver(linear)
    newton.SetOperator(form)
    newton.SetRelTol(1e-8)
    newton.SetMaxIter(30)

    kept = mesh, elements, space, model, form, smoother, linear  # MFEM has but pointers to them

    def solve(force: Any) -> Any:
        assert kept
        there = p["x"].ravel().copy()  # MFEM has but a pointer to it
        place = mfem.Vector(there)
        for part in np.linspace(0, 1, STEPS + 1)[1:]:
            load = part * force.ravel()
            newton.Mult(mfem.Vector(load), place)
        return there.reshape(count, d) - p["x"]

    return solve


measured(prepared)
