"""Trained networks from run folders and from the package."""

from __future__ import annotations

import logging
from pathlib import Path
from typing import Literal

import torch

from shared_schema.common.arguments import checked_arguments
from shared_schema.common.errors import InputError, first_line
from surrogate.learning.inference.surrogate import Surrogate, make_surrogate
from surrogate.learning.inference.touched_region import restore_columns
from surrogate.learning.runs.folder import RunFolder
from surrogate.learning.runs.shelf import find_run
from surrogate.mechanics.body.elements_of_case import loads_of_before
from surrogate.runtime.device import choose_device, defaults_of_torch, memory_errors

logger = logging.getLogger(__name__)


@checked_arguments
def load(
    run: str | Path,
    device: str = "cpu",
    *,
    precision: Literal["float32", "tensorfloat32"] = "float32",
) -> Surrogate:
    """Load a trained network; nothing is unpickled.

    Logs a warning if an earlier version made the run folder, so that nothing in it can be checked.

    Parameters
    ----------
    run : str or Path
        Run folder, or the name of a network that comes with the package.
    device : {"cpu", "cuda", "auto"}
        Processor; "auto" takes a GPU if there is one.
    precision : {"float32", "tensorfloat32"}
        Of a network's convolutions on a GPU. Tensor cores, which round factors to a relative error
        of 5e-4, do the passes of variational Bayes in less than half of the time.

    Raises
    ------
    InputError
        If there is no finished run, its files are damaged, or a weight is not finite.
    """
    with defaults_of_torch():
        return _loaded(RunFolder(find_run(run)), device, precision)


def _loaded(
    folder: RunFolder, device: str, precision: Literal["float32", "tensorfloat32"]
) -> Surrogate:
    if folder.unsealed:
        logger.warning(folder.unsealed)
    description = folder.description()
    tensors = folder.read_tensors()
    for name, tensor in tensors.items():
        if not torch.isfinite(tensor).all():
            raise InputError(f"{folder.model}: '{name}' holds a NaN or an infinity")
    try:
        with memory_errors():
            surrogate = make_surrogate(tensors, description, choose_device(device).type)
    except (KeyError, IndexError, RuntimeError, ValueError) as error:
        raise InputError(
            f"{folder.model}: does not fit {folder.config.name} ({first_line(error)})"
        ) from None
    if folder.modal_cubature.is_file():
        from surrogate.learning.inference.modal_cubature import balance, read_cubature

        folder.seal.require_intact(folder.modal_cubature)
        balance(surrogate, read_cubature(folder.modal_cubature))
    restore_columns(surrogate, folder)
    if (of_before := loads_of_before(surrogate.geometry)) is not None:
        logger.warning("%s: trained on data %s", folder.folder, of_before)
    surrogate.precision = precision
    surrogate.folder = folder.folder
    surrogate.mean_error = folder.mean_error()
    return surrogate
