"""What an interrupted `datagen run` leaves: a folder ``.journal`` with the case and its shards."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path

JOURNAL = ".journal"


@dataclass(frozen=True)
class Unfinished:
    """A dataset whose `datagen run` has not ended.

    Attributes
    ----------
    folder : Path
    samples : int
        Number of load cases of the whole dataset.
    shards, finished : int
        Number of all its shards, and of those that are finished since the run began.
    """

    folder: Path
    samples: int
    shards: int
    finished: int

    @property
    def how_to_go_on(self) -> str:
        """Say how the dataset is finished."""
        return f"run the same `datagen run … --out {self.folder}` again"


def growing(unfinished: Unfinished) -> str:
    """Say that a complete dataset grows, and how that is finished."""
    return f"grows to {unfinished.samples} samples, unfinished; {unfinished.how_to_go_on}"


def find_unfinished(folder: Path) -> Unfinished | None:
    """Read the journal of a folder; None if it has none that can be read."""
    journal = folder / JOURNAL
    try:
        settings = json.loads((journal / "case.json").read_text(encoding="utf-8"))["dataset"]
        samples, size = int(settings["samples"]), int(settings["shard_size"])
        finished = sum(1 for entry in journal.glob("shard-*.json"))
    except (OSError, ValueError, KeyError, TypeError, RecursionError):
        return None
    return Unfinished(folder, samples, -(-samples // max(size, 1)), finished)
