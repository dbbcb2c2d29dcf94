r"""The network of a page: an ONNX file that is small enough, given the linear response.

A body whose stiffness is too large to be factorised on a page is drawn as its surface. The unit
loads f_k are a body force along each axis, if the case has one, and a force along each axis about
each of some places. Under the load :math:`\sum_k x_k f_k` a reduced network
(`surrogate.learning.networks.reduced_network`) predicts at the nodes of the surface

.. math:: U = x S + N(x A) \, V, \qquad S = (U_{lin}(f_k)), \quad A = (Φ^T U_{lin}(f_k))

with one product of a row and a matrix for each of S and V. Both are kept in 16 bits.
"""

from __future__ import annotations

import tempfile
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from shared_schema.common.errors import InputError
from surrogate.learning.inference.export import export_network, responses, save_function
from surrogate.learning.inference.surrogate import Surrogate
from surrogate.learning.networks.field_network import at_points, on_grid
from surrogate.learning.networks.reduced_at_nodes import encoder_of_forces
from surrogate.learning.networks.reduced_network import ReducedNetwork
from surrogate.learning.probabilistic.gaussian_parameter import GaussianParameter
from surrogate.mechanics.body.geometry import Geometry
from surrogate.mechanics.equilibrium.compliance import DENSE
from surrogate.mechanics.series.series_response import SeriesResponse
from surrogate.page.page_loads import Arrays, PageLoads, patches_of, volumes_of

PLACES = 100  # places that can be touched, at most
AT_ONCE = 48  # unit loads that are solved for at once
PATCH = 12_000  # bytes of the weights of a patch, that of a thousand nodes
SHORT = 2**15 - 1  # largest 16-bit number
OF_NODES = ("coordinates", "held", "clamped", "loadable", "volumes")  # arrays by node
NUMBERS = ("lines", "features", "vertices", "patches/nodes")  # arrays of node numbers
Integers = NDArray[np.int64]
PASSES = 30  # of all members together: 20 frames a second in the plane
FEWEST = 2  # passes of a member; one has no standard deviation


class Rows(nn.Module):
    """Rows of a matrix in 16 bits, each in a unit of its own: x ↦ x M.

    Parameters
    ----------
    matrix : Tensor, (n_rows, n_columns)
    """

    values: Tensor
    unit: Tensor

    def __init__(self, matrix: Tensor) -> None:
        super().__init__()
        unit = matrix.abs().amax(dim=1) / SHORT
        rounded = (matrix / torch.where(unit > 0, unit, 1.0)[:, None]).round()
        self.register_buffer("values", rounded.to(torch.int16))
        self.register_buffer("unit", unit.float())

    def forward(self, x: Tensor) -> Tensor:
        """Multiply: (N, n_rows) → (N, n_columns)."""
        return (x * self.unit) @ self.values.float()


class SurfaceNetwork(nn.Module):
    """Displacements of some nodes in m, from the sizes of unit loads.

    Parameters
    ----------
    surrogate : Surrogate
        A deterministic reduced network on the nodes themselves.
    units : array, (q, n_nodes, d)
        Nodal forces of the unit loads.
    nodes : array of int, (n,)
    """

    encoder: Tensor

    def __init__(self, surrogate: Surrogate, units: NDArray[np.float64], nodes: Integers) -> None:
        super().__init__()
        network, nodal = surrogate.network, surrogate.predictor.network
        reduced = network.network
        assert isinstance(reduced, ReducedNetwork)
        self.reduced, self.d = reduced, units.shape[2]
        encoded, response, encoder = [], [], encoder_of_forces(nodal)
        for start in range(0, len(units), AT_ONCE):
            force = torch.from_numpy(units[start : start + AT_ONCE])
            grid = nodal.on_grid(force.float()) / network.force_scale
            encoded.append(at_points(grid, reduced.points) @ encoder.T)
            response.append(responses(surrogate, force)[:, nodes].flatten(1).float())
        self.register_buffer("encoder", torch.cat(encoded))
        self.response = Rows(torch.cat(response))
        modes = on_grid(reduced.modes, reduced.points, grid[:1])
        modes = nodal.at_nodes(modes * network.displacement_scale * network.movable)
        self.modes = Rows(modes.transpose(1, 2)[:, nodes].flatten(1))

    def forward(self, load: Tensor) -> dict[str, Tensor]:
        """Predict displacements, (N, n, d), from sizes of the unit loads, (N, q)."""
        found = self.response(load) + self.modes(self.reduced.corrected(load @ self.encoder))
        return {"displacement": found.reshape(load.shape[0], -1, self.d)}


def fits(surrogate: Surrogate) -> bool:
    """Whether `SurfaceNetwork` is for a network."""
    network = surrogate.network
    is_reduced = isinstance(network.network, ReducedNetwork)
    plain = is_reduced and not surrogate.is_probabilistic
    return plain and network.skip and surrogate.geometry.grid.points_are_nodes


def surface_arrays(arrays: Arrays, nodes: Integers) -> Arrays:
    """Arrays of a page (`drawn`, `load_arrays`) of some nodes alone, those of the surface."""
    number = np.full(len(arrays["coordinates"]), -1, dtype=np.int32)
    number[nodes] = np.arange(len(nodes))
    found = dict(arrays) | {name: arrays[name][:0] for name in ("cells", "seams")}
    found |= {name: arrays[name][nodes] for name in OF_NODES if name in arrays}
    found |= {name: number[arrays[name]] for name in NUMBERS if name in arrays}
    if "patches/starts" in arrays:
        starts = arrays["patches/starts"]
        found["patches/starts"] = np.append(starts[nodes], starts[-1:])
    return found


def unit_loads(geometry: Geometry, loads: PageLoads, places: Integers) -> NDArray[np.float64]:
    """Nodal forces of the unit loads, (q, n_nodes, d): of body forces, then about the places."""
    about = patches_of(geometry, loads.radius, places).toarray()
    rows = about if loads.density is None else np.vstack([volumes_of(geometry), about])
    units = np.einsum("kn,ij->kinj", rows, np.eye(geometry.dimension))
    return np.asarray(units.reshape(-1, *geometry.coordinates.shape) * geometry.free)


def spread_places(geometry: Geometry, surface: NDArray[np.int64], most: int) -> NDArray[np.int64]:
    """Choose nodes of a surface that lie as far from one another as possible."""
    nodes = surface[(geometry.loadable & ~geometry.clamped)[surface]]
    x = geometry.coordinates[nodes]
    distance = np.linalg.norm(x - x.mean(axis=0), axis=1)
    chosen: list[int] = []
    while len(chosen) < min(most, len(nodes)):
        chosen.append(int(distance.argmax()))
        to_last = np.linalg.norm(x - x[chosen[-1]], axis=1)
        distance = to_last if len(chosen) == 1 else np.minimum(distance, to_last)
    return np.sort(nodes[chosen])


def surface_network(
    surrogate: Surrogate, loads: PageLoads, nodes: Integers, largest: int
) -> tuple[PageNetwork, Integers]:
    """Make the network of a large body's page, and choose the places that can be touched.

    Parameters
    ----------
    surrogate : Surrogate
        For which `fits` is true.
    loads : PageLoads
    nodes : array of int
        Nodes of the surface, which the network predicts for.
    largest : int
        Bytes that the file may have; as many places are chosen as fit, `PLACES` at most.

    Returns
    -------
    network : PageNetwork
        Its input is ``load``, the sizes of the unit loads, (samples, q).
    places : array of int

    Raises
    ------
    InputError
        If no place fits.
    """
    reduced, geometry = surrogate.network.network, surrogate.geometry
    d = geometry.dimension
    row = 2 * d * len(nodes)  # bytes of the displacements of the surface
    weights = sum(p.nbytes for p in reduced.parameters())
    fixed = weights + row * len(reduced.get_buffer("modes"))
    fixed += 0 if loads.density is None else d * row
    most = min(PLACES, (largest - fixed) // (d * row + PATCH))
    if most < 1:
        raise InputError(
            f"page: the network of the surface takes {fixed / 1e6:.1f} MB, expected "
            f"{largest / 1e6:.1f} MB at most on a page"
        )
    places = spread_places(geometry, nodes, most)
    with torch.no_grad():
        function = SurfaceNetwork(surrogate, unit_loads(geometry, loads, places), nodes).eval()
    for name in ("encoder", "modes", "truncation"):
        setattr(reduced, name, reduced.get_buffer(name)[..., :0])  # the file does not need them
    function.requires_grad_(False)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "network.onnx"
        example = torch.zeros(2, len(function.encoder))
        save_function(function, (example,), ("load",), "onnx", path)
        return PageNetwork(path.read_bytes(), None), places


@dataclass(frozen=True)
class PageNetwork:
    """A network for the page.

    Attributes
    ----------
    content : bytes
        ONNX file.
    passes : int or None
        Number of passes T of every member; None for a network that is not stochastic.
    """

    content: bytes
    passes: int | None


NO_NETWORK = PageNetwork(b"", None)


def page_network(surrogate: Surrogate, largest: int) -> PageNetwork:
    """Export the network, with as many passes as fit; the surrogate cannot be used afterwards.

    Parameters
    ----------
    surrogate : Surrogate
    largest : int
        Bytes that the file may have.

    Raises
    ------
    InputError
        If the network is larger, with two passes if it is stochastic, or on the load series of a
        body without dense K⁻¹, whose solves are too slow.
    """
    linear = surrogate.network.linear
    if isinstance(linear, SeriesResponse) and linear.precision == torch.float32:
        raise InputError(
            f"page: the network's load series needs a body of at most {DENSE} degrees of freedom, "
            f"found {surrogate.geometry.coordinates.size}; 'model: reduced' and 'series' are for "
            "larger ones"
        )
    weights = sum(p.nbytes for p in surrogate.network.parameters())
    weights += sum(b.nbytes for b in surrogate.network.network.buffers())
    passes = None
    if surrogate.is_stochastic:
        passes, weights = fitting_passes(surrogate, weights, largest)
    if weights > largest:
        with_passes = "" if passes is None else f" with {passes} passes"
        raise InputError(
            f"page: the network takes {weights / 1e6:.1f} MB{with_passes}, expected "
            f"{largest / 1e6:.1f} MB at most on a page"
        )
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "network.onnx"
        export_network(surrogate, "onnx", path, passes, response_given=True)
        return PageNetwork(path.read_bytes(), passes)


def fitting_passes(surrogate: Surrogate, weights: int, largest: int) -> tuple[int, int]:
    """Return the number of passes that fit, 2 at least, and the bytes of their weights."""
    gaussian = [m for m in surrogate.network.modules() if isinstance(m, GaussianParameter)]
    drawn = sum(m.mean.nbytes for m in gaussian)
    fixed = weights - sum(p.nbytes for m in gaussian for p in m.parameters())
    passes = max(FEWEST, PASSES // surrogate.network.members)
    if drawn:
        passes = max(FEWEST, min(passes, (largest - fixed) // drawn))
    return passes, fixed + passes * drawn
