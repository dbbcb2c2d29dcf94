r"""A network that maps nodal fields of a mesh: a field network with maps to and from the grid.

Fields that are interpolated on a grid are held exactly at supports, and continuous beside them:

.. math:: u_s \to 0, \qquad u_i \to u_i - \sum_s E_{is} u_s

The values :math:`u_s` of a field at held nodes s are its errors there. They are taken off, and with
them, at the nodes i around, their extension E: the solution of the screened Poisson equation
:math:`e - ℓ^2 Δe = 0` with :math:`e_s = u_s`, which decays within a few ℓ, a step of the grid. So a
field that is right at the supports stays as it is, and one that is not has no jump there. The
Laplacian is that of the graph of the mesh's edges with weights :math:`1 / |x_i - x_j|^2`, so that E
is positive and :math:`\sum_s E_{is} < 1`.
"""

from __future__ import annotations

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.sparse import coo_array, csc_array, diags
from scipy.sparse.linalg import splu
from torch import Tensor, nn
from torch.nn import functional

from shared_schema.grid import Grid
from surrogate.learning.networks.field_network import FieldNetwork
from surrogate.learning.probabilistic.likelihoods import Prediction
from surrogate.mechanics.body.geometry import Geometry
from surrogate.mechanics.matrices.sparse_products import WeightedSums, matrix_of

Array = NDArray[np.float64]
STEPS = 1.0  # ℓ in steps of the grid
NEGLIGIBLE = 1e-3  # share of an error at the supports that is left where it is


class HeldNodes(nn.Module):
    r"""Sets held components of nodal fields to zero.

    Parameters
    ----------
    geometry : Geometry
        Body on an embedded grid.
    steps : float
        Length ℓ in steps of the grid.

    Attributes
    ----------
    share : Tensor, (1, n_nodes) or (d, n_nodes)
        :math:`1 - \sum_s E_{is}`, the factor on standard deviations: 0 at held components, 1 far
        from them.
    """

    share: Tensor

    def __init__(self, geometry: Geometry, steps: float = STEPS) -> None:
        super().__init__()
        x, shape = geometry.coordinates, np.asarray(geometry.grid.shape)
        length = steps * float((np.ptp(x, axis=0) / (shape - 1)).mean())
        laplacian, screening = screened_laplacian(x, geometry.cells, length)
        sets = geometry.held.T if geometry.single is not None else geometry.clamped[None]
        extensions = [Extension(laplacian + screening, held) for held in sets]
        self.extensions = nn.ModuleList(extensions)
        shares = [extension.share for extension in extensions]
        self.register_buffer("share", torch.stack(shares), persistent=False)

    def forward(self, fields: Tensor) -> Tensor:
        """Hold the supports of fields, (N, d, n_nodes)."""
        if len(self.extensions) == 1:
            return torch.as_tensor(self.extensions[0](fields))
        of_components = zip(self.extensions, torch.split(fields, 1, dim=1), strict=True)
        return torch.cat([extension(field) for extension, field in of_components], dim=1)


class Extension(nn.Module):
    """Values at held nodes, extended to the nodes around and taken off.

    Parameters
    ----------
    matrix : csc_array, (n_nodes, n_nodes)
        Screened Laplacian.
    held : array of bool, (n_nodes,)

    Attributes
    ----------
    held : Tensor of int, (n_held,)
    near : Tensor, (n_near, n_held)
        Rows of E that are not negligible, of free nodes.
    row : Tensor of int, (n_nodes,)
        Number of each node's row, n_near of those that have none.
    free : Tensor, (n_nodes,)
        1 at free nodes, else 0.
    """

    held: Tensor
    near: Tensor
    row: Tensor
    free: Tensor

    def __init__(self, matrix: csc_array, held: NDArray[np.bool_]) -> None:
        super().__init__()
        free, at = np.flatnonzero(~held), np.flatnonzero(held)
        extended = np.zeros((len(free), len(at)))
        if held.any() and len(free):
            sides = -matrix[free][:, at].toarray()
            extended = splu(csc_array(matrix[free][:, free])).solve(sides)
        is_near = extended.sum(axis=1) > NEGLIGIBLE
        row = np.full(len(held), np.count_nonzero(is_near))
        row[free[is_near]] = np.arange(np.count_nonzero(is_near))
        near = torch.from_numpy(extended[is_near]).float()
        self.register_buffer("held", torch.from_numpy(at), persistent=False)
        self.register_buffer("near", near, persistent=False)
        self.register_buffer("row", torch.from_numpy(row), persistent=False)
        self.register_buffer("free", torch.from_numpy(~held).float(), persistent=False)

    def forward(self, fields: Tensor) -> Tensor:
        """Hold fields (N, channels, n_nodes)."""
        errors = functional.linear(fields.index_select(2, self.held), self.near)
        padded = functional.pad(errors, (0, 1))
        return fields * self.free - padded.index_select(2, self.row)

    @property
    def share(self) -> Tensor:
        """Factor on standard deviations, (n_nodes,)."""
        return self.free - functional.pad(self.near.sum(dim=1), (0, 1))[self.row]


def screened_laplacian(
    coordinates: Array, cells: NDArray[np.int64], length: float
) -> tuple[csc_array, csc_array]:
    r"""Laplacian of the graph of a mesh, and its screening.

    A node with n neighbours has the screening :math:`n / (2 d ℓ^2)`: on a regular grid, where
    :math:`n = 2 d`, both together are :math:`-Δ + 1/ℓ^2`.

    Parameters
    ----------
    coordinates : array, (n_nodes, d)
        In m.
    cells : array of int, (n_cells, n_corners)
    length : float
        ℓ in m.

    Returns
    -------
    csc_array, (n_nodes, n_nodes)
        Both in 1/m².
    """
    n, d = coordinates.shape
    corners = cells.shape[1]
    first, second = np.repeat(cells, corners, axis=1).ravel(), np.tile(cells, corners).ravel()
    pairs = np.unique(np.stack([first, second])[:, first != second], axis=1)
    weights = 1 / np.square(coordinates[pairs[0]] - coordinates[pairs[1]]).sum(axis=1)
    graph = coo_array((weights, (pairs[0], pairs[1])), shape=(n, n)).tocsc()
    neighbours = np.bincount(pairs[0], minlength=n)
    laplacian = csc_array(diags(np.asarray(graph.sum(axis=1)).ravel())) - graph
    return laplacian, csc_array(diags(neighbours / (2 * d * length**2)))


class NodalNetwork(nn.Module):
    """A network that maps nodal forces in N to nodal displacements in m.

    Nodal displacements are u = B U, from the displacements U on the grid. Forces on the grid are
    F = Bᵀ f, from the nodal forces f (`shared_schema.grid`). On an embedded grid, where a node's
    displacement is interpolated, supports are held at the nodes, and a linear response in U is
    taken at the nodes, where it is exact (`at_nodes`).

    Parameters
    ----------
    network : FieldNetwork
    grid : Grid
    held : HeldNodes, optional
        Supports of a body on an embedded grid.
    """

    def __init__(self, network: FieldNetwork, grid: Grid, held: HeldNodes | None = None) -> None:
        super().__init__()
        self.network, self.held = network, held
        self.shape = grid.shape
        to_nodes = matrix_of(grid.points, grid.point_weights, int(np.prod(grid.shape)))
        self.to_nodes, self.to_grid = WeightedSums(to_nodes), WeightedSums(to_nodes.T.tocsr())

    def forward(self, force: Tensor, passes: int = 1, response: Tensor | None = None) -> Prediction:
        """Predict with one pass, or with several drawn passes (`probabilistic.stochastic_passes`).

        Parameters
        ----------
        force : Tensor, (N, n_nodes, d)
            Nodal forces in newtons.
        passes : int
            Number of drawn passes T.
        response : Tensor, (N, n_nodes, d), optional
            The linear response to these forces in m, if it is known; otherwise it is computed.

        Returns
        -------
        Prediction
            Fields (K·T, N, n_nodes, d) in m; K is the number of members of the ensemble.
        """
        grid, linear = self.on_grid(force), None
        if response is not None:
            linear = response.transpose(1, 2)
        elif self.held is not None:
            linear = self.linear_response(grid)
        mean, std = self.network(grid, passes, linear)
        count = self.network.members * passes

        def by_pass(nodal: Tensor) -> Tensor:
            return nodal.transpose(1, 2).reshape(count, *force.shape)

        found = by_pass(self.at_nodes(mean, linear))
        if std is None:
            return Prediction(found, None)
        spread = self.to_nodes(std.flatten(2))
        if self.held is not None:
            spread = spread * self.held.share
        return Prediction(found, by_pass(spread) * self.factors(force)[0])

    def linear_response(self, grid: Tensor) -> Tensor | None:
        """Linear response in m to forces on the grid, (N, d, n_nodes), if the network adds to it.

        None if the network does not, or every node is a grid point, so that nothing needs it.
        """
        adds = self.held is not None and self.network.skip
        linear = self.network.linear if adds else None
        return None if linear is None else linear.at_nodes(grid)

    def at_nodes(self, fields: Tensor, linear: Tensor | None = None) -> Tensor:
        """Take displacements on the grid to the nodes: (M, d, nx, ny[, nz]) → (M, d, n_nodes).

        Parameters
        ----------
        fields : Tensor, (M, d, nx, ny[, nz])
            In m; M = K·T·N of N samples.
        linear : Tensor, (N, d, n_nodes), optional
            The linear response that they contain, if they do. On an embedded grid it takes the
            place of its interpolation, :math:`B U + (1 - B A) u_{lin}`.
        """
        nodal = self.to_nodes(fields.flatten(2))
        if self.held is None:
            return nodal
        if linear is not None and self.network.skip:
            assert self.network.linear is not None
            single = linear.float()
            rest = single - self.to_nodes(self.network.linear.to_grid(single))
            nodal = nodal + rest.repeat(nodal.shape[0] // max(rest.shape[0], 1), 1, 1)
        return torch.as_tensor(self.held(nodal))

    def on_grid(self, force: Tensor) -> Tensor:
        """Map nodal forces to the grid: (N, n_nodes, d) → (N, d, nx, ny[, nz])."""
        grid = self.to_grid(force.transpose(1, 2))
        return grid.reshape(*grid.shape[:2], *self.shape)

    def factors(self, force: Tensor) -> tuple[Tensor, Tensor]:
        r"""Return the factors on aleatoric and epistemic standard deviations, (N, 1, 1) each.

        They depend on the forces: :math:`(a c)^w, (b c)^w`, where c depends on the number of loaded
        nodes, :math:`w = \min(1, r^{-4})`, and r is the ratio of the largest force component to the
        largest one in training. So they are the fitted factors inside the training range, and tend
        to 1 outside it.
        """
        limit = self.network.force_scale * 3**0.5  # largest force component in training
        reach = force.abs().amax(dim=(1, 2), keepdim=True) / limit
        weight = reach.clamp(min=1).pow(-4)
        network, c = self.network, self.network.count_factor(force)[:, None, None]
        return (network.aleatoric_factor * c) ** weight, (network.epistemic_factor * c) ** weight
