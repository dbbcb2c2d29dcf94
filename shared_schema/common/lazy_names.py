"""Public names of a package that are imported at their first use, as they take long to load."""

from __future__ import annotations

import ast
import sys
from collections.abc import Callable
from functools import cache
from importlib import import_module
from pathlib import Path
from typing import Any


def lazy_names(package: str) -> tuple[Callable[[str], Any], Callable[[], list[str]]]:
    """Make ``__getattr__`` and ``__dir__`` of a package, from imports under ``if TYPE_CHECKING``.

    Type checkers read these imports as they stand; at run time, each is done when its name is first
    asked for (PEP 562).

    Parameters
    ----------
    package : str
        Its ``__name__``.
    """

    @cache
    def places() -> dict[str, tuple[str, str]]:
        """Return module and name there, by public name."""
        source = Path(str(sys.modules[package].__file__)).read_text(encoding="utf-8")
        return {
            alias.asname or alias.name: (str(node.module), alias.name)
            for block in ast.parse(source).body
            if isinstance(block, ast.If)
            for node in block.body
            if isinstance(node, ast.ImportFrom)
            for alias in node.names
        }

    def find(name: str) -> Any:
        if name.startswith("_") or name not in places():
            raise AttributeError(f"module '{package}' has no attribute '{name}'")
        module, original = places()[name]
        return getattr(import_module(module), original)

    def names() -> list[str]:
        return sorted({*vars(sys.modules[package]), *places()})

    return find, names
