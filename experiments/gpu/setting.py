"""What every step on a GPU is given: the folder of results, the datasets, device and time left."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

import torch

from experiments.framework.experiment import Experiment, Setting
from experiments.framework.machine import machine
from experiments.framework.timing import Timing, median_seconds
from experiments.gpu.carried_dataset import SUFFIX, unpack
from experiments.measures.latency import Work
from shared_schema import digest_of
from surrogate import Dataset, read_dataset
from surrogate.runtime.device import hardware

CASES = ("beam2d", "lshape2d", "beam3d")  # of the paper
Results = dict[str, Any]


class GpuSetting(Setting):
    """Place, device and time of a step.

    Parameters
    ----------
    out : Path
        Folder of the results.
    data : Path
        Folder of the datasets: ``CASE/structured``, or ``CASE.npz.xz`` from
        ``python -m experiments gpu pack``.
    device : torch.device
    small : bool
        Rehearse with networks of a few channels, for a few repeats.
    deadline : float
        Value of `time.monotonic` at which the step has to end.
    """

    def __init__(
        self, out: Path, data: Path, device: torch.device, small: bool, deadline: float
    ) -> None:
        self.out, self.data = out, data
        self.device, self.small, self.deadline = device, small, deadline

    def configuration(self) -> dict[str, Any]:
        """Whether it is a rehearsal."""
        return {"small": self.small}

    def machine(self) -> dict[str, Any]:
        """Describe processor, load and device."""
        described = {**machine(), "hardware": hardware(self.device)}
        if self.on_gpu:
            properties = torch.cuda.get_device_properties(self.device)
            described |= {
                "cuda": torch.version.cuda,
                "cudnn": torch.backends.cudnn.version(),  # type: ignore[no-untyped-call]
                "memory_bytes": properties.total_memory,
                "multiprocessors": properties.multi_processor_count,
                "shared": "CUDA_MPS_PIPE_DIRECTORY" in os.environ,
            }
        return described

    def fingerprint(self, experiment: Experiment[Any]) -> str:
        """Digest of step, device and size."""
        of = {"step": experiment.name, "device": self.device.type, **self.configuration()}
        return digest_of(of)

    @property
    def on_gpu(self) -> bool:
        """True if the device is a GPU."""
        return self.device.type == "cuda"

    def folder_of(self, case: str) -> Path:
        """Folder of the structured dataset of a case; a packed one is unpacked first."""
        packed = self.data / f"{case}{SUFFIX}"
        if not packed.is_file():
            return self.data / case / "structured"
        folder = self.out / "data" / case
        if not folder.is_dir():
            unpack(packed, folder)
        return folder

    def dataset(self, case: str) -> Dataset:
        """Dataset of a case."""
        return read_dataset(self.folder_of(case))

    def milliseconds(self, work: Work, repeats: int = 100, seconds: float = 0.15) -> float:
        """Median wall time of some work in ms; of one call in a rehearsal."""
        timing = Timing(repeats=1 if self.small else repeats, seconds=seconds)
        return round(1e3 * median_seconds(work, timing), 4)

    def wait(self) -> None:
        """Wait until the device has done all its work."""
        if self.on_gpu:
            torch.cuda.synchronize(self.device)
