"""A network that maps fields in SI units: scaled input and output, supports held at zero.

Inputs are forces, and gradients of the response of the body to them.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from math import prod
from typing import Any, Literal

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn
from torch.nn import functional

from shared_schema.manifest import StructuredInfo
from surrogate.learning.data.samples import Samples
from surrogate.learning.networks.load_count_factor import LoadCountFactor
from surrogate.learning.probabilistic.likelihoods import Prediction
from surrogate.learning.probabilistic.stochastic_passes import members_of
from surrogate.mechanics.body.geometry import Geometry, at_components
from surrogate.mechanics.equilibrium.linear_response import LinearResponse

Input = Literal["force", "linear_gradient", "last_gradient"]
Channels = Literal["force", "linear_gradient", "last_gradient", "response", "shape"]
AT_ONCE = 64  # samples that are prepared at once
SMALLEST_SCALE = 1e-9  # relative to the displacement; float32 holds the variances of such errors
SMALLEST_STD = 1e-6  # relative to the displacement scale; float32 resolves nothing finer
ROUNDING = 2.0**-25  # of numbers in single precision, relative
TINY = 1e-30  # no division by zero
POWERS = (-10, 31)  # of two: shares of the linear response that are tried


def channels_of(
    inputs: Sequence[Channels], dimension: int, parameters: int = 0
) -> dict[Channels, slice]:
    """Return the channels of every input, in order.

    There are d of a force or a response, d² of a gradient, and one a parameter of a shape.
    """
    widths = {"force": dimension, "response": dimension, "shape": parameters}
    channels: dict[Channels, slice] = {}
    start = 0
    for name in inputs:
        stop = start + widths.get(name, dimension**2)
        channels[name] = slice(start, stop)
        start = stop
    return channels


def at_points(grid: Tensor, points: Tensor) -> Tensor:
    """Return the values at some points of grids: (N, d, nx, ny[, nz]) → (N, d · n_points)."""
    return grid.flatten(2).index_select(2, points).flatten(1)


def on_grid(values: Tensor, points: Tensor, like: Tensor) -> Tensor:
    """Place values (N, d · n_points) on grids like others, with zeros elsewhere."""
    fields = values.reshape(values.shape[0], like.shape[1], points.shape[0])
    grid = fields.new_zeros(*fields.shape[:2], prod(like.shape[2:]))
    return grid.index_copy(2, points, fields).reshape(values.shape[0], *like.shape[1:])


class FieldNetwork(nn.Module):
    """Network that maps nodal forces in N to nodal displacements in m, on the grid.

    Parameters
    ----------
    network : nn.Module
        Network that maps scaled forces (N, d, nx, ny[, nz]) to scaled displacements of the same
        shape; or to (N, 2d, …), first the means, then ρ of the standard deviations
        σ = ln(1 + e^ρ); or to a `Prediction`. An `Ensemble` of K members returns K·N fields.
    geometry : Geometry
        Geometry of the body; displacements are zero at grid points that are clamped or not nodes.
    info : StructuredInfo
        Statistics of the training split, for the scales.
    linear : LinearResponse, optional
        Linear response of the body: from forces in N to displacements in m and scaled gradients.
    inputs : sequence of {"force", "linear_gradient", "last_gradient", "response", "shape"}
        Inputs of the network, in order; gradients and the response need `linear`, the last gradient
        a `SeriesResponse`. The shape is that of the geometry, in constant channels.
    skip : bool
        Add the linear response to the mean.

    Attributes
    ----------
    node_fraction : float
        Fraction of the grid points that are nodes.
    members : int
        Number K of members of the ensemble; 1 for a single network.
    channels : dict of str to slice
        Channels of every input.
    last_gradient : slice or None
        Channels of the last gradient, which gives the size of the output (`amplitude`), if any.
    linear_share : Tensor, (), or None
        Share of the linear gradient in that size, on an embedded grid; `scale_output` fits it.
    shape : Tensor, (n_parameters,), or None
        Parameters of the geometry's shape between −1 and 1, if they are inputs.
    force_scale : Tensor, ()
        Scale of forces in N: a/√3, the standard deviation of a uniform distribution U(−a, a), with
        the largest force component a of the training split.
    displacement_rms : Tensor, ()
        Root mean square of the displacement over nodes and components, in m.
    displacement_scale : Tensor, (d, nx, ny[, nz])
        Factor on the network's output, in m: `displacement_rms`, unless `scale_output` is called.
    free : Tensor, (nx, ny[, nz])
        1 at grid points that are nodes and not clamped, else 0.
    movable : Tensor, (d, nx, ny[, nz])
        1 at components that are not held, else 0.
    free_components : Tensor of int, (n_free,)
        Numbers of the components that are not held in a flattened field, (d · nx · ny[ · nz],).
    aleatoric_factor, epistemic_factor : Tensor, ()
        Factors a and b on the standard deviations at the nodes
        (`surrogate.learning.training.recalibration`).
    count_factor : LoadCountFactor
        Factor on both, by the number of loaded nodes.
    """

    shape: Tensor | None
    force_scale: Tensor
    displacement_rms: Tensor
    displacement_scale: Tensor
    linear_share: Tensor | None
    free: Tensor
    movable: Tensor
    free_components: Tensor
    aleatoric_factor: Tensor
    epistemic_factor: Tensor

    def __init__(
        self,
        network: nn.Module,
        geometry: Geometry,
        info: StructuredInfo,
        linear: LinearResponse | None = None,
        inputs: Sequence[Channels] = ("force",),
        skip: bool = False,
    ) -> None:
        super().__init__()
        self.network, self.members = network, members_of(network)
        self.linear, self.inputs, self.skip = linear, tuple(inputs), skip
        self.shapes, shape = geometry.shapes, geometry.shape if "shape" in inputs else None
        self.register_buffer("shape", shape, persistent=False)
        count = 0 if shape is None else len(shape)
        self.channels = channels_of(inputs, geometry.dimension, count)
        self.last_gradient = self.channels.get("last_gradient")
        self.node_fraction = float(geometry.grid.mask.mean())
        free = torch.from_numpy(geometry.free_mask).float()
        rms = root_mean_square(info)
        self.register_buffer("force_scale", torch.tensor(max(info.force.max_abs) / math.sqrt(3)))
        self.register_buffer("displacement_rms", torch.tensor(rms))
        self.register_buffer(
            "displacement_scale", torch.full((geometry.dimension, *free.shape), rms)
        )
        self.register_buffer("free", free)
        movable = torch.from_numpy(geometry.movable).float()
        self.register_buffer("movable", movable, persistent=False)
        self.register_buffer(
            "free_components", movable.flatten().nonzero().squeeze(1), persistent=False
        )
        has_share = self.last_gradient is not None and not geometry.grid.points_are_nodes
        self.register_buffer("linear_share", torch.zeros(()) if has_share else None)
        self.register_buffer("aleatoric_factor", torch.ones(()))
        self.register_buffer("epistemic_factor", torch.ones(()))
        self.count_factor = LoadCountFactor()

    def _load_from_state_dict(self, state: dict[str, Any], prefix: str, *others: Any) -> None:
        if prefix + "unit" in state:  # name in run folders of version 1
            state[prefix + "displacement_rms"] = state.pop(prefix + "unit")
        if self.linear_share is not None:
            state.setdefault(prefix + "linear_share", torch.zeros(()))  # of earlier runs
        super()._load_from_state_dict(state, prefix, *others)

    def scale_output(self, prepared: Samples, by_node: bool) -> None:
        """Scale components by their root mean square over samples.

        In units of the amplitude, by their median, since a few loads leave much more than most.

        Parameters
        ----------
        prepared : Samples
            From `prepared`; displacements in m.
        by_node : bool
            Scale every component of every node by its own, not all by a common one.
        """
        sizes = prepared.displacement.abs()
        if self.linear_share is not None:
            linear = self.largest(prepared.force, "linear_gradient").flatten()
            last = self.largest(prepared.force, "last_gradient").flatten()
            self.linear_share.copy_(share_of_linear(sizes.flatten(1).mean(dim=1), last, linear))
        if self.last_gradient is not None:
            sizes = sizes / (self.amplitude(prepared.force) + TINY)
        if not by_node:
            sizes = at_components(sizes, self.free_components).flatten()[:, None, None]
        if self.last_gradient is None:
            typical = sizes.square().mean(dim=0).sqrt()
        else:
            typical = sizes.median(dim=0).values
        scale = torch.where(typical > 0, typical, self.displacement_rms)
        smallest = SMALLEST_SCALE * float(self.displacement_rms)
        self.displacement_scale.copy_(scale.clamp(min=smallest).expand_as(self.displacement_scale))

    def forward(self, force: Tensor, passes: int = 1, response: Tensor | None = None) -> Prediction:
        """Predict displacements in m from forces in N, for each of some drawn passes.

        Parameters
        ----------
        force : Tensor, (N, d, nx, ny[, nz])
            In N.
        passes : int
            Number of drawn passes T.
        response : Tensor, (N, d, n_nodes), optional
            The linear response at the nodes in m, if it is known; otherwise it is computed.

        Returns
        -------
        Prediction
            Fields (K·T·N, d, nx, ny[, nz]) in m.
        """
        inputs, linear = self.inputs_of(force, response)
        ones = (1,) * (force.ndim - 1)
        mean, std = self.learned(inputs.repeat(passes, *ones) if passes > 1 else inputs)
        if linear is not None:
            mean = mean + linear.repeat(self.members * passes, *ones) * self.movable
        return Prediction(mean, std)

    def learned(self, inputs: Tensor) -> Prediction:
        """Predict in m, from the inputs of `prepared`, what the linear response leaves over."""
        output: Tensor | Prediction = self.network(self.scaled(inputs))
        scale, d = self.displacement_scale * self.movable, len(self.displacement_scale)
        if self.last_gradient is not None:
            scale = scale * self.of_members(self.amplitude(inputs))
        if isinstance(output, Prediction):
            mean, std = output
            return Prediction(mean * scale, None if std is None else std * scale)
        output = output.to(inputs.dtype)
        mean = output[:, :d] * scale
        if output.shape[1] == d:
            return Prediction(mean, None)
        std = (functional.softplus(output[:, d:]) + SMALLEST_STD) * scale
        if self.last_gradient is not None:
            std = std + self.of_members(self.rounding(inputs)) * self.movable
        return Prediction(mean, std)

    def amplitude(self, inputs: Tensor) -> Tensor:
        """Size of what the series leaves over: (N, inputs, …) → (N, 1, …).

        It is the largest norm of the gradient of the series' last term, which the remainder
        follows closely, over many decades, so that it is the unit of the network's output, which
        vanishes with the load. On an embedded grid a part of the remainder follows the linear
        response, since the force of a node acts on the nodes around, too: a share of the linear
        gradient is added.
        """
        last = self.largest(inputs, "last_gradient")
        if self.linear_share is None:
            return last
        return last + self.linear_share * self.largest(inputs, "linear_gradient")

    def largest(self, inputs: Tensor, name: Input) -> Tensor:
        """Largest norm of a gradient on the grid: (N, inputs, …) → (N, 1, …)."""
        gradient = inputs[:, self.channels[name]].flatten(2)
        return root(gradient.square().sum(dim=1).amax(dim=1), inputs.ndim)

    def rounding(self, inputs: Tensor) -> Tensor:
        """Error of displacements in single precision, in m: (N, inputs, …) → (N, 1, …).

        It is relative to the linear response, in terms of its gradient.
        """
        square = inputs[:, self.channels["linear_gradient"]].square().flatten(1).mean(dim=1)
        return ROUNDING * self.displacement_rms * root(square, inputs.ndim)

    def unit(self, inputs: Tensor) -> Tensor | None:
        """Amplitude, with the rounding of displacements in its unit; None if there is none."""
        if self.last_gradient is None:
            return None
        return self.amplitude(inputs) + self.rounding(inputs) / self.displacement_scale.mean()

    def of_members(self, factor: Tensor) -> Tensor:
        """Repeat a factor for the fields of every member: (N, 1, …) → (K·N, 1, …)."""
        return factor.repeat(self.members, *(1,) * (factor.ndim - 1))

    def scaled(self, inputs: Tensor) -> Tensor:
        """Scale the inputs of `learned` for the network; those of a linear response are already."""
        if self.linear is None and self.shape is None:
            return inputs / self.force_scale
        if self.last_gradient is None:
            return inputs
        start, stop = self.last_gradient.start, self.last_gradient.stop
        last = self.largest(inputs, "last_gradient")
        direction = inputs[:, start:stop] / (last + torch.where(last > 0, TINY, 1.0))
        return torch.cat([inputs[:, :start], direction, inputs[:, stop:]], dim=1)

    def inputs_of(
        self, force: Tensor, response: Tensor | None = None, shape: Tensor | None = None
    ) -> tuple[Tensor, Tensor | None]:
        """Inputs of `learned`, and the linear response that its output is added to.

        The response is known, or computed, and that of the given shapes, (N, n_parameters), each
        between −1 and 1; by default all samples have the shape of the geometry.
        """
        fields: dict[Channels, Tensor] = {"force": force / self.force_scale}
        displacement: Tensor | None = None
        if self.linear is not None:
            displacement, gradient = self.linear(force, response)
            channels = force.shape[1] ** 2
            fields["response"] = displacement * self.movable / self.displacement_rms
            fields["linear_gradient"] = gradient[:, :channels]
            fields["last_gradient"] = gradient[:, channels:]
        elif self.shape is None:
            return force, None
        if self.shape is not None:
            of = self.shape.expand(force.shape[0], -1) if shape is None else shape.to(force)
            ones = (1,) * (force.ndim - 2)
            fields["shape"] = of.reshape(*of.shape, *ones).expand(-1, -1, *force.shape[2:])
        inputs = torch.cat([fields[name] for name in self.inputs], dim=1)
        return inputs, displacement if self.skip else None

    @torch.no_grad()
    def prepared(self, samples: Samples, report: Callable[[int], object] | None = None) -> Samples:
        """Return samples for `learned`: its inputs, and the displacements that it has to predict.

        A training computes them once, not in every step.

        Parameters
        ----------
        samples : Samples
            Forces in N and displacements in m, on any device, on which the result is as well.
        report : callable, optional
            Gets the number of samples that are done, from time to time.

        Returns
        -------
        Samples
            The same samples without a linear response. With it, scaled inputs in place of forces,
            (N, inputs, nx, ny[, nz]), and displacements in m less the linear response if the
            network's output is added to it.
        """
        if self.linear is None and self.shape is None:
            return samples
        parts: list[Samples] = []
        for start in range(0, max(len(samples), 1), AT_ONCE):
            part = samples[start : start + AT_ONCE]
            force = part.force.to(self.force_scale.device)
            inputs, linear = self.inputs_of(force, *self._in_shapes(force, part.parameters))
            target = part.displacement
            if linear is not None:
                target = target - (linear * self.movable).to(target.device)
            parts.append(Samples(inputs.to(target.device), target))
            if report is not None:
                report(min(start + AT_ONCE, len(samples)))
        return Samples(
            torch.cat([part.force for part in parts]),
            torch.cat([part.displacement for part in parts]),
        )

    def _in_shapes(
        self, force: Tensor, parameters: NDArray[np.float64] | None
    ) -> tuple[Tensor | None, Tensor | None]:
        """Linear responses at the nodes, and shapes between −1 and 1, of samples in their shapes.

        None of those of the geometry.
        """
        if parameters is None or self.shapes is None:
            return None, None
        shape = torch.from_numpy(self.shapes.scaled(parameters)).float()
        response = None if self.linear is None else self.linear.in_shapes(force, parameters)
        return response, shape


def share_of_linear(sizes: Tensor, last: Tensor, linear: Tensor) -> Tensor:
    """Share s with which last + s · linear follows sizes best: their ratio varies least.

    Parameters
    ----------
    sizes, last, linear : Tensor, (N,)
        Of every sample; samples without a load have no part in it.

    Returns
    -------
    Tensor, ()
        Zero, or a power of two times the median of last / linear.
    """
    acts = (sizes > 0) & (last > 0)
    if not acts.any():
        return torch.zeros(())
    sizes, last, linear = sizes[acts], last[acts], linear[acts]
    factors = torch.cat([torch.zeros(1), 2.0 ** torch.arange(*POWERS)]).to(last)
    shares = factors * (last / linear).median()
    ratios = sizes / (last + shares[:, None] * linear)
    return shares[ratios.log().std(dim=1, correction=0).argmin()]


def root(square: Tensor, dimensions: int) -> Tensor:
    """Square roots of N numbers, (N, 1, …), whose derivative at 0, without a load, is 0."""
    if square.requires_grad:
        square = torch.where(square > 0, square, 1.0).sqrt() * (square > 0)
    else:
        square = square.sqrt()
    return square.reshape(-1, *(1,) * (dimensions - 1))


def root_mean_square(info: StructuredInfo) -> float:
    """Return the root mean square displacement over nodes and components, in m; 1 if it is 0."""
    components = zip(info.displacement.mean, info.displacement.std, strict=True)
    squares = [mean**2 + std**2 for mean, std in components]
    return math.sqrt(sum(squares) / len(squares)) or 1.0


def parameter_count(module: nn.Module) -> int:
    """Return the number of trainable parameters."""
    parameters = module.parameters()
    return sum(parameter.numel() for parameter in parameters if parameter.requires_grad)
