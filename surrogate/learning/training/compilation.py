"""Compilation of networks by `torch.compile`."""

from __future__ import annotations

from collections.abc import Callable

import torch
from torch import Tensor

from shared_schema.common.errors import WorkError, first_line
from surrogate.learning.probabilistic.likelihoods import Prediction


def compiled(network: Callable[[Tensor], Prediction]) -> Callable[[Tensor], Prediction]:
    """Compile the map of a network, once for every shape of its input.

    The returned function raises WorkError if compilation fails, for instance because there is no
    C++ compiler.
    """
    from torch._dynamo.exc import TorchDynamoException

    fast = torch.compile(network, dynamic=False)

    def forward(force: Tensor) -> Prediction:
        try:
            return fast(force)
        except TorchDynamoException as error:
            raise WorkError(f"key 'training.compile' = True: {first_line(error)}") from None

    return forward
