r"""Power series of the forces of loads that follow a body: pressures and cables.

Along :math:`x_0 + \sum_k s^k u_k`, with the undeformed body's :math:`x_0` and :math:`x_k = u_k`, a
load of the amplitude s a has forces of the order k, of which those of its unit forces are
:math:`g_{k-1}` (`shared_schema.common.bodies.following_loads`, `shared_schema.common.bodies.cables`
have the equations). Those of a pressure are polynomials of the displacement:

.. math:: f_{a,k} = -p \sum_q w_q N_a \sum_{i+j=k-1} t_1(x_i) × t_2(x_j).

In the plane there is one tangent, which is turned by 90°: i is 0. Those of a leg e of a cable,
:math:`-T \, n` with :math:`n = e / |e|`, are not: the terms of n follow from those of
:math:`|e|^{-1}`. Of a combination :math:`e = e_0 + \sum_k c_k e_k` they do the works

.. math:: -T \, n · e_m, \qquad
   \frac{∂}{∂c_l} (-T \, n · e_m) = -\frac{T}{|e|} \, e_m · (I - n n^T) \, e_l.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, NamedTuple, cast

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.sparse import csr_array, vstack
from torch import Tensor, nn

from shared_schema.common.bodies.distributed_loads import shape_functions
from shared_schema.common.bodies.following_loads import FollowingLoad, PressedSurface
from surrogate.mechanics.equilibrium.following_loads import FollowingLoads
from surrogate.mechanics.matrices.sparse_products import SparseProduct

if TYPE_CHECKING:
    from shared_schema.common.bodies.cables import Cable

Array = NDArray[np.float64]
CPU = torch.device("cpu")


class Works(NamedTuple):
    """What the works of following loads at a combination of n terms are made of.

    Attributes
    ----------
    pressed : Tensor, (N, n + 1, n + 1, n)
        `PressedFacets.works`; 0 without pressures.
    legs : Tensor, (N, n_legs, n + 1, d), or None
        Terms of the legs of cables in m, those at rest first.
    tensions : Tensor, (N, n_legs), or None
        In N.
    """

    pressed: Tensor
    legs: Tensor | None = None
    tensions: Tensor | None = None

    @property
    def at_rest(self) -> Tensor:
        """Works of the forces on the undeformed body, (N, n) in J."""
        return self.at(torch.zeros_like(self.pressed[:, 0, 0]))[0]

    def at(self, c: Tensor) -> tuple[Tensor, Tensor]:
        """Works on every term, (N, n) in J, and their derivatives by c, (N, n, n)."""
        p, moved = self.pressed, torch.cat([torch.ones_like(c[:, :1]), c], 1)
        of_state = torch.einsum("ni,nijm->njm", moved, p)
        works = torch.einsum("nj,njm->nm", moved, of_state)
        slopes = (of_state + torch.einsum("nj,nijm->nim", moved, p))[:, 1:].mT
        if self.legs is None or self.tensions is None:
            return works, slopes
        e, terms = torch.einsum("ni,nlid->nld", moved, self.legs), self.legs[:, :, 1:]
        length = e.norm(dim=2, keepdim=True)
        n, share = e / length, self.tensions[:, :, None]
        along = torch.einsum("nld,nlkd->nlk", n, terms)
        across = terms - along[..., None] * n[:, :, None]
        works = works - (share * along).sum(1)
        return works, slopes - torch.einsum(
            "nlkd,nlmd->nkm", (share / length)[..., None] * across, across
        )


class FollowingTerms(nn.Module):
    """Loads of unit amplitude on a body; its fields are (N, n_points, d).

    Parameters
    ----------
    coordinates : array, (n_points, d)
        Positions of the undeformed body's points in m.
    units : sequence of FollowingLoad
    """

    def __init__(self, coordinates: Array, units: Sequence[FollowingLoad]) -> None:
        super().__init__()
        surfaces = {i: u.facets for i, u in enumerate(units) if isinstance(u, PressedSurface)}
        cables = {i: cast("Cable", u) for i, u in enumerate(units) if i not in surfaces}
        self.facets = PressedFacets(coordinates, surfaces) if surfaces else None
        self.legs = CableLegs(coordinates, cables) if cables else None

    @classmethod
    def of(
        cls, following: FollowingLoads | None, device: torch.device = CPU
    ) -> tuple[FollowingTerms, Tensor] | tuple[None, None]:
        """Loads and amplitudes, (N, n), of some load cases; None if all are 0."""
        if following is None or not following.amplitudes.any():
            return None, None
        units = cls(following.coordinates, following.units)
        return units.to(device), torch.tensor(following.amplitudes, device=device)

    def term(self, amplitudes: Tensor, u: Sequence[Tensor]) -> Tensor:
        """Forces in N of the order after that of the last of some terms u₁, u₂, … in m.

        Amplitudes are (N, n) in Pa or N.
        """
        found = [part.term(amplitudes, u) for part in (self.facets, self.legs) if part is not None]
        return found[0] if len(found) == 1 else found[0] + found[1]

    def works(self, amplitudes: Tensor, u: Sequence[Tensor]) -> Works:
        """Works in J of the forces on n terms, at all their combinations."""
        n = len(u)
        if self.facets is None:
            pressed = u[0].new_zeros(u[0].shape[0], n + 1, n + 1, n)
        else:
            pressed = self.facets.works(amplitudes, u)
        if self.legs is None:
            return Works(pressed)
        return Works(pressed, self.legs.terms(u), self.legs.of_legs(amplitudes))


class CableLegs(nn.Module):
    """Straight parts of some cables, which are the rows of a matrix.

    Parameters
    ----------
    coordinates : array, (n_points, d)
        Positions of the undeformed body's points in m.
    cables : mapping of int to Cable
        By the number of the amplitude.
    """

    at_rest: Tensor
    cable: Tensor

    def __init__(self, coordinates: Array, cables: Mapping[int, Cable]) -> None:
        super().__init__()
        legs = csr_array(vstack([cable.legs for cable in cables.values()]))
        rest = np.concatenate(
            [np.diff(cable.places(coordinates), axis=0) for cable in cables.values()]
        )
        of_legs = np.repeat(list(cables), [cable.legs.shape[0] for cable in cables.values()])
        self.register_buffer("at_rest", torch.tensor(rest), persistent=False)
        self.register_buffer("cable", torch.tensor(of_legs), persistent=False)
        self.along = SparseProduct(legs, torch.float64)
        self.sums = SparseProduct(csr_array(legs.T), torch.float64)

    def terms(self, u: Sequence[Tensor]) -> Tensor:
        """Terms of the legs in m, those at rest first: (N, n_legs, n + 1, d)."""
        moved = [self.along(each.transpose(0, 1).flatten(1)) for each in u]
        of_terms = [each.reshape(len(each), *u[0].shape[::2]).transpose(0, 1) for each in moved]
        return (
            torch.stack([self.at_rest.expand_as(of_terms[0]), *of_terms], 2)
            if u
            else (self.at_rest[None, :, None])
        )

    def of_legs(self, amplitudes: Tensor) -> Tensor:
        """Tension of every leg: (N, n) → (N, n_legs) in N."""
        return amplitudes.index_select(1, self.cable)

    def term(self, amplitudes: Tensor, u: Sequence[Tensor]) -> Tensor:
        """As `FollowingTerms.term`."""
        e, orders = self.terms(u), range(1, len(u) + 1)
        squares = [(e[:, :, : k + 1] * e[:, :, : k + 1].flip(2)).sum((2, 3)) for k in (0, *orders)]
        inverse = [squares[0] ** -0.5]
        for k in orders:
            parts = [(j / (2 * k) - 1) * squares[j] * inverse[k - j] for j in range(1, k + 1)]
            inverse.append(torch.stack(parts).sum(0) / squares[0])
        unit = (torch.stack(inverse[::-1], 2)[..., None] * e).sum(2)
        pulls = -self.of_legs(amplitudes)[..., None] * unit
        sums: Tensor = self.sums(pulls.transpose(0, 1).flatten(1))
        return sums.reshape(sums.shape[0], pulls.shape[0], -1).transpose(0, 1)


class PressedFacets(nn.Module):
    """Facets of some surfaces of a body under pressure.

    Parameters
    ----------
    coordinates : array, (n_points, d)
        Positions of the undeformed body's points in m.
    surfaces : mapping of int to array of int, (n_facets, n_corners)
        Facets of every surface, seen from outside, by the number of the amplitude.
    """

    facets: Tensor
    at_rest: Tensor
    weighted: Tensor
    gradients: Tensor
    surface: Tensor

    def __init__(self, coordinates: Array, surfaces: Mapping[int, NDArray[np.int64]]) -> None:
        super().__init__()
        facets, d = np.concatenate(list(surfaces.values())), coordinates.shape[1]
        values, gradients, weights = shape_functions(facets.shape[1], d)
        sizes = [len(surface) for surface in surfaces.values()]
        for name, array in (
            ("facets", facets),
            ("weighted", weights[:, None] * values),
            ("gradients", gradients),
            ("surface", np.repeat(list(surfaces), sizes)),
        ):
            self.register_buffer(name, torch.tensor(array), persistent=False)
        at_rest = self.tangents(torch.tensor(coordinates[None]))
        self.register_buffer("at_rest", at_rest, persistent=False)
        rows, shape = facets.ravel(), (len(coordinates), facets.size)
        incidence = csr_array((np.ones(facets.size), (rows, np.arange(facets.size))), shape)
        self.sums = SparseProduct(incidence, torch.float64)

    def tangents(self, u: Tensor) -> Tensor:
        """Tangents of the facets: (N, n_points, d) in m → (N, n_facets, n_quadrature, d - 1, d)."""
        return torch.einsum("qat,nfad->nfqtd", self.gradients, self._of_facets(u))

    def term(self, amplitudes: Tensor, u: Sequence[Tensor]) -> Tensor:
        """As `FollowingTerms.term`."""
        tangents, k = [self.at_rest, *map(self.tangents, u)], len(u)
        normals = cross(tangents[0], tangents[k])
        for i in range(1, k + 1) if normals.shape[-1] == 3 else ():
            normals = normals + cross(tangents[i], tangents[k - i])
        normals = self._pushing(amplitudes)[:, :, None, None] * normals
        of_facets = torch.einsum("qa,nfqd->fand", self.weighted, normals)
        sums: Tensor = self.sums(of_facets.flatten(0, 1).flatten(1))
        return sums.reshape(len(sums), *normals.shape[::3]).transpose(0, 1)

    def works(self, amplitudes: Tensor, u: Sequence[Tensor]) -> Tensor:
        r"""Works :math:`-p \sum_q w_q (t_1(x_i) × t_2(x_j)) · u_m` of n terms in J.

        (N, n + 1, n + 1, n) of i, j, m.
        """
        of_terms = torch.stack([self.tangents(each) for each in u], 1)
        tangents = torch.cat(
            [self.at_rest.expand(u[0].shape[0], 1, *of_terms.shape[2:]), of_terms], 1
        )
        moved = [torch.einsum("qa,nfad->nfqd", self.weighted, self._of_facets(each)) for each in u]
        moved_by = self._pushing(amplitudes)[:, None, :, None, None] * torch.stack(moved, 1)
        rows = []
        for i in range(tangents.shape[1]):
            normals = cross(tangents[:, i : i + 1], tangents)
            of_row = torch.einsum("njfqd,nmfqd->njm", normals, moved_by)
            rows.append(of_row if i == 0 or normals.shape[-1] == 3 else 0 * of_row)
        return torch.stack(rows, 1)

    def _of_facets(self, u: Tensor) -> Tensor:
        """Fields at the points of the facets: (N, n_points, d) → (N, n_facets, n, d)."""
        rows = u.index_select(1, self.facets.flatten())
        return rows.reshape(-1, *self.facets.shape, u.shape[2])

    def _pushing(self, amplitudes: Tensor) -> Tensor:
        """−p of every facet: (N, n) → (N, n_facets)."""
        return -amplitudes.index_select(1, self.surface)


def cross(a: Tensor, b: Tensor) -> Tensor:
    """First tangent of A × second one of B; in the plane, the tangent of B turned: (…, d)."""
    if b.shape[-1] == 3:
        return torch.linalg.cross(a[..., 0, :], b[..., 1, :], dim=-1)
    t = b[..., 0, :]
    return torch.stack([t[..., 1], -t[..., 0]], -1)
