r"""Data parallelism: every process takes its share of each batch, and gradients are added up.

Rank r has :math:`n_r` of the n samples of a batch. It differentiates :math:`n_r / n` times the mean
loss over its samples. The sum of these gradients over the ranks is the gradient of the mean loss
over the batch, also if the shares differ in size. ``torchrun`` starts the processes; without it
there is only one.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any, TypeVar

import torch
from torch import Tensor, distributed, nn

from shared_schema.common.errors import InputError, WorkError
from surrogate.runtime.device import choose_device

Result = TypeVar("Result")


@dataclass(frozen=True)
class Ranks:
    """One of the processes that train a network together.

    Attributes
    ----------
    rank : int
        Number of the process, from 0. Only process 0 writes files.
    count : int
        Number of processes.
    """

    rank: int = 0
    count: int = 1

    @property
    def is_first(self) -> bool:
        """True in the process that writes files."""
        return self.rank == 0

    def share(self, batch: Tensor) -> Tensor:
        """Return this process's share of a batch."""
        return batch.tensor_split(self.count)[self.rank]

    def add_up(self, values: Tensor) -> None:
        """Replace values by their sum over all processes. Collective."""
        if self.count > 1:
            distributed.all_reduce(values)

    def add_up_gradients(self, network: nn.Module) -> None:
        """Replace every gradient by its sum over all processes; None counts as 0. Collective."""
        if self.count == 1:
            return
        parameters = [p for p in network.parameters() if p.requires_grad]
        for parameter in parameters:
            if parameter.grad is None:
                parameter.grad = torch.zeros_like(parameter)
        gradients = [p.grad for p in parameters if p.grad is not None]
        flat = torch.cat([gradient.flatten() for gradient in gradients])
        self.add_up(flat)
        totals = torch.split(flat, [gradient.numel() for gradient in gradients])
        for gradient, total in zip(gradients, totals, strict=True):
            gradient.copy_(total.view_as(gradient))

    def from_first(self, work: Callable[[], Result]) -> Result:
        """Call a function in the first process only; return its result in all. Collective.

        Raises
        ------
        InputError, WorkError, OSError
            Errors of the function, raised in all processes.
        """
        if self.count == 1:
            return work()
        outcome: list[Any] = [None]
        if self.is_first:
            try:
                outcome[0] = work()
            except (InputError, WorkError, OSError) as error:
                outcome[0] = error
        distributed.broadcast_object_list(outcome)
        if isinstance(outcome[0], Exception):
            raise outcome[0]
        return outcome[0]


ALONE = Ranks()


@contextmanager
def joined(device_name: str) -> Iterator[tuple[Ranks, torch.device]]:
    """Join the processes that ``torchrun`` has started; each process has its own device.

    Parameters
    ----------
    device_name : {"auto", "cpu", "cuda"}

    Raises
    ------
    InputError
        If there is no such device, or there are fewer devices than processes.
    """
    device = choose_device(device_name)
    if not distributed.is_torchelastic_launched():
        yield ALONE, device
        return
    if device.type == "cuda":
        local, devices = int(os.environ["LOCAL_RANK"]), torch.cuda.device_count()
        if local >= devices:
            raise InputError(
                f"torchrun --nproc-per-node {os.environ['LOCAL_WORLD_SIZE']}: expected {devices} "
                "at most, the number of CUDA devices here"
            )
        device = torch.device("cuda", local)
        torch.cuda.set_device(device)
    distributed.init_process_group("nccl" if device.type == "cuda" else "gloo")
    try:
        yield Ranks(distributed.get_rank(), distributed.get_world_size()), device
    finally:
        distributed.destroy_process_group()
