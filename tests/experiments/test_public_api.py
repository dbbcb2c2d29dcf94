"""The experiments use what the packages publish: names in ``__all__`` of a package or a room."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
PROGRAMS = ("datagen", "shared_schema", "surrogate")
STOREYS = ("surrogate.mechanics.", "surrogate.learning.", "surrogate.runtime.")
FILES = sorted((ROOT / "experiments").rglob("*.py"))


@cache
def published(module: str) -> frozenset[str]:
    """Names in ``__all__`` of a package, a room in it, or the drawing of `shared_schema`."""
    path = ROOT.joinpath(*module.split("."))
    path = path / "__init__.py" if path.is_dir() else path.with_suffix(".py")
    depth = 3 if module.startswith(STOREYS) else 2
    if len(module.split(".")) > depth and module != "shared_schema.common.drawing":
        return frozenset()
    for node in ast.parse(path.read_text()).body:
        if isinstance(node, ast.Assign) and ast.unparse(node.targets[0]) == "__all__":
            return frozenset(ast.literal_eval(node.value))
    return frozenset()


def is_public(module: str, name: str) -> bool:
    return name in published(module) or (name == "__version__" and module in PROGRAMS)


def private_uses(source: str) -> Iterator[str]:
    """Imports of names that are not published, and uses of such attributes of a program."""
    tree = ast.parse(source)
    imported = {
        alias.name
        for node in ast.walk(tree)
        if isinstance(node, ast.Import)
        for alias in node.names
    }
    for node in ast.walk(tree):
        if isinstance(node, ast.ImportFrom) and str(node.module).split(".")[0] in PROGRAMS:
            for alias in node.names:
                if not is_public(str(node.module), alias.name):
                    yield f"from {node.module} import {alias.name}"
        elif isinstance(node, ast.Import):
            for alias in node.names:
                if alias.name.split(".")[0] in PROGRAMS and "." in alias.name:
                    yield f"import {alias.name}"
        elif isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name):
            program = node.value.id
            if program in imported & {*PROGRAMS} and not is_public(program, node.attr):
                yield f"{program}.{node.attr}"


@pytest.mark.parametrize("path", FILES, ids=lambda path: str(path.relative_to(ROOT)))
def test_experiments_use_public_names(path: Path) -> None:
    assert list(private_uses(path.read_text())) == []


def test_private_names_are_found() -> None:
    source = (
        "import surrogate\n"
        "import surrogate.learning.data\n"
        "from surrogate.learning.data.dataset import Dataset\n"
        "from surrogate.learning.runs import _seal\n"
        "surrogate._MODULES\n"
    )
    assert list(private_uses(source)) == [
        "import surrogate.learning.data",
        "from surrogate.learning.data.dataset import Dataset",
        "from surrogate.learning.runs import _seal",
        "surrogate._MODULES",
    ]
    assert not list(private_uses("import surrogate\nfrom surrogate.learning.data import Dataset"))
