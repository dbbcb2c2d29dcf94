"""From a shape to a page on which one touches it: mesh, load series and page in one go.

Bodies are made by `datagen`, which another environment may have: it is run as a program. The page
loads single nodes of the surface, with forces under which the linear body moves by a tenth of its
size.
"""

from __future__ import annotations

import re
import shutil
from collections.abc import Mapping, Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import yaml

from shared_schema.common.arguments import checked_arguments
from shared_schema.common.configuration import changed, read_yaml
from shared_schema.common.errors import InputError
from shared_schema.common.files import require_writable
from surrogate.learning.training.loop import train
from surrogate.mechanics.statics.body import Body
from surrogate.page.factory import run_datagen
from surrogate.page.page import write_page
from surrogate.page.page_loads import largest_force

CONDITION = re.compile(r"\s*([xyz])\s*(<=|>=|<|>|=)\s*([^\s<>=]+)\s*")
SHAPES = ("sphere", "patch", "plane")  # of regions
FEWEST = 4  # numbers of one of them
REPAIRED = "repaired.stl"
FIRST = 1.0  # range in N of the loads of a body whose stiffness is not known yet


@checked_arguments
def page_of_shape(
    shape: str | Path,
    supports: Sequence[str],
    young_modulus: float,
    *,
    poisson_ratio: float = 0.45,
    scale: float = 1.0,
    size: float | None = None,
    repair: bool = False,
    changes: Sequence[str] = (),
    out: str | Path | None = None,
) -> Path:
    """Make a body of a file, its load series and its page.

    Parameters
    ----------
    shape : str or Path
        A closed surface, segmented image, CAD file, gmsh script or mesh, as the key `path` of a
        case takes it.
    supports : sequence of str
        Where the body is held: conditions on coordinates in m, such as "z<0.01" or
        "x<0.1,y>0.2", spheres such as "sphere:0,0,0.1:0.02", patches of the surface such as
        "patch:0,0,0.1:0.02", or what is behind a plane, "plane:X,Y,Z:NX,NY,NZ". Nodes that one of
        them means are held.
    young_modulus : float
        In Pa, at rest.
    poisson_ratio : float
    scale : float
        Length of the file's unit in m.
    size : float, optional
        Size of the cells in the file's unit; needed by images and CAD files.
    repair : bool
        Make one closed surface of the file's triangles first, as `datagen repair` does.
    changes : sequence of str
        Keys of the case and their values, such as ``mesh.zones={tumour: tumour.stl}``.
    out : str or Path, optional
        Folder for the case, the body, the run of its series and the page; by default one of the
        shape's name in this folder. One that the same call made before is left as it is.

    Returns
    -------
    Path
        The page, a single HTML file.

    Raises
    ------
    InputError
        If there is no such file, a text or number is wrong, the body cannot be made, the folder
        is of another body, or there is no program `datagen`; nothing is left then.
    """
    path = Path(shape)
    if not path.is_file():
        raise InputError(f"{path}: no such file")
    folder = Path(path.stem if out is None else out)
    mesh: dict[str, Any] = {"kind": "file", "path": str(path.resolve()), "scale": scale}
    given: dict[str, Any] = {
        "name": re.sub(r"[^A-Za-z0-9_-]", "_", path.stem),
        "mesh": mesh if size is None else mesh | {"size": size},
        "material": {"young_modulus": young_modulus, "poisson_ratio": poisson_ratio},
        "supports": [region_of(text) for text in supports],
        "load": {"family": "random_node", "region": {"boundary": True}, "range": [-FIRST, FIRST]},
        "dataset": {"samples": 1, "seed": 0},
    }
    case = changed(given, changes)
    mesh = case["mesh"]
    if isinstance(mesh.get("zones"), dict):
        zones = {name: str(Path(str(file)).resolve()) for name, file in mesh["zones"].items()}
        case["mesh"] = mesh = {**mesh, "zones": zones}
    if repair:
        mesh["path"] = REPAIRED  # beside the case
    if folder.exists():
        if asked_before(case, folder / "case.yaml"):
            return folder / f"{path.stem}.html"
        raise InputError(f"out '{folder}': exists, of another body; expected a new folder", "out")
    require_writable(folder)
    folder.parent.mkdir(parents=True, exist_ok=True)
    with TemporaryDirectory(prefix=f".{folder.name}-", dir=folder.parent) as partial:
        place = Path(partial) / folder.name
        place.mkdir()
        if repair:
            words = () if size is None else ("--size", str(size))
            run_datagen("repair", path, "--out", place / REPAIRED, *words)
        body = make_body(case, place)
        largest = float(f"{largest_force(body):.2g}")
        shutil.rmtree(place / "body")
        case["load"]["range"] = [-largest, largest]
        make_body(case, place)
        train("series", place / "body", place / "series")
        write_page(place / "series", place / f"{path.stem}.html")
        place.rename(folder)
    return folder / f"{path.stem}.html"


def region_of(text: str) -> dict[str, Any]:
    """Region of a case that a text means; InputError if it means none.

    >>> region_of("x<0.1,y>0.2")
    {'x': '< 0.1', 'y': '> 0.2'}
    >>> region_of("sphere:0,0,0.1:0.02")
    {'sphere': [0.0, 0.0, 0.1, 0.02]}
    """
    try:
        shape, colon, rest = text.partition(":")
        if colon and shape in SHAPES:
            numbers = [float(number) for number in rest.replace(":", ",").split(",")]
            if len(numbers) < FEWEST:
                raise ValueError
            return {shape: numbers}
        found: dict[str, list[str]] = {}
        for part in text.split(","):
            match = CONDITION.fullmatch(part)
            if match is None:
                raise ValueError
            axis, comparison, bound = match.groups()
            found.setdefault(axis, []).append(f"{comparison} {float(bound):g}")
        if any(len(some) > 1 and any(each[0] == "=" for each in some) for some in found.values()):
            raise ValueError
        return {
            axis: float(some[0][2:]) if some[0][0] == "=" else " and ".join(some)
            for axis, some in found.items()
        }
    except ValueError:
        raise InputError(
            f"support '{text}': expected conditions such as 'z<0.01' or 'x<0.1,y>0.2', "
            "'sphere:X,Y,Z:R', 'patch:X,Y,Z:R' or 'plane:X,Y,Z:NX,NY,NZ', in m",
            "support",
        ) from None


def asked_before(case: Mapping[str, Any], file: Path) -> bool:
    """Whether a file has the case of an earlier call, whose range of loads follows from it."""
    if not file.is_file():
        return False
    before, asked = read_yaml(file), dict(case)
    asked["load"] = {**asked["load"], "range": before["load"]["range"]}
    return before == asked


def make_body(case: Mapping[str, Any], folder: Path) -> Body:
    """Run `datagen body` on a case, and read what it makes; InputError says what it refuses."""
    (folder / "case.yaml").write_text(yaml.safe_dump(dict(case), sort_keys=False))
    run_datagen("body", folder / "case.yaml", "--out", folder / "body")
    return Body.read(folder / "body")
