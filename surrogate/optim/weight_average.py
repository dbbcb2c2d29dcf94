r"""Exponential moving average of a network's weights.

.. math:: \bar w_t = \frac{\sum_{i=1}^t d^{t-i} w_i}{\sum_{i=1}^t d^{t-i}}
   = \bar w_{t-1} + \frac{1 - d}{1 - d^t} (w_t - \bar w_{t-1})

with the decay d: corrected for its start as Adam's moments are (Kingma and Ba 2015), so that the
initial weights have no part in it.
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
        Network in training; `AveragedModel.update_parameters` takes its weights after every step.
    decay : float
        d.

    Returns
    -------
    AveragedModel
        Its `module` is a copy of the network with the averages of all weights and of batch norm's
        statistics; integers, such as batch norm's counter, are the latest.
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
