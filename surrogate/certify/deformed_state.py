r"""Stresses at one deformation, and their changes, at all quadrature points of N states at once.

Components come first: F is (d, d, n_points, N), with the points of a cell one after the other.
Arrays are NumPy's, or tensors on a GPU.
"""

from __future__ import annotations

from shared_schema.common.bodies.array_library import library_of
from shared_schema.common.bodies.polar_decomposition import Values, cofactors
from shared_schema.materials import NeoHookean


class State:
    """Stresses at one deformation, and their changes.

    Parameters
    ----------
    f : array, (d, d, n_points, N)
        Deformation gradients.
    material : NeoHookean

    Attributes
    ----------
    sound : array of bool, (N,)
        True where no point is inverted.
    """

    def __init__(self, f: Values, material: NeoHookean) -> None:
        cofactor = cofactors(f)
        j = (f[0] * cofactor[0]).sum(0)
        self.sound = (j > 0).all(axis=0)
        self._f, self._mu = f, material.lame_mu
        self._inverse = cofactor / j
        lam, term = material.lame_lambda, material.volumetric_term
        self._pressure, self._second = term.first(lam, j), term.second(lam, j)

    def stress(self) -> Values:
        """P = μ F + (J U' − μ) F⁻ᵀ in Pa."""
        return self._mu * self._f + (self._pressure - self._mu) * self._inverse

    def stress_change(self, h: Values) -> Values:
        """∂P/∂F : H = μ H + (μ − J U') F⁻ᵀ Hᵀ F⁻ᵀ + (J U' + J² U'') (F⁻ᵀ : H) F⁻ᵀ in Pa."""
        a = self._inverse
        trace = (a * h).sum((0, 1))
        turned = product(product(a, h.swapaxes(0, 1)), a)
        return self._mu * h + (self._mu - self._pressure) * turned + self._second * trace * a


class MeanDilationState:
    r"""The same where a cell changes its volume as a whole, by θ.

    With :math:`s = (θ / J)^{2/d}` and the derivatives of the energy of
    `surrogate.mechanics.solids.mean_dilation`,

    .. math::
        P = μ s \left(F - \tfrac{I_1}{d} F^{-T}\right) + π J F^{-T}, \qquad
        π = \frac{1}{θ} \left(\overline{μ s I_1} / d - μ + θ U'(θ)\right)

    with the mean over the points of a cell. Plane strain adds a constant to the energy only.

    Parameters
    ----------
    f : array, (d, d, n_points, N)
        Deformation gradients.
    material : NeoHookean
    shares : array, (n_cells, n_points of a cell, 1)
        Volumes of the points over those of their cells.

    Attributes
    ----------
    sound : array of bool, (N,)
        True where no point is inverted.
    """

    def __init__(self, f: Values, material: NeoHookean, shares: Values) -> None:
        self._shares = shares
        cofactor, d = cofactors(f), len(f)
        self._j = (f[0] * cofactor[0]).sum(0)
        self.sound = (self._j > 0).all(axis=0)
        self._f, self._mu, self._inverse = f, material.lame_mu, cofactor / self._j
        self._dilation = self._mean(self._j)
        self._squares = (f * f).sum((0, 1))  # I₁
        self._scale = (self._dilation / self._j) ** (2 / d)
        lam, term = material.lame_lambda, material.volumetric_term
        first, second = term.first(lam, self._dilation), term.second(lam, self._dilation)
        mean = self._mu * self._mean(self._scale * self._squares) / d
        self._pressure = (mean - self._mu + first) / self._dilation  # π
        self._growth = second - first - mean + self._mu
        self._deviator = f - self._squares / d * self._inverse

    def stress(self) -> Values:
        """P in Pa."""
        return self._mu * self._scale * self._deviator + self._pressure * self._j * self._inverse

    def stress_change(self, h: Values) -> Values:
        """∂P/∂F : H in Pa, the derivative of P."""
        a, j, d = self._inverse, self._j, len(h)
        trace = (a * h).sum((0, 1))
        turned = product(product(a, h.swapaxes(0, 1)), a)
        dilation = self._mean(j * trace) / self._dilation  # of its logarithm
        scale = 2 / d * self._scale * (dilation - trace)
        squares = 2 * (self._f * h).sum((0, 1))
        mean = self._mean(scale * self._squares + self._scale * squares) * self._mu / d
        pressure = (mean + self._growth * dilation) / self._dilation
        deviator = h - squares / d * a + self._squares / d * turned
        return (
            self._mu * (scale * self._deviator + self._scale * deviator)
            + (pressure + self._pressure * trace) * j * a
            - self._pressure * j * turned
        )

    def _mean(self, values: Values) -> Values:
        """Mean over the points of every cell, at each of them: (n_points, N) → same."""
        at_points = values.reshape(*self._shares.shape[:2], -1)
        of_cells = (at_points * self._shares).sum(1)[:, None]
        means: Values = library_of(values).broadcast_to(of_cells, at_points.shape)
        return means.reshape(values.shape)


def product(a: Values, b: Values) -> Values:
    """Matrix products a b: (d, d, …) twice → same."""
    result: Values = a[:, :1] * b[0]
    for k in range(1, len(a)):
        result += a[:, k : k + 1] * b[k]
    return result
