r"""Reduced networks: a dense network between modes of the linear response and of its correction.

.. math:: a = Φ^T U_{lin}(F), \qquad c = N(a), \qquad U = U_{lin}(F) + V c

The columns of Φ are the leading orthonormal modes of the linear responses :math:`U_{lin} = S F` of
the training samples, those of V the leading modes of their corrections :math:`U - U_{lin}`. As S is
symmetric, :math:`a = (S Φ)^T F` needs no solve. Every coefficient a is divided by the square root
of its root mean square, as half of the way to equal sizes. With a series (`ModalSeries`), its terms
of second and third order are inputs of the network as well, and its output is added to them:

.. math:: c = s_2(a) + s_3(a) + N(a, s_2, s_3)

A network with standard deviations σ of the coefficients c gives, with the part ε of the corrections
that the modes cannot represent,

.. math:: σ_i^2 = \sum_k V_{ik}^2 \, σ_k(a)^2 + \overline{ε_i^2}
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Annotated, Self

import torch
from pydantic import Field, model_validator
from torch import Tensor, nn
from torch.nn import functional

from shared_schema.common.configuration import Frozen
from surrogate.learning.networks.field_network import SMALLEST_STD, at_points, on_grid
from surrogate.learning.networks.layers import ACTIVATIONS, Activation
from surrogate.learning.networks.modes import (
    LARGEST_SVD,
    ModalSeries,
    chosen_rows,
    leading_modes,
    modal_encoder,
)
from surrogate.learning.probabilistic.flipout import FlipoutDense, VariationalConfig
from surrogate.learning.probabilistic.likelihoods import Prediction
from surrogate.learning.probabilistic.stochastic_passes import members_of


class VariationalLayers(VariationalConfig):
    """Selection of the probabilistic layers of a dense network, and their priors.

    Attributes
    ----------
    layers : tuple of int, optional
        Numbers of the probabilistic layers, from 0 for the first to `depth` for the last; all
        layers if left out.
    """

    layers: tuple[int, ...] | None = Field(None, min_length=1, max_length=101)

    def covers(self, layer: int) -> bool:
        """Tell whether a layer is probabilistic."""
        return self.layers is None or layer in self.layers


class ReducedConfig(Frozen):
    """Architecture of a reduced network.

    Attributes
    ----------
    input_modes, output_modes : int
        Number of modes of the linear response, and of its correction.
    width, depth : int
        Width and number of the hidden layers.
    activation : {"relu", "gelu", "silu"}
        Function after every layer but the last.
    series : tuple of int
        Numbers of leading modes in the products of two, and of three, that the terms of second and
        third order of the load series are made of; by default there is no series.
    """

    input_modes: int = Field(48, ge=1, le=10**4)
    output_modes: int = Field(96, ge=1, le=10**4)
    width: int = Field(256, ge=1, le=10**5)
    depth: int = Field(3, ge=1, le=100)
    activation: Activation = "silu"
    series: tuple[Annotated[int, Field(ge=1, le=200)], ...] = Field((), max_length=2)

    @model_validator(mode="after")
    def _modes_of_the_series(self) -> Self:
        if any(count > self.input_modes for count in self.series):
            raise ValueError(
                f"'series' = {list(self.series)}: expected {self.input_modes} modes at most, the "
                "number of 'input_modes'"
            )
        return self

    @property
    def inputs(self) -> int:
        """Number of inputs of the dense network."""
        return self.input_modes + len(self.series) * self.output_modes


class DenseNetwork(nn.Module):
    """Dense layers with activations between them: (N, inputs) → (N, outputs).

    The last layer starts at zero, and so the network with linear elasticity.

    Parameters
    ----------
    config : ReducedConfig
    outputs : int
    variational : VariationalLayers, optional
        Choice of the layers with random weights; without it all weights are deterministic.
    parameters : int
        Number of further inputs.
    """

    def __init__(
        self,
        config: ReducedConfig,
        outputs: int,
        variational: VariationalLayers | None = None,
        parameters: int = 0,
    ) -> None:
        super().__init__()

        def layer(number: int, inputs: int, outputs: int) -> nn.Module:
            dense = nn.Linear(inputs, outputs)
            if number < config.depth:
                nn.init.kaiming_normal_(dense.weight, nonlinearity="relu")
            else:
                nn.init.zeros_(dense.weight)
            nn.init.zeros_(dense.bias)
            is_random = variational is not None and variational.covers(number)
            return FlipoutDense(dense, variational) if variational and is_random else dense

        self.first = layer(0, config.inputs + parameters, config.width)
        self.hidden = nn.ModuleList(
            layer(number, config.width, config.width) for number in range(1, config.depth)
        )
        self.head = layer(config.depth, config.width, outputs)
        self.activation = ACTIVATIONS[config.activation]()

    def forward(self, x: Tensor) -> Tensor:
        """Evaluate."""
        x = self.activation(self.first(x))
        for layer in self.hidden:
            x = self.activation(layer(x))
        return self.head(x)


class ReducedNetwork(nn.Module):
    """Map from the scaled force grid to the scaled correction of the linear response.

    Its modes are zero until `fit`.

    Parameters
    ----------
    dense : nn.Module
        Network (N, inputs) → (K·N, output_modes) or twice as many outputs: first the means, then ρ
        of the standard deviations.
    config : ReducedConfig
    dimension : int
        Number of space dimensions d.
    free : Tensor of bool, (nx, ny[, nz])
        True at grid points that are nodes and not clamped.
    shape : Tensor, (n_parameters,), optional
        Parameters of the body's shape between −1 and 1, further inputs of the dense network.

    Attributes
    ----------
    encoder : Tensor, (input_modes, d · n_free)
        Scaled forces to scaled coefficients a of the linear response.
    modes : Tensor, (output_modes, d · n_free)
        Modes V, times the root mean square of the coefficients that the network has to learn.
    series : ModalSeries or None
        Terms of higher order, in units of these modes.
    truncation : Tensor, (d · n_free,)
        Root mean square of the part of the scaled corrections that the modes cannot represent.
    equilibrium : callable or None
        Takes coefficients c to those of least energy (`surrogate.mechanics.modal_equilibrium`),
        given the scaled work :math:`V^T F` of the forces on the modes: (N, output_modes) twice →
        same. `surrogate.load` sets it.
    """

    equilibrium: Callable[[Tensor, Tensor], Tensor] | None = None
    points: Tensor
    shape: Tensor | None
    encoder: Tensor
    modes: Tensor
    truncation: Tensor

    def __init__(
        self,
        dense: nn.Module,
        config: ReducedConfig,
        dimension: int,
        free: Tensor,
        shape: Tensor | None = None,
    ) -> None:
        super().__init__()
        self.dense, self.config, self.members = dense, config, members_of(dense)
        points = free.flatten().nonzero().squeeze(1)
        size = dimension * len(points)
        self.register_buffer("points", points, persistent=False)
        self.register_buffer("shape", shape, persistent=False)
        self.register_buffer("encoder", torch.zeros(config.input_modes, size))
        self.register_buffer("modes", torch.zeros(config.output_modes, size))
        self.register_buffer("truncation", torch.zeros(size))
        self.series = ModalSeries(config.series, config.output_modes) if config.series else None

    @torch.no_grad()
    def fit(
        self,
        respond: Callable[[Tensor], Tensor],
        linear: Tensor,
        correction: Tensor,
        force_scale: Tensor,
        seed: int,
    ) -> None:
        """Compute the modes.

        Parameters
        ----------
        respond : callable
            Linear response S on the grid: forces in N to displacements in m.
        linear : Tensor, (N, d, nx, ny[, nz])
            Linear responses of the training samples, in m.
        correction : Tensor, (N, d, nx, ny[, nz])
            Their corrections, scaled.
        force_scale : Tensor, ()
            Unit of the scaled forces, in N.
        seed : int
            Seed of the choice of samples and of the decomposition.
        """
        count = self.config.input_modes
        self.encoder = modal_encoder(respond, linear, self.points, count, force_scale, seed)
        some = chosen_rows(len(correction), seed, LARGEST_SVD)
        outputs = at_points(correction[some], self.points)
        modes = leading_modes(outputs, self.config.output_modes, seed)
        coefficients = outputs @ modes.T
        self.modes = modes * coefficients.square().mean().sqrt()
        self.truncation = (outputs - coefficients @ modes).square().mean(dim=0).sqrt()

    @torch.no_grad()
    def fit_series(self, force: Tensor, terms: Sequence[Tensor], correction: Tensor) -> None:
        """Fit the series, after `fit`; the network then has to learn less, in smaller units.

        Parameters
        ----------
        force : Tensor, (n, d, nx, ny[, nz])
            Scaled forces of some samples.
        terms : sequence of Tensor, (n, d, nx, ny[, nz])
            Their scaled terms of second and third order.
        correction : Tensor, (n, d, nx, ny[, nz])
            Their scaled corrections.
        """
        assert self.series is not None
        a, inverse = self.encoded(force), self.modes.T / self.modes[0].square().sum()
        self.series.fit(a, [at_points(term, self.points) @ inverse for term in terms])
        left = at_points(correction, self.points) @ inverse
        for term in self.series(a):
            left = left - term
        unit = left.square().mean().sqrt()
        if unit > 0:
            self.modes = self.modes * unit
            self.series.in_units_of(unit)

    def forward(self, inputs: Tensor) -> Tensor | Prediction:
        """Predict scaled corrections from scaled forces, both (N, d, nx, ny[, nz]).

        With a shape, from responses instead, and channels of the parameters of each sample.
        """
        force, shape = inputs, None
        if self.shape is not None:
            force, of_shape = inputs.tensor_split([inputs.shape[1] - len(self.shape)], dim=1)
            shape = of_shape.flatten(2)[..., 0]
        outputs = self.corrected(self.encoded(force), shape)
        count = len(self.modes)
        coefficients = outputs[:, :count]
        if self.equilibrium is not None:
            work = at_points(force, self.points) @ self.modes.T
            coefficients = self.equilibrium(work, coefficients)
        mean = on_grid(coefficients @ self.modes, self.points, force)
        if outputs.shape[1] == count:
            return mean
        std = functional.softplus(outputs[:, count:])
        variance = std.square() @ self.modes.square() + self.truncation.square()
        std = (variance + SMALLEST_STD**2).sqrt()
        return Prediction(mean, on_grid(std, self.points, force))

    def coefficients(self, force: Tensor) -> Tensor:
        """Coefficients c by the dense network, then ρ if it has any: (N, d, …) → (K·N, outputs)."""
        return self.corrected(self.encoded(force))

    def corrected(self, a: Tensor, shape: Tensor | None = None) -> Tensor:
        """The same from coefficients a: (N, input_modes) → (K·N, outputs).

        Every sample has its shape, (N, n_parameters), or all that of the body.
        """
        terms = [] if self.series is None else self.series(a)
        inputs = [a] if self.series is None else [a, *self.series.scaled(terms)]
        if self.shape is not None:
            inputs.append(self.shape.expand(a.shape[0], -1) if shape is None else shape)
        outputs: Tensor = self.dense(torch.cat(inputs, dim=1)).to(a.dtype)
        for term in terms:
            of_all = term if self.members == 1 else term.repeat(self.members, 1)
            outputs = outputs + functional.pad(of_all, (0, outputs.shape[1] - len(self.modes)))
        return outputs

    def encoded(self, force: Tensor) -> Tensor:
        """Coefficients a of scaled forces, (N, d, nx, ny[, nz]) → (N, input_modes)."""
        return functional.linear(at_points(force, self.points), self.encoder)
