"""From a shape to a page on which one touches it: mesh, load series and page in one go.

Bodies are made by `datagen`, which another environment may have: it is run as a program. The page
loads single nodes of the surface, with forces under which the linear body moves by a tenth of its
size.
"""

from __future__ import annotations

import logging
import math
import re
import shutil
from collections.abc import Mapping, Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import yaml

from shared_schema.common.arguments import checked_arguments
from shared_schema.common.configuration import changed, read_yaml
from shared_schema.common.errors import InputError, WorkError
from shared_schema.common.files import require_writable
from shared_schema.materials import locks, materials_of
from surrogate.learning.training.loop import train
from surrogate.mechanics.statics.body import Body
from surrogate.page.body import BAND, band_entries, coarser, free_unknowns
from surrogate.page.factory import run_datagen
from surrogate.page.page import write_page
from surrogate.page.page_loads import largest_force

logger = logging.getLogger(__name__)
CONDITION = re.compile(r"\s*([xyz])\s*(<=|>=|<|>|=)\s*([^\s<>=]+)\s*")
SHAPES = ("sphere", "patch", "plane")  # of regions
FEWEST = 4  # numbers of one of them
REPAIRED = "repaired.stl"
REST = "rest"  # group of the cells in no zone
CHOSEN = (
    ", element incompressible for a Poisson's ratio above 0.4 (--set element=linear is faster, and "
    "too stiff)"
)
MARGIN = 1.5  # of the band, as coarse cells of a curved body are more than their size says
LONG = 3.0  # m: of an organ or a robot, the file's unit is another one
FIRST = 1.0  # range in N of the loads of a body whose stiffness is not known yet


@checked_arguments
def page_of_shape(
    shape: str | Path,
    supports: Sequence[str],
    young_modulus: float,
    *,
    poisson_ratio: float = 0.4,
    scale: float = 1.0,
    size: float | None = None,
    repair: bool = False,
    zones: Sequence[str] = (),
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
        Above 0.4, linear elements lock, and those of the body are `incompressible`, unless
        `changes` say otherwise.
    scale : float
        Length of the file's unit in m.
    size : float, optional
        Size of the cells in the file's unit; needed by images and CAD files.
    repair : bool
        Make one closed surface of the file's triangles first, as `datagen repair` does.
    zones : sequence of str
        Parts of another Young's modulus in Pa, inside of other closed surfaces of the same unit,
        such as "tumour=tumour.stl:50000".
    changes : sequence of str
        Keys of the case and their values, such as ``element=linear``.
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
    PageLimitError
        A `WorkError`, if the body is too large for a page; body and series are made.
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
    case = changed(with_zones(given, zones), changes)
    mesh = case["mesh"]
    if isinstance(mesh.get("zones"), dict):
        files = {name: str(Path(str(file)).resolve()) for name, file in mesh["zones"].items()}
        case["mesh"] = mesh = {**mesh, "zones": files}
    if repair:
        mesh["path"] = REPAIRED  # beside the case
    chosen = "element" not in case and is_locking(case)
    if chosen:
        case["element"] = "incompressible"
    page = folder / f"{path.stem}.html"
    if folder.exists():
        if not asked_before(case, folder / "case.yaml"):
            said = f"out '{folder}': exists, of another body; expected a new folder"
            raise InputError(said, "out")
        if not page.is_file():
            if limit := page_limit(Body.read(folder / "body"), scale, size):
                raise PageLimitError(limit, folder)
            write_page(folder / "series", page)
        return page
    require_writable(folder)
    folder.parent.mkdir(parents=True, exist_ok=True)
    with TemporaryDirectory(prefix=f".{folder.name}-", dir=folder.parent) as partial:
        place = Path(partial) / folder.name
        place.mkdir()
        if repair:
            words = () if size is None else ("--size", str(size))
            run_datagen("repair", path, "--out", place / REPAIRED, *words)
        body = make_body(case, place)
        x, cells = body.geometry.coordinates, body.geometry.cells
        extents = np.ptp(x, axis=0)
        sides = " x ".join(f"{side:.3g}" for side in extents)
        counts = f"{sides} m, {len(x)} nodes, {len(cells)} {body.geometry.cell_type} cells"
        logger.info("%s: %s%s", folder, counts, CHOSEN if chosen else "")
        if extents.max() > LONG and scale == 1:
            logger.warning("%s: %s; of a file in mm, --scale 0.001 makes metres", folder, sides)
        if limit := page_limit(body, scale, size):
            logger.warning("no page: the body is too large for one; body and load series follow")
        largest = float(f"{largest_force(body):.2g}")
        shutil.rmtree(place / "body")
        case["load"]["range"] = [-largest, largest]
        make_body(case, place)
        train("series", place / "body", place / "series")
        if not limit:
            write_page(place / "series", place / page.name)
        place.rename(folder)
    if limit:
        raise PageLimitError(limit, folder)
    return page


def with_zones(case: dict[str, Any], zones: Sequence[str]) -> dict[str, Any]:
    """The case of one material with zones of their own moduli, NAME=FILE:E; InputError if wrong."""
    files, moduli = {}, {REST: case["material"]["young_modulus"]}
    for text in zones:
        name, _, rest = text.partition("=")
        file, _, modulus = rest.rpartition(":")
        try:
            moduli[name], files[name] = float(modulus), file
            if not (name and file) or len(moduli) != len(files) + 1:
                raise ValueError
        except ValueError:
            raise InputError(
                f"zone '{text}': expected NAME=FILE:E, such as tumour=tumour.stl:50000 in Pa, each "
                f"name once and none '{REST}'",
                "zone",
            ) from None
    if not files:
        return case
    materials = [
        {**case["material"], "group": name, "young_modulus": modulus}
        for name, modulus in moduli.items()
    ]
    return {**case, "mesh": {**case["mesh"], "zones": files}, "material": materials}


def is_locking(case: Mapping[str, Any]) -> bool:
    """Whether linear elements of a case are too stiff, as far as its materials are known here."""
    try:
        return locks(materials_of(case["material"], "case"))
    except InputError:  # `datagen` says what is wrong, or knows the file
        return False


def page_limit(body: Body, scale: float, size: float | None) -> str | None:
    """What keeps a body from a page, and of which size cells are large enough; None if nothing."""
    entries = band_entries(body.equilibrium, free_unknowns(body.equilibrium))
    if entries <= BAND:
        return None
    x, cells = body.geometry.coordinates, body.geometry.cells
    edge = float(np.linalg.norm(x[cells[:, 0]] - x[cells[:, 1]], axis=1).mean()) / scale
    wanted = (size or edge) * coarser(MARGIN * entries / BAND, 3)
    digit = 10 ** (math.floor(math.log10(wanted)) - 1)
    return (
        f"the stiffness takes a band of {entries} entries, {BAND} at most for a page; expected "
        f"--size {math.ceil(wanted / digit) * digit:g} or more, or --network"
    )


class PageLimitError(WorkError):
    """A body is too large for the page of its load series, which are in a folder."""

    def __init__(self, limit: str, folder: Path) -> None:
        kept = f"body and load series are there: surrogate predict {folder / 'series'}"
        super().__init__(f"no page: {limit}; {kept}")
        self.folder = folder


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
    try:
        run_datagen("body", folder / "case.yaml", "--out", folder / "body")
    except InputError as error:
        raise InputError(str(error).replace(f"{folder / 'case.yaml'}", "case")) from None
    return Body.read(folder / "body")
