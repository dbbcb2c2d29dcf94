"""Rules for imports: the two programs share nothing but files and `shared_schema`."""

from __future__ import annotations

import ast
import subprocess
import sys
from collections.abc import Iterable, Iterator
from graphlib import TopologicalSorter
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
FACTORY = {"dolfinx", "ufl", "basix", "ffcx", "petsc4py", "mpi4py", "gmsh"}
LEARNER = {"jinja2", "safetensors", "torch"}
DRAWING = {  # modules outside `surrogate` that may import matplotlib
    "shared_schema/common/drawing/deformed_figure.py",
    "shared_schema/common/drawing/drawing.py",
    "shared_schema/common/drawing/figure_style.py",
    "shared_schema/common/drawing/mesh_drawing.py",
    "shared_schema/common/drawing/plane_drawing.py",
    "shared_schema/common/drawing/space_drawing.py",
    "datagen/output/dataset_figure.py",
    "datagen/solution.py",
}
FORBIDDEN = {
    "shared_schema": FACTORY | LEARNER | {"datagen", "surrogate", "experiments"},
    "datagen": LEARNER | {"surrogate", "experiments"},
    "surrogate": FACTORY | {"datagen", "experiments"},
}


LAYERS = {  # packages and root modules; imports go downwards, or anywhere inside one layer
    "shared_schema": [
        ["common"],
        ["own_class"],
        ["materials", "tools", "point_tree", "points_in_cells", "layout", "unfinished", "manifest"],
        ["shard", "content_problems"],
        ["grid", "stiffness", "load_cases"],
        ["checker", "dataset_reader"],
    ],
    "datagen": [
        ["compiled_cache", "stale_locks"],
        ["quantities", "ranks", "dolfinx_versions"],
        ["mesh", "loads", "discretisation", "materials"],
        ["solver"],
        ["stability"],
        ["cases"],
        ["farm", "transforms", "output", "plaid_format", "solution"],
        ["commands", "command_line"],
    ],
    "surrogate": [
        ["seeds", "device", "hardware", "cuda_graphs", "time_limit", "data"],
        [
            *("mechanics", "series", "modal_equilibrium"),
            *("probabilistic", "networks", "baselines", "optim"),
        ],
        ["models", "runs"],
        ["descent"],
        ["inference", "certify", "touch"],
        [
            *("training", "planning", "measures", "figures", "evaluation", "page"),
            *("identification", "serving"),
        ],
        ["commands", "command_line", "command_options"],
    ],
}


def modules(package: Path) -> list[Path]:
    """Return all files of a package and the packages in it, without what npm installs."""
    return [path for path in package.rglob("*.py") if "node_modules" not in path.parts]


def imported(path: Path) -> set[str]:
    """Return the top-level names of all imports in a file, also inside functions."""
    names: set[str] = set()
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            names |= {alias.name.partition(".")[0] for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path}: relative import"
            names.add(str(node.module).partition(".")[0])
    return names


@pytest.mark.parametrize("package", sorted(FORBIDDEN))
def test_no_import_against_the_arrows(package: str) -> None:
    files = modules(ROOT / package)
    assert files
    for path in files:
        against = imported(path) & FORBIDDEN[package]
        assert not against, f"{path.relative_to(ROOT)} imports {sorted(against)}"


def imported_packages(path: Path, program: str) -> set[str]:
    """Return the packages and root modules of its own program that a file imports."""
    return packages_among(ast.walk(ast.parse(path.read_text())), program)


def packages_among(nodes: Iterable[ast.AST], program: str) -> set[str]:
    """Return the packages and root modules of a program that are imported by some statements."""
    packages: set[str] = set()
    for node in nodes:
        names: list[str] = []
        if isinstance(node, ast.ImportFrom):
            names = [f"{node.module}.{alias.name}" for alias in node.names]
        elif isinstance(node, ast.Import):
            names = [alias.name for alias in node.names]
        for name in names:
            top, *rest = name.split(".")
            if top == program and rest:
                packages.add(rest[0])
    return packages


def statements(tree: ast.AST) -> Iterator[ast.AST]:
    """Yield all statements that run, also inside functions: none under ``if TYPE_CHECKING``."""
    for node in ast.iter_child_nodes(tree):
        if isinstance(node, ast.If) and ast.unparse(node.test) == "TYPE_CHECKING":
            continue
        yield node
        yield from statements(node)


def files_of(package: Path) -> list[Path]:
    """Return the files of a package, or of a root module."""
    return modules(package) if package.is_dir() else [package.with_suffix(".py")]


@pytest.mark.parametrize("program", sorted(LAYERS))
def test_no_package_imports_upward(program: str) -> None:
    layers = LAYERS[program]
    named = {name for layer in layers for name in layer}
    found = {path.relative_to(ROOT / program).parts[0] for path in modules(ROOT / program)}
    assert {name.removesuffix(".py") for name in found} == {*named, "__init__"}
    for height, layer in enumerate(layers):
        above = {name for higher in layers[height + 1 :] for name in higher}
        packages = [ROOT / program / name for name in layer]
        for path in (p for package in packages for p in files_of(package)):
            upward = imported_packages(path, program) & above
            assert not upward, f"{path.relative_to(ROOT)} imports {sorted(upward)} above it"


@pytest.mark.parametrize("program", sorted(LAYERS))
def test_no_circles_of_rooms(program: str) -> None:
    """Packages and root modules of a program import each other in one direction."""
    imports: dict[str, set[str]] = {}
    for room in (name for layer in LAYERS[program] for name in layer):
        imports[room] = set()
        for path in files_of(ROOT / program / room):
            found = packages_among(statements(ast.parse(path.read_text())), program)
            imports[room] |= found - {room}
    TopologicalSorter(imports).prepare()  # CycleError names the rooms of a circle


def test_no_package_is_a_corridor() -> None:
    """A package has at most 17 files besides its ``__init__``."""
    for program in LAYERS:
        for package in {path.parent for path in modules(ROOT / program)}:
            found = [path for path in package.glob("*.py") if path.name != "__init__.py"]
            assert len(found) <= 17, f"{package.relative_to(ROOT)} holds {len(found)} files"


def test_matplotlib_is_for_those_who_draw() -> None:
    for package in ("shared_schema", "datagen"):
        for path in modules(ROOT / package):
            name = str(path.relative_to(ROOT))
            assert ("matplotlib" in imported(path)) == (name in DRAWING), name


def test_the_check_sees_imports_inside_functions(tmp_path: Path) -> None:
    path = tmp_path / "module.py"
    path.write_text("def f():\n    from dolfinx.fem import form\n    import torch.nn as nn\n")
    assert imported(path) == {"dolfinx", "torch"}


def test_the_learner_loads_nothing_of_the_factory() -> None:
    """An import of every module of `surrogate` loads no package of `datagen`."""
    files = (p.relative_to(ROOT) for p in modules(ROOT / "surrogate") if p.name[0] != "_")
    names = [".".join(file.with_suffix("").parts) for file in files]
    assert loaded(names, FACTORY) == []


def test_contract_and_command_line_load_no_matplotlib() -> None:
    """matplotlib is optional in `shared_schema`, and only some commands of `surrogate` draw."""
    files = [str(p.relative_to(ROOT)) for p in (ROOT / "shared_schema").rglob("[a-z]*.py")]
    modules = [file[:-3].replace("/", ".") for file in files if "/drawing/" not in file]
    assert len(modules) > 10
    assert loaded([*modules, "datagen.command_line"], {"matplotlib"}) == []
    assert loaded(["shared_schema.common.drawing.figure_style"], {"matplotlib"}) == ["matplotlib"]


def loaded(modules: list[str], among: set[str]) -> list[str]:
    """Return those of some packages that are loaded after imports in a new interpreter."""
    code = (
        "import importlib, sys\n"
        f"for name in {modules!r}: importlib.import_module(name)\n"
        f"print(*sorted({among!r} & set(sys.modules)))\n"
    )
    result = subprocess.run(
        [sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=True
    )
    return result.stdout.split()


def test_nothing_unpickles() -> None:
    """No module calls a loader that can run code from a file."""
    for package in FORBIDDEN:
        for path in modules(ROOT / package):
            text = path.read_text()
            assert "pickle" not in imported(path)
            assert "torch.load" not in text, path
            assert "yaml.load(" not in text, path
            assert "allow_pickle=True" not in text, path
