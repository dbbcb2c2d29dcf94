"""The page of a run: body, network, mechanics and script in one HTML file.

The network gets forces and, where it contains the linear response K⁻¹f, that as a second input.
Neither K⁻¹ nor a factor of K is in the file: the page assembles K from mesh, elements and the
recordings of the materials (`surrogate.page.body`) and factorises it. Where the response of
the body is all there is (`model: series`), the page has no network and computes it alone.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import torch
from jinja2 import Environment, FileSystemLoader, StrictUndefined
from numpy.typing import NDArray

from shared_schema.common.arguments import checked_arguments
from shared_schema.common.errors import InputError
from shared_schema.common.files import require_writable, write_text
from shared_schema.common.solution_file import require_suffix
from surrogate.learning.inference.export import require_packages
from surrogate.learning.inference.loading import load
from surrogate.learning.inference.surrogate import Surrogate
from surrogate.learning.probabilistic.distribution import Moments
from surrogate.learning.training.loop import train
from surrogate.mechanics.actuation.actuation import Actuation
from surrogate.mechanics.body.stiffness import modulus_at_rest
from surrogate.page.body import BAND, below, coarser, drawn, is_alone, mechanics_of
from surrogate.page.bundle import read_bundle
from surrogate.page.inlined import in_base64, inlined, packed
from surrogate.page.page_actuators import actuator_data
from surrogate.page.page_loads import Arrays, load_arrays, page_loads
from surrogate.page.page_motion import motion_data
from surrogate.page.page_network import (
    NO_NETWORK,
    fits,
    page_network,
    surface_arrays,
    surface_network,
)

LARGEST = 25_000_000  # bytes of a page
BASE64 = 4 / 3  # its characters a byte
SPHERE = 0.07  # of the body's diagonal

PAGES = Environment(
    loader=FileSystemLoader(Path(__file__).parent), autoescape=True, undefined=StrictUndefined
)


@dataclass(frozen=True)
class Written:
    """What was written.

    Attributes
    ----------
    size : int
        Bytes of the page.
    passes : int or None
        Number of passes of a stochastic network.
    estimates : bool
        True if the page estimates errors.
    """

    size: int
    passes: int | None
    estimates: bool

    def summary(self) -> str:
        """Describe the page in a line."""
        passes = "" if self.passes is None else f", {self.passes} passes of the network"
        estimates = "" if self.estimates else ", no estimated errors"
        return f"{self.size / 1e6:.1f} MB{passes}{estimates}"


@checked_arguments
def write_page(
    run: str | Path,
    out: str | Path,
    *,
    patch: float | None = None,
    largest: int = LARGEST,
    parameters: Mapping[str, float] | None = None,
    density: float | None = None,
) -> Written:
    """Write the page of a run: one HTML file, on which the body follows a dragged load.

    Parameters
    ----------
    run : str or Path
        Run folder, or the name of a network that comes with the package; or the folder of a body,
        for its load series. On bodies with actuators, modes predict
        (`surrogate.Actuation.of_folder`) in place of the run.
    out : str or Path
        File to write; it ends in .html.
    patch : float, optional
        Radius in m of the part of the surface that a dragged force is spread over; 0 for a force on
        a node. By default it is that of the case's loads (`surrogate.page.page_loads`).
    largest : int
        Bytes that the page may have.
    parameters : mapping of str to float, optional
        Those of the body's shape, of a family of shapes.
    density : float, optional
        In kg/m³, of a body that moves over time; by default, that of its materials. Without one it
        does not.

    Raises
    ------
    InputError
        If there is no finished run, the file's name, the radius or the density is wrong, the page's
        script is not built, the mesh has no surface, or body or network are too large for a page.
    """
    path = Path(out)
    require_suffix(path, (".html",))
    require_writable(path)
    bundle, surrogate = read_bundle(), surrogate_of(run)
    surrogate = surrogate.of_shape(parameters) if parameters else surrogate
    order, mechanics = series_order(surrogate), mechanics_of(surrogate)
    if mechanics.band and not fits(surrogate):
        factor = coarser(mechanics.band / BAND, surrogate.geometry.dimension)
        larger = math.ceil(100 * factor + 1) / 100
        raise InputError(
            f"page: the body's stiffness takes a band of {mechanics.band} entries, expected {BAND} "
            "at most, or a deterministic reduced network, for a page; a mesh of cells "
            f"{larger:.2f} times as large takes about that"
        )
    if order == 0:
        require_packages("onnx")
    loads = page_loads(surrogate, patch)
    geometry, arrays = surrogate.geometry, drawn(surrogate.geometry) | mechanics.arrays
    content = described(surrogate, run)
    body = mechanics.body
    if body is None and density is not None:
        raise InputError("density: expected none for a page without estimated errors, or motion")
    if body is not None:
        moving, masses = motion_data(surrogate.body, density)
        body, arrays = body | moving, arrays | below("body", masses)
    content |= {"body": body, "response": mechanics.response}
    content |= {"pressed": mechanics.pressed, "largestPressures": mechanics.pressures}
    content |= {"largest": loads.largest, "patch": loads.radius, "density": loads.density}
    content |= {"series": order, "places": None, "actuation": None}
    if geometry.actuators is not None and not mechanics.band:
        model = Actuation.of_folder(surrogate.folder or run, surrogate.body)
        content["actuation"], of_actuators = actuator_data(model)
        content["network"] = f"{len(model.reduced.modes)} modes of the actuators"
        arrays |= below("actuation", of_actuators)
    extents = np.ptp(geometry.coordinates, axis=0)
    content |= {"extent": float(extents.max()), "radius": loads.radius or sphere_radius(extents)}
    parts = {"style": bundle.style, "script": bundle.script}
    parts["runtime"] = "" if order else in_base64(bundle.runtime)

    def put(arrays: Arrays) -> int:
        """Put arrays on the page; return the bytes that a network may have beside them."""
        content["arrays"], block = packed(arrays)
        parts["arrays"] = inlined(block)
        return int((largest - sum(len(part.encode()) for part in parts.values())) / BASE64)

    if mechanics.band:
        surface = np.unique(arrays["vertices"])
        left = put(surface_arrays(arrays, surface))
        network, places = surface_network(surrogate, loads, surface, left)
        put(surface_arrays(arrays | load_arrays(geometry, loads, places), surface))
        content |= {"loads": None, "needsResponse": False}
        content["places"] = np.searchsorted(surface, places).tolist()
    else:
        everywhere = np.arange(len(geometry.coordinates))
        left = put(arrays | load_arrays(geometry, loads, everywhere))
        network = NO_NETWORK if order else page_network(surrogate, left)
    content["passes"] = network.passes
    page = PAGES.get_template("page.html.j2").render(
        content=content,
        d=geometry.dimension,
        responds=mechanics.body or mechanics.response,
        moves=body is not None and "motion" in body,
        pressed=[name or f"surface {i}" for i, name in enumerate(mechanics.pressed, 1)],
        modulus=f"{float(f'{young_modulus(surrogate) or 0:.3g}'):g}",
        text=json.dumps(content, separators=(",", ":")).replace("<", "\\u003c"),
        network=inlined(network.content) if network.content else "",
        **parts,
    )
    size = len(page.encode())
    if size > largest:
        raise InputError(f"page: {size / 1e6:.1f} MB, expected {largest / 1e6:.1f} MB at most")
    write_text(path, page)
    return Written(size, network.passes, mechanics.body is not None)


def surrogate_of(run: str | Path) -> Surrogate:
    """The surrogate of a run, or the load series of a body's folder."""
    folder = Path(run)
    if (folder / "config.yaml").is_file() or not (folder / "manifest.json").is_file():
        return load(run)
    with TemporaryDirectory() as made:
        series = train("series", folder, made)
    series.folder = folder
    return series


def young_modulus(surrogate: Surrogate) -> float | None:
    """Young's modulus at rest in Pa, which a page changes; None if the page does not.

    That is for a body of several materials, or of one's own, and for one with actuators.
    """
    if surrogate.geometry.actuators is not None:
        return None
    try:
        return modulus_at_rest(surrogate.description.data.material)
    except InputError:
        return None


def sphere_radius(extents: NDArray[np.float64]) -> float:
    """Radius in m of a sphere that pushes a body of some extents, of one digit."""
    return float(f"{SPHERE * np.linalg.norm(extents):.0e}")


def series_order(surrogate: Surrogate) -> int:
    """Order of the load series that a page computes in place of a network; 0 for a network."""
    if not is_alone(surrogate):
        return 0
    return int(getattr(surrogate.description.run, "series_order", 1))


def described(surrogate: Surrogate, run: str | Path) -> dict[str, Any]:
    """Names, kinds and training range, as plain data."""
    config, data = surrogate.description.run, surrogate.description.data
    return {
        "case": config.case,
        "network": config.architecture,
        "run": str(run),
        "units": data.units.model_dump(),
        "corners": surrogate.geometry.cells.shape[1],
        "needsResponse": surrogate.network.linear is not None and series_order(surrogate) == 0,
        "deviations": deviations(surrogate),
        "youngModulus": young_modulus(surrogate),
        "limit": list(data.info.force.max_abs),
        "loads": None if data.loads is None else data.loads.model_dump(),
    }


def deviations(surrogate: Surrogate) -> dict[str, str]:
    """Outputs of the network that are standard deviations: kind, "epistemic" or "aleatoric"."""
    config = surrogate.description.run
    if not surrogate.is_probabilistic:
        return {}
    if surrogate.network.members == 1 and not surrogate.is_stochastic:
        unit = torch.ones(1)
        only_noise = config.distribution(Moments(1, unit, 0 * unit, unit))
        return {"std": "aleatoric" if bool(only_noise.std_aleatoric) else "epistemic"}
    kinds = ["epistemic"]
    if config.likelihood != "deterministic":
        kinds.append("aleatoric")
    return {f"std_{kind}": kind for kind in kinds}
