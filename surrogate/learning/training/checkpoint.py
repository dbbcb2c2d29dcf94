"""Checkpoints: everything that the next epoch depends on, in one safetensors file.

The order of the samples and the noise depend only on seed and epoch, and the learning rate only
on the step number. So a checkpoint holds just the weights, the states of the optimisers, the
averages and the state of early stopping.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Protocol

import torch
from torch import Tensor

from shared_schema.common.errors import InputError, first_line
from surrogate.runtime.device import memory_errors
from surrogate.runtime.tensor_file import load_tensors, save_atomically

EARLIER = {"posterior_std": "spreads"}  # names in run folders of version 1


class Stateful(Protocol):
    """An object whose state is named tensors, such as a network."""

    def state_dict(self) -> Mapping[str, Tensor]:
        """Return the state."""

    def load_state_dict(self, state_dict: Mapping[str, Tensor], /) -> Any:
        """Restore a state."""


def save_checkpoint(
    path: Path,
    epoch: int,
    seconds: float,
    states: Mapping[str, Stateful],
    optimisers: list[Any],
) -> None:
    """Write a checkpoint atomically.

    Parameters
    ----------
    path : Path
    epoch : int
        Number of finished epochs.
    seconds : float
        Training time so far.
    states : dict of Stateful
        Network and all other objects whose state changes from epoch to epoch, by name.
    optimisers : list of torch.optim.Optimizer
    """
    tensors: dict[str, Tensor] = {
        f"{owner}.{name}": value
        for owner, stateful in states.items()
        for name, value in stateful.state_dict().items()
    }
    for number, optimiser in enumerate(optimisers):
        for index, state in optimiser.state_dict()["state"].items():
            for name, value in state.items():
                tensors[f"optimiser.{number}.{index}.{name}"] = torch.as_tensor(value)
    status = json.dumps({"epoch": epoch, "seconds": seconds})
    save_atomically(tensors, path, {"status": status})


def load_checkpoint(
    path: Path, states: Mapping[str, Stateful], optimisers: list[Any]
) -> tuple[int, float]:
    """Restore a checkpoint in place.

    Returns
    -------
    epoch : int
        Number of finished epochs.
    seconds : float
        Training time up to the checkpoint.

    Raises
    ------
    InputError
        If the file is damaged.
    """
    tensors, metadata = load_tensors(path)
    try:
        epoch, seconds = _status(metadata["status"])
        with memory_errors():
            for owner, stateful in states.items():
                stateful.load_state_dict(_state(owner, tensors))
            for number, optimiser in enumerate(optimisers):
                _restore(optimiser, _below(f"optimiser.{number}.", tensors))
    except (KeyError, RuntimeError, TypeError, ValueError) as error:
        raise InputError(f"{path}: not a checkpoint of this run ({first_line(error)})") from None
    return epoch, seconds


def _status(text: str) -> tuple[int, float]:
    """Read number of epochs and time of a checkpoint; ValueError if they are none."""
    status = json.loads(text)
    epoch, seconds = status["epoch"], float(status["seconds"])
    if type(epoch) is not int or epoch < 1 or not 0 <= seconds < math.inf:
        raise ValueError(f"status {text}")
    return epoch, seconds


def _restore(optimiser: torch.optim.Optimizer, tensors: dict[str, Tensor]) -> None:
    state: dict[int, dict[str, Tensor]] = {}
    for name, value in tensors.items():
        index, _, key = name.partition(".")
        state.setdefault(int(index), {})[key] = value
    groups = optimiser.state_dict()["param_groups"]
    optimiser.load_state_dict({"state": state, "param_groups": groups})
    for parameter, values in optimiser.state.items():
        for key, value in values.items():
            if value.shape == parameter.shape:  # fused Adam needs the parameter's memory layout
                values[key] = torch.empty_like(parameter).copy_(value)


def _state(owner: str, tensors: dict[str, Tensor]) -> dict[str, Tensor]:
    """Return the tensors of one owner of a state, stored by its present or earlier name."""
    return _below(f"{owner}.", tensors) or _below(f"{EARLIER.get(owner, owner)}.", tensors)


def _below(prefix: str, tensors: dict[str, Tensor]) -> dict[str, Tensor]:
    return {
        name.removeprefix(prefix): value
        for name, value in tensors.items()
        if name.startswith(prefix)
    }
