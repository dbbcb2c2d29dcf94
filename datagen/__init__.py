"""Data factory: solves Neo-Hookean equilibria under families of nodal loads, writes datasets.

What a command of ``datagen`` does is one call here::

    solution = datagen.solve("beam2d", "4,1:0,-2.5")
    manifest = datagen.run("beam2d", "data/beam2d/nodal", samples=20)
    datagen.structure("data/beam2d/nodal", "data/beam2d/structured")

`run` is collective over the ranks of MPI; all else is for one process. Wrong input
raises `InputError`, work that fails `WorkError`.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from datagen.needed import solvers_named
from shared_schema.common.lazy_names import lazy_names

if TYPE_CHECKING:
    from datagen.cases.case import Case, read_case, shipped_cases
    from datagen.cases.case_schema import case_keys, case_schema
    from datagen.contrib.plaid.exporting import export_plaid
    from datagen.contrib.publishing.publishing import publish
    from datagen.farm.body_dataset import body
    from datagen.farm.farm import run
    from datagen.mesh.repair import repair
    from datagen.motion.moved_body import MovedBody, move
    from datagen.output.dataset_figure import plot_dataset as plot
    from datagen.output.dataset_info import info
    from datagen.output.paraview_series import export
    from datagen.solution import Solution, solve
    from datagen.transforms.added_noise import add_noise
    from datagen.transforms.reindexing import structure
    from shared_schema.checker import check_dataset as check
    from shared_schema.common.errors import InputError, WorkError

__version__ = "1.0.0"
__all__ = [
    "Case",
    "InputError",
    "MovedBody",
    "Solution",
    "WorkError",
    "add_noise",
    "body",
    "case_keys",
    "case_schema",
    "check",
    "export",
    "export_plaid",
    "info",
    "move",
    "plot",
    "publish",
    "read_case",
    "repair",
    "run",
    "shipped_cases",
    "solve",
    "structure",
]
_found, __dir__ = lazy_names(__name__)


def __getattr__(name: str) -> Any:
    with solvers_named(f"datagen.{name}"):
        return _found(name)
