"""The network of a page: an ONNX file that is small enough, given the linear response."""

from __future__ import annotations

import tempfile
from dataclasses import dataclass
from pathlib import Path

import torch

from shared_schema.common.errors import InputError
from surrogate.learning.inference.export import export_network
from surrogate.learning.inference.surrogate import Surrogate
from surrogate.learning.probabilistic.gaussian_parameter import GaussianParameter
from surrogate.mechanics.equilibrium.compliance import DENSE
from surrogate.mechanics.series.series_response import SeriesResponse

PASSES = 30  # of all members together: 20 frames a second in the plane
FEWEST = 2  # passes of a member; one has no standard deviation


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
