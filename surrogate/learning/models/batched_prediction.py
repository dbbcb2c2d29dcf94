"""Distributions under any number of loads: passes of the network, in batches that fit memory."""

from __future__ import annotations

from contextlib import closing
from copy import copy
from functools import cached_property, reduce
from typing import Any, TypeVar

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from shared_schema.common.progress import Progress
from surrogate.learning.models.model import Model
from surrogate.learning.models.network_model import NetworkModel
from surrogate.learning.networks.nodal_network import NodalNetwork
from surrogate.learning.probabilistic.distribution import Distribution, Moments
from surrogate.learning.probabilistic.likelihoods import Prediction
from surrogate.learning.probabilistic.stochastic_passes import Drawn, Passes, drawables, using
from surrogate.runtime.cuda_graphs import Replayed
from surrogate.runtime.device import Precision, convolutions

BATCH = 4096  # largest product of samples and passes that are computed at once
VALUES = 2**25  # largest number of values in a layer
FEW = 16  # samples up to which launching the kernels of a GPU one by one takes longest
Array = NDArray[np.float64]
Module = TypeVar("Module", bound=nn.Module)


class BatchedPrediction:
    """Predicts with a network, in as few batches as memory allows.

    Parameters
    ----------
    network : NodalNetwork
    passes : Passes
        Its passes; the drawn weights of the last prediction are kept.
    config : Model
        Configuration of the run, which says what the passes' moments mean.
    points : int
        Number of grid points.

    Attributes
    ----------
    precision : {"float32", "tensorfloat32"}
        Of convolutions on a GPU.
    """

    def __init__(self, network: NodalNetwork, passes: Passes, config: Model, points: int) -> None:
        self.network, self.passes, self.config = network, passes, config
        self.precision: Precision = "float32"
        self._values = config.values_per_point * points
        self._replayed: tuple[tuple[object, ...], Replayed] | None = None

    def distribution(self, forces: Array, passes: int, seed: int) -> Distribution:
        """Predict means and standard deviations in m from forces in N, (N, n_nodes, d) each."""
        passes, parts = passes if self.passes.differ else 1, []
        title, one = "surrogate: predictions", len(forces) <= self._batch
        progress = Progress(len(forces), unit="loads", title=title, silent=one, passing=True)
        with closing(progress):
            for start in range(0, max(len(forces), 1), self._batch):
                part = forces[start : start + self._batch]
                parts.append(self._distribution(part, passes, seed))
                progress.update(start + len(part))
        return Distribution(*(np.concatenate(fields) for fields in zip(*parts, strict=True)))

    def mean(self, force: Tensor, passes: int, seed: int) -> Tensor:
        """Predict means in m from forces in N, (N, n_nodes, d), differentiable by the forces.

        All samples are one batch, since their intermediate values are kept.
        """
        network = without_gradients(self.network)
        passes = passes if self.passes.differ else 1
        single, total = force.float(), torch.zeros_like(force)
        for chunk in self._chunks(passes, len(force)):
            drawn = self.passes.draw(seed, chunk).values()
            drawn_weights = using(dict(zip(drawables(network), drawn, strict=True)))
            with drawn_weights, convolutions(self.precision):
                mean, _ = network(single, len(chunk))
            total = total + mean.to(total.dtype).mean(dim=0) * (len(chunk) / passes)
        return total

    @property
    def _batch(self) -> int:
        return max(1, min(BATCH, VALUES // self._values))

    def _chunks(self, passes: int, samples: int) -> list[range]:
        """Passes that are done at once."""
        at_once = min(self.passes.at_once, max(1, self._batch // max(samples, 1)))
        return [range(t, min(t + at_once, passes)) for t in range(0, passes, at_once)]

    @torch.inference_mode()
    def _distribution(self, forces: Array, passes: int, seed: int) -> tuple[Array, Array, Array]:
        """Return mean, epistemic and aleatoric standard deviation of one batch, from all passes."""
        force = torch.from_numpy(forces.astype(np.float32)).to(self.network.network.free.device)
        chunks = self._chunks(passes, len(forces))
        if len(chunks) == 1 and len(forces) <= FEW and self._is_replayable:
            found = self._replay(passes, seed)(force)
        else:
            drawn = (self.passes.draw(seed, chunk) for chunk in chunks)
            moments = (self._moments(force, *each) for each in zip(drawn, chunks, strict=True))
            found = self._fields(force, reduce(Moments.joined, moments))
        mean, epistemic, aleatoric = (field.cpu().numpy() for field in found)
        return mean, epistemic, aleatoric

    def _replay(self, passes: int, seed: int) -> Replayed:
        """All passes of a seed as one CUDA graph."""
        last = self._replayed
        if last is None or last[0] != (passes, seed, self.precision):
            every = range(passes)
            drawn = self.passes.draw(seed, every)  # stays, at its place, as long as the graph

            def work(force: Tensor) -> tuple[Tensor, Tensor, Tensor]:
                return self._fields(force, self._moments(force, drawn, every))

            self._replayed = last = (passes, seed, self.precision), Replayed(work)
        return last[1]

    @cached_property
    def _is_replayable(self) -> bool:
        """Whether the network is on a GPU, and nothing in it waits for that."""
        device = self.network.network.free.device
        if device.type != "cuda" or not isinstance(self.config, NetworkModel):
            return False
        from surrogate.learning.networks.reduced_network import ReducedNetwork
        from surrogate.mechanics.equilibrium.compliance import Compliance
        from surrogate.mechanics.series.series_response import SeriesResponse

        for module in self.network.modules():
            waits = isinstance(module, SeriesResponse)
            waits |= isinstance(module, ReducedNetwork) and module.equilibrium is not None
            waits |= isinstance(module, Compliance) and not module.is_on(device)
            if waits:
                return False
        return True

    def _fields(self, force: Tensor, moments: Moments) -> tuple[Tensor, Tensor, Tensor]:
        """Mean, epistemic and aleatoric standard deviation in m."""
        scaled = moments.scaled(self.network.factors(force)[1].double())
        found = self.config.distribution(scaled)
        return found.mean, found.std_epistemic, found.std_aleatoric

    def _moments(self, force: Tensor, drawn: Drawn, passes: range) -> Moments:
        """Return the moments of some passes in double precision."""
        with using(drawn), convolutions(self.precision):
            mean, std = self.network(force, len(passes))
        return Moments.of(Prediction(mean.double(), None if std is None else std.double()))


def without_gradients(module: Module) -> Module:
    """Return a module with the same weights, which take part in no gradient; nothing is copied."""
    same = copy(module)
    weights: dict[str, Any] = dict(module._parameters)
    same._parameters = {k: None if w is None else w.detach() for k, w in weights.items()}
    parts = module._modules.items()
    same._modules = {k: None if part is None else without_gradients(part) for k, part in parts}
    return same
