"""Measures of every epoch: lines of ``metrics.jsonl`` and, optionally, files for TensorBoard."""

from __future__ import annotations

import importlib.util
from collections.abc import Mapping

from shared_schema.common.errors import InputError
from surrogate.learning.runs.folder import RunFolder
from surrogate.learning.runs.metric_lines import append_line

Line = Mapping[str, float]


class TrainingLog:
    """The measures of a run, one line per epoch.

    Parameters
    ----------
    run : RunFolder
    epoch : int
        Last finished epoch; lines of later epochs are deleted.
    tensorboard : bool
        Also write event files for TensorBoard.
    silent : bool
        Write nothing.
    """

    def __init__(self, run: RunFolder, epoch: int, tensorboard: bool, silent: bool) -> None:
        self._run = None if silent else run
        self._events = None
        if silent:
            return
        run.keep_metric_lines(epoch)
        if tensorboard:
            from torch.utils.tensorboard import SummaryWriter

            self._events = SummaryWriter(run.tensorboard, purge_step=epoch + 1)

    def write(self, line: Line) -> None:
        """Append the measures of an epoch."""
        if self._run is not None:
            append_line(self._run.metrics, line)
        if self._events is not None:
            for name, value in line.items():
                if name != "epoch":
                    self._events.add_scalar(name, value, line["epoch"])
            self._events.flush()

    def close(self) -> None:
        """Close the files."""
        if self._events is not None:
            self._events.close()


def require_tensorboard() -> None:
    """Raise InputError unless the package tensorboard is installed."""
    if importlib.util.find_spec("tensorboard") is None:
        raise InputError(
            "tensorboard: not installed, expected the package 'tensorboard'", "tensorboard"
        )
