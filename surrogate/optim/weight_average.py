r"""Exponential moving average of a network's weights.

.. math:: \bar w_t = \frac{\sum_{i=1}^t d^{t-i} w_i}{\sum_{i=1}^t d^{t-i}}
   = \bar w_{t-1} + \frac{1 - d}{1 - d^t} (w_t - \bar w_{t-1})

with the decay d. The bias of the start is corrected as for Adam's moments (Kingma and Ba 2015), so
that the average does not contain the initial weights.
"""

from __future__ import annotations

import torch
from torch import Tensor, nn
from torch.optim.swa_utils import AveragedModel

Tensors = list[Tensor] | tuple[Tensor, ...]


def averaged_model(network: nn.Module, decay: float) -> AveragedModel:
    """Make the average over the steps of a training.

    Parameters
    ----------
    network : nn.Module
        Network in training; call `AveragedModel.update_parameters` with it after every step.
    decay : float
        Decay d.

    Returns
    -------
    AveragedModel
        Average, whose `module` is a copy of the network with averages of all weights and of batch
        norm's statistics. Integers, such as batch norm's counter, have their latest values.
    """

    @torch.no_grad()
    def update(averages: Tensors, latest: Tensors, steps: Tensor | int) -> None:
        if averages[0].is_floating_point():
            share = (1 - decay) / (1 - decay ** (int(steps) + 1))
            torch._foreach_lerp_(averages, latest, share)
        else:
            torch._foreach_copy_(averages, latest)

    average = AveragedModel(network, multi_avg_fn=update, use_buffers=True)
    average.module.requires_grad_(False)
    return average
