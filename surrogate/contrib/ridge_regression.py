r"""Ridge regression on polynomials of nodal forces.

.. math:: \min_{W, b} \frac{1}{N} \sum_n \|W φ(f_n) + b - c_n\|_2^2 + α \|W\|_2^2

φ contains the monomials of the force components of each node, up to a given degree; it contains no
products of forces at different nodes.
"""

from __future__ import annotations

from itertools import product

import torch
from torch import Tensor

from surrogate.contrib.fitted import Fitted


class RidgeRegression(Fitted):
    """Polynomial regression from nodal forces to several outputs.

    Parameters
    ----------
    degree : int
        Largest degree of the monomials.
    penalty : float
        Penalty α on the squared weights.

    Attributes
    ----------
    weights : Tensor, (n_outputs, n_monomials)
        Weights W.
    intercept : Tensor, (n_outputs,)
        Intercept b.
    """

    weights: Tensor
    intercept: Tensor

    def __init__(self, degree: int, penalty: float) -> None:
        super().__init__("weights", "intercept")
        self.degree, self.penalty = degree, penalty

    def fit(self, force: Tensor, outputs: Tensor, generator: torch.Generator) -> None:
        """Fit to samples: scaled forces (N, d, n_loaded) and outputs (N, n_outputs)."""
        from sklearn.linear_model import Ridge

        model = Ridge(alpha=self.penalty * len(force))
        model.fit(monomials(force, self.degree).numpy(), outputs.numpy())
        self.weights = torch.from_numpy(model.coef_).reshape(outputs.shape[1], -1)
        self.intercept = torch.from_numpy(model.intercept_)

    def forward(self, force: Tensor) -> tuple[Tensor, None]:
        """Predict outputs (N, n_outputs); there are no standard deviations (None)."""
        return monomials(force, self.degree) @ self.weights.T + self.intercept, None


def monomials(force: Tensor, degree: int) -> Tensor:
    """Return the monomials of the force components of each node, of degree 1 to `degree`.

    Parameters
    ----------
    force : Tensor, (N, d, n_loaded)

    Returns
    -------
    Tensor, (N, n_loaded · (binomial(d + degree, d) − 1))
    """
    powers = product(range(degree + 1), repeat=force.shape[1])
    exponents = [torch.tensor(e, device=force.device) for e in powers if 0 < sum(e) <= degree]
    return torch.cat([(force ** e[:, None]).prod(dim=1) for e in exponents], dim=1)
