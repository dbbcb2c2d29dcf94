"""Rules for imports: the two programs share nothing but files and `shared_schema`."""

from __future__ import annotations

import ast
import subprocess
import sys
from collections.abc import Iterable, Iterator
from graphlib import TopologicalSorter
from pathlib import Path

import pytest

from surrogate.extensions import CONTRIB

ROOT = Path(__file__).parents[2]
FACTORY = {"dolfinx", "ufl", "basix", "ffcx", "petsc4py", "mpi4py", "gmsh"}
LEARNER = {"jinja2", "safetensors", "torch"}
DRAWING = {  # modules outside `surrogate` that may import matplotlib
    "shared_schema/common/drawing/mesh_drawing.py",
    "shared_schema/common/drawing/drawing.py",
    "shared_schema/common/drawing/figure_style.py",
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
        ["materials", "tools", "points_in_cells", "layout", "manifest"],
        ["shard", "content_problems"],
        ["actuators", "grid", "motion", "stiffness", "load_cases"],
        ["checker", "dataset_reader", "loads"],
        ["samples"],
    ],
    "datagen": [
        ["compiled_cache", "loads", "needed"],
        ["ranks", "dolfinx_versions"],
        ["mesh", "discretisation", "materials"],
        ["solver"],
        ["stability"],
        ["cases"],
        ["loaded_case"],
        ["farm", "transforms", "output", "solution", "motion"],
        ["contrib"],
        ["commands", "command_line"],
    ],
    "surrogate": [
        ["runtime", "old_paths", "extensions"],
        ["mechanics.energy", "mechanics.matrices"],
        ["mechanics.compiled"],
        ["mechanics.body", "mechanics.solids"],
        ["mechanics.equilibrium"],
        ["mechanics.series", "mechanics.descent"],
        ["mechanics.certify", "mechanics.modal_equilibrium"],
        ["mechanics.statics"],
        ["mechanics.touch", "mechanics.sampling"],
        ["mechanics.identification"],
        ["mechanics.actuation"],
        ["mechanics.motion"],
        ["learning.data", "learning.probabilistic"],
        ["learning.networks"],
        ["learning.optim"],
        ["learning.models"],
        ["learning.runs"],
        ["learning.inference"],
        ["learning.training", "learning.measures", "figures"],
        ["learning.planning", "learning.evaluation"],
        ["page", "serving"],
        ["command_options"],
        ["commands", "contrib"],
        ["command_line"],
    ],
}
STOREYS = {"surrogate.mechanics", "surrogate.learning"}  # packages of rooms
APART = {  # packages, and rooms that they never import
    "surrogate/mechanics": {"learning", "figures", "page", "serving", "commands"},
    "surrogate/learning": {"page", "serving", "commands"},
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


def name_of(path: Path) -> str:
    """Return the dotted name of a module or package."""
    parts = path.relative_to(ROOT).with_suffix("").parts
    return ".".join(part for part in parts if part != "__init__")


FILES = {name_of(path): path for package in FORBIDDEN for path in modules(ROOT / package)}
TREES = {name: ast.parse(path.read_text()) for name, path in FILES.items()}


def statements(tree: ast.AST) -> Iterator[ast.AST]:
    """Yield all statements that run, also inside functions: none under ``if TYPE_CHECKING``."""
    for node in ast.iter_child_nodes(tree):
        if isinstance(node, ast.If) and ast.unparse(node.test) == "TYPE_CHECKING":
            continue
        yield node
        yield from statements(node)


def home_of(package: str, name: str) -> str:
    """Return the module that has a name which a package may merely pass on, also lazily."""
    if f"{package}.{name}" in FILES:
        return f"{package}.{name}"
    if package in FILES and FILES[package].name == "__init__.py":
        for node in ast.walk(TREES[package]):
            if isinstance(node, ast.ImportFrom) and name in {alias.name for alias in node.names}:
                return home_of(str(node.module), name)
    return package


def modules_among(nodes: Iterable[ast.AST]) -> set[str]:
    """Return the modules of the three packages that some statements import."""
    names: set[str] = set()
    for node in nodes:
        if isinstance(node, ast.ImportFrom):
            names |= {home_of(str(node.module), alias.name) for alias in node.names}
        elif isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
    return names & set(FILES)


IMPORTS = {name: modules_among(statements(tree)) for name, tree in TREES.items()}


def room_of(name: str) -> str:
    """Return the room of a module: a package or root module, in a storey the package in it."""
    program, *rest = name.split(".")
    storey = ".".join((program, *rest[:1])) in STOREYS
    return ".".join(rest[: 1 + storey])


def rooms_of(program: str) -> dict[str, set[str]]:
    """Return all rooms of a program, and the rooms that each imports."""
    rooms: dict[str, set[str]] = {}
    for name, found in IMPORTS.items():
        if name.startswith(f"{program}.") and name not in STOREYS:
            inside = {room_of(each) for each in found if each.startswith(f"{program}.")}
            rooms.setdefault(room_of(name), set())
            rooms[room_of(name)] |= inside - {room_of(name)}
    return rooms


@pytest.mark.parametrize("program", sorted(LAYERS))
def test_no_room_imports_upward(program: str) -> None:
    layers, rooms = LAYERS[program], rooms_of(program)
    assert sorted(rooms) == sorted(room for layer in layers for room in layer)
    for height, layer in enumerate(layers):
        above = {room for higher in layers[height + 1 :] for room in higher}
        for room in layer:
            assert not rooms[room] & above, f"{program}.{room} imports what is above it"


@pytest.mark.parametrize("program", sorted(LAYERS))
def test_no_circles_of_rooms(program: str) -> None:
    """The rooms of a program import each other in one direction."""
    TopologicalSorter(rooms_of(program)).prepare()  # CycleError names the rooms of a circle


def test_no_circles_of_files() -> None:
    """All imports count, wherever they stand, but those for type checkers only."""
    TopologicalSorter(IMPORTS).prepare()


@pytest.mark.parametrize("storey", sorted(APART))
def test_a_storey_knows_nothing_of_what_is_above(storey: str) -> None:
    for path in modules(ROOT / storey):
        name = name_of(path)
        found = {each for each in IMPORTS[name] if each.startswith("surrogate.")}
        above = {each for each in found if each.split(".")[1] in APART[storey]}
        assert not above, f"{name} imports {sorted(above)}"


def test_nothing_imports_contrib() -> None:
    """The core finds its parts by name: public names, and the places of `surrogate.extensions`."""
    for name, tree in TREES.items():
        inside = name.split(".")[1:2] == ["contrib"]
        for node in statements(tree):
            text = ast.unparse(node) if isinstance(node, ast.Import | ast.ImportFrom) else ""
            assert inside or ".contrib" not in text, f"{name}: {text}"


def test_every_place_of_an_extension_is_there() -> None:
    for place in CONTRIB.values():
        assert {place, place.rpartition(".")[0]} & set(FILES)


def test_a_circle_inside_functions_is_found() -> None:
    circle = ast.parse("def f():\n    from surrogate.mechanics import Compliance\n")
    hint = ast.parse("if TYPE_CHECKING:\n    from surrogate.mechanics import Compliance\n")
    assert modules_among(statements(circle)) == {"surrogate.mechanics.equilibrium.compliance"}
    assert modules_among(statements(hint)) == set()


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
