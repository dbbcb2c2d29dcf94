r"""Regressions on nodal forces, which are fitted to the data directly, not trained step by step.

Ridge regression on polynomials:

.. math:: \min_{W, b} \frac{1}{N} \sum_n \|W φ(f_n) + b - c_n\|_2^2 + α \|W\|_2^2

φ contains the monomials of the force components of each node, up to a given degree; it contains no
products of forces at different nodes.

Gaussian process regression:

.. math:: k(f, f') = a \exp\left(-\frac{\|f - f'\|_2^2}{2 ℓ^2}\right) + σ_n^2 δ_{f f'}

The norm is over all force components at the loaded nodes. The outputs are standardised, treated as
independent, and share one kernel. Its parameters maximise the marginal likelihood.
"""

from __future__ import annotations

from itertools import product
from typing import Any
from warnings import catch_warnings, simplefilter

import numpy as np
import torch
from torch import Tensor, nn

TUNING_SAMPLES = 500  # largest number for the kernel's parameters; a search step takes O(n³)


class Fitted(nn.Module):
    """A module whose tensors come from a fit, which also determines their shapes.

    Parameters
    ----------
    names : str
        Names of the tensors; they are empty until they are fitted or loaded.
    """

    def __init__(self, *names: str) -> None:
        super().__init__()
        self._names = names
        for name in names:
            self.register_buffer(name, torch.empty(0))

    def _load_from_state_dict(self, state: dict[str, Any], prefix: str, *others: Any) -> None:
        for name in self._names:
            if prefix + name in state:
                setattr(self, name, torch.empty_like(state[prefix + name]))
        super()._load_from_state_dict(state, prefix, *others)


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


class GaussianProcess(Fitted):
    """Regression from nodal forces to several outputs, with a standard deviation of each output.

    Parameters
    ----------
    samples : int
        Largest number of training samples in the process; they are chosen at random.
    tuned_outputs : int, optional
        Number of outputs, the first ones, that the kernel's parameters are fitted to; all by
        default.

    Attributes
    ----------
    kernel : Tensor, (3,)
        Parameters a, ℓ and σ_n² of the kernel.
    inputs : Tensor, (n, d · n_loaded)
        Forces of the n training samples in the process.
    cholesky : Tensor, (n, n)
        Cholesky factor L with L Lᵀ = k(inputs, inputs).
    alpha : Tensor, (n, n_outputs)
        Coefficients (L Lᵀ)⁻¹ y, where y are the standardised outputs.
    mean, std : Tensor, (n_outputs,)
        Mean and standard deviation of the outputs, for their standardisation.
    """

    kernel: Tensor
    inputs: Tensor
    cholesky: Tensor
    alpha: Tensor
    mean: Tensor
    std: Tensor

    def __init__(self, samples: int, tuned_outputs: int | None = None) -> None:
        super().__init__("kernel", "inputs", "cholesky", "alpha", "mean", "std")
        self.samples, self.tuned_outputs = samples, tuned_outputs

    def fit(self, force: Tensor, outputs: Tensor, generator: torch.Generator) -> None:
        """Fit to samples: scaled inputs (N, …) and outputs (N, n_outputs)."""
        from sklearn.exceptions import ConvergenceWarning
        from sklearn.gaussian_process import GaussianProcessRegressor
        from sklearn.gaussian_process.kernels import RBF, ConstantKernel, WhiteKernel

        chosen = torch.randperm(len(force), generator=generator)[: self.samples]
        x, y = force.flatten(1)[chosen], outputs[chosen]
        self.inputs, self.mean, self.std = x, y.mean(dim=0), y.std(dim=0, correction=0)
        y = (y - self.mean) / self.std
        start = ConstantKernel(10.0, (1e-3, 1e5)) * RBF(1.0, (1e-2, 1e3))
        start += WhiteKernel(1e-4, (1e-8, 1.0))
        few, first = slice(TUNING_SAMPLES), slice(self.tuned_outputs)
        with catch_warnings():
            # data without noise push σ_n² to its bound
            simplefilter("ignore", ConvergenceWarning)
            tuned = GaussianProcessRegressor(start).fit(x[few].numpy(), y[few, first].numpy())
        model = GaussianProcessRegressor(tuned.kernel_, optimizer=None).fit(x.numpy(), y.numpy())
        self.kernel = torch.from_numpy(np.exp(tuned.kernel_.theta))
        self.cholesky = torch.from_numpy(model.L_)
        self.alpha = torch.from_numpy(model.alpha_)

    def forward(self, force: Tensor) -> tuple[Tensor, Tensor]:
        """Predict outputs and their standard deviations, both (N, n_outputs).

        The standard deviations are those of an observation: they include the noise σ_n².
        """
        amplitude, length, noise = self.kernel
        x, y = force.flatten(1) / length, self.inputs / length
        half_square = 0.5 * (x.square().sum(dim=1)[:, None] + y.square().sum(dim=1)) - x @ y.T
        covariance = amplitude * torch.exp(-half_square)
        mean = covariance @ self.alpha * self.std + self.mean
        explained = torch.linalg.solve_triangular(self.cholesky, covariance.T, upper=False)
        variance = (amplitude + noise - explained.square().sum(dim=0)).clamp(min=0.0)
        return mean, variance.sqrt()[:, None] * self.std
