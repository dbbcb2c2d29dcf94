"""What every step is given: the folder of results, the datasets, the device and the time left."""

from __future__ import annotations

import subprocess
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import torch

from experiments.benchmarks.publication import SOFTWARE, machine
from experiments.gpu.carried_dataset import SUFFIX, unpack
from surrogate.data import Dataset, read_dataset
from surrogate.hardware import hardware

ROOT = Path(__file__).parents[2]
CASES = ("beam2d", "lshape2d", "beam3d")
Results = dict[str, Any]


@dataclass(frozen=True)
class Setting:
    """Place, device and time of a step.

    Attributes
    ----------
    out : Path
        Folder of the results.
    data : Path
        Folder of the datasets: ``CASE/structured``, or ``CASE.npz.xz`` from `experiments.gpu.pack`.
    device : torch.device
    small : bool
        Rehearse with networks of a few channels, for a few repeats.
    deadline : float
        Value of `time.monotonic` at which the step has to end.
    """

    out: Path
    data: Path
    device: torch.device
    small: bool
    deadline: float

    @property
    def on_gpu(self) -> bool:
        """True if the device is a GPU."""
        return self.device.type == "cuda"

    @property
    def seconds_left(self) -> float:
        """Time left in s."""
        return self.deadline - time.monotonic()

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

    def wait(self) -> None:
        """Wait until the device has done all its work."""
        if self.on_gpu:
            torch.cuda.synchronize(self.device)


def described_machine(device: torch.device) -> Results:
    """Name of the device, and versions of the software."""
    result = {**machine(SOFTWARE["surrogate"]), "device": hardware(device), "commit": commit()}
    if device.type == "cuda":
        properties = torch.cuda.get_device_properties(device)
        result |= {
            "cuda": torch.version.cuda,
            "cudnn": torch.backends.cudnn.version(),  # type: ignore[no-untyped-call]
            "memory_bytes": properties.total_memory,
            "multiprocessors": properties.multi_processor_count,
        }
    return result


def commit() -> str:
    """Commit of the working tree; "unknown" where there is no history."""
    try:
        asked = subprocess.run(
            ["git", "describe", "--always", "--dirty"], cwd=ROOT, capture_output=True, text=True
        )
    except FileNotFoundError:
        return "unknown"
    return asked.stdout.strip() or "unknown"
