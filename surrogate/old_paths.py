"""Old import paths, for one release: `surrogate.touch.grip` of `surrogate.mechanics.touch.grip`.

Both names are of one module, so that classes are the same. An import by the old one issues a
`DeprecationWarning`.
"""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from importlib import import_module
from importlib.abc import Loader, MetaPathFinder
from importlib.machinery import ModuleSpec
from types import ModuleType

PLACES = (  # old and new package, and the rooms and modules that have moved
    ("surrogate", "surrogate.runtime", "device seeds hardware cuda_graphs time_limit"),
    (
        "surrogate",
        "surrogate.mechanics",
        "series descent certify touch identification modal_equilibrium",
    ),
    (
        "surrogate",
        "surrogate.learning",
        "data networks probabilistic models optim training runs evaluation measures planning "
        "inference",
    ),
    ("surrogate.models", "surrogate.contrib", "pod_model"),
    ("surrogate.training", "surrogate.contrib", "refinement sample_paths"),
    ("surrogate.mechanics", "surrogate.contrib", "load_path"),
    ("surrogate.runs", "surrogate.runtime", "tensor_file"),
    ("surrogate.series", "surrogate.learning.data", "terms_on_grid"),
    ("surrogate.data", "surrogate.mechanics.body", "geometry elements_of_case free_components"),
    ("surrogate.inference", "surrogate.mechanics.statics", "body"),
    ("surrogate.inference", "surrogate.mechanics.body", "stiffness"),
    (
        "surrogate.mechanics",
        "surrogate.mechanics.equilibrium",
        "block_solve compliance follower_pressure kept_responses linear_response "
        "newton_steps nodal_gradient out_of_balance quadratic stresses tool_springs",
    ),
)
MOVED = {
    "surrogate.inference.given_load": "surrogate.mechanics.statics.load",
    **{f"{old}.{name}": f"{new}.{name}" for old, new, names in PLACES for name in names.split()},
}


def new_path(name: str) -> str | None:
    """Name of a module by its old one; None if it is none."""
    head, tail = name, ""
    while head.count("."):
        if head in MOVED:
            return MOVED[head] + tail
        head, _, last = head.rpartition(".")
        tail = f".{last}{tail}"
    return None


class OldPaths(MetaPathFinder, Loader):
    """Finds modules by their old names."""

    def find_spec(
        self, fullname: str, path: Sequence[str] | None, target: ModuleType | None = None
    ) -> ModuleSpec | None:
        """Point from an old name to the module."""
        new = new_path(fullname) if fullname.startswith("surrogate.") else None
        if new is None:
            return None
        said = f"'{fullname}' is '{new}' now; the old name goes with the next release"
        warnings.warn(said, DeprecationWarning, stacklevel=2)
        return ModuleSpec(fullname, self, origin=new)

    def create_module(self, spec: ModuleSpec) -> ModuleType:
        """Return the module of the new name."""
        module = import_module(str(spec.origin))
        spec.loader_state = module.__spec__
        return module

    def exec_module(self, module: ModuleType) -> None:
        """Leave it as it is: it has run, under its new name."""
        if module.__spec__ is not None:
            module.__spec__ = module.__spec__.loader_state
