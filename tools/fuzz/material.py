"""What the fuzz attacks: two datasets, a run folder, and commands with their right results.

Every command is executed twice on undamaged input; what is the same both times is its result.
"""

from __future__ import annotations

import hashlib
import json
import shutil
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from types import MappingProxyType
from typing import Any
from zipfile import BadZipFile

import h5py
import numpy as np
import yaml

from tools.fuzz.mutations import leaves
from tools.fuzz.worker import ROOT, Worker

Digests = dict[str, str]

TIMES = "wall_time"  # HDF5 datasets that differ from run to run
SOLVER = "manifest.json.solver."  # measured as well; a manifest made again from its shards lacks it
LOAD = ("--load", "4,1:0,-1")
DONE = (0, 3)  # 3: the network of a few samples is not certified
UNREADABLE = (OSError, ValueError, EOFError, KeyError, RuntimeError, BadZipFile)


@dataclass(frozen=True)
class Command:
    """A command of one program, in a folder that holds what it reads under fixed names.

    Attributes
    ----------
    program : {"datagen", "surrogate"}
    words : tuple of str
    reads : tuple of str
        Those of ``nodal``, ``structured``, ``run``, ``case.yaml`` and ``config.yaml`` it needs.
    """

    program: str
    words: tuple[str, ...]
    reads: tuple[str, ...]


COMMANDS: Mapping[str, Command] = MappingProxyType(
    {
        name: Command(program, tuple(words), tuple(reads))
        for name, program, words, reads in (
            ("run", "datagen", ("run", "case.yaml", "--out", "out"), ["case.yaml"]),
            ("rerun", "datagen", ("run", "case.yaml", "--out", "nodal"), ["case.yaml", "nodal"]),
            (
                "grow",
                "datagen",
                ("run", "case.yaml", "--out", "nodal", "--samples", "19"),
                ["case.yaml", "nodal"],
            ),
            ("solve", "datagen", ("solve", "case.yaml", *LOAD, "--out", "u.npz"), ["case.yaml"]),
            ("check nodal", "datagen", ("check", "nodal"), ["nodal"]),
            ("check structured", "datagen", ("check", "structured"), ["structured"]),
            ("info nodal", "datagen", ("info", "nodal"), ["nodal"]),
            ("info structured", "datagen", ("info", "structured"), ["structured"]),
            ("structure", "datagen", ("structure", "nodal", "--out", "out"), ["nodal"]),
            (
                "embed",
                "datagen",
                ("structure", "nodal", "--out", "out", "--grid", "9,4"),
                ["nodal"],
            ),
            ("noise", "datagen", ("noise", "nodal", "--out", "out"), ["nodal"]),
            ("plot", "datagen", ("plot", "nodal", "--out", "a.png"), ["nodal"]),
            ("series", "datagen", ("export", "nodal", "--out", "a.xdmf"), ["nodal"]),
            (
                "stresses",
                "datagen",
                ("export", "nodal", "--stresses", "--out", "a.pvd"),
                ["nodal"],
            ),
            (
                "train",
                "surrogate",
                ("train", "config.yaml", "--data", "structured", "--out", "out"),
                ["config.yaml", "structured"],
            ),
            (
                "retrain",
                "surrogate",
                ("train", "config.yaml", "--data", "structured", "--out", "run"),
                ["config.yaml", "structured", "run"],
            ),
            (
                "evaluate",
                "surrogate",
                ("evaluate", "run", "--data", "structured"),
                ["run", "structured"],
            ),
            ("predict", "surrogate", ("predict", "run", *LOAD, "--out", "u.npz"), ["run"]),
            (
                "export",
                "surrogate",
                ("export", "run", "--format", "pt2", "--out", "a.pt2"),
                ["run"],
            ),
            ("page", "surrogate", ("page", "run", "--out", "a.html"), ["run"]),
            (
                "report",
                "surrogate",
                ("report", "run", "--nodal", "nodal", "--out", "a.html"),
                ["run", "nodal"],
            ),
        )
    }
)


@dataclass
class Material:
    """Undamaged input of all commands, and their results on it.

    Attributes
    ----------
    folder : Path
        Holds ``nodal``, ``structured``, ``run``, ``case.yaml``, ``config.yaml``.
    workers : dict
        Worker of each program.
    results : dict
        Digests of every command's repeatable results.
    seconds : dict
        Time that every command takes.
    """

    folder: Path
    workers: dict[str, Worker]
    results: dict[str, Digests] = field(default_factory=dict)
    seconds: dict[str, float] = field(default_factory=dict)

    def execute(self, name: str, words: list[str], folder: Path, **more: Any) -> dict[str, Any]:
        """Execute a command, with these words instead of its own."""
        worker = self.workers[COMMANDS[name].program]
        return worker.execute(words, folder, **{"limit": 60.0, **more})

    def lay_out(self, name: str, folder: Path) -> Path:
        """Make a folder with copies of what a command reads."""
        folder.mkdir()
        for part in COMMANDS[name].reads:
            source = self.folder / part
            if source.is_dir():
                shutil.copytree(source, folder / part)
            else:
                shutil.copy(source, folder / part)
        return folder

    def learn(self, scratch: Path) -> None:
        """Execute every command twice and keep what is the same."""
        for name, command in COMMANDS.items():
            found = []
            for attempt in ("one", "two"):
                folder = self.lay_out(name, scratch / attempt)
                answer = self.execute(name, list(command.words), folder, limit=600.0)
                if answer["code"] not in DONE:
                    raise RuntimeError(f"{name} on undamaged input: {answer}")
                found.append(digests(folder) | {"stdout": answer["stdout"]})
                self.seconds[name] = answer["seconds"]
                shutil.rmtree(folder)
            one, two = found
            self.results[name] = {key: one[key] for key in one if one[key] == two.get(key)}


def make_material(folder: Path, workers: dict[str, Worker]) -> Material:
    """Make datasets of 12 samples of the 2D beam and train a small network on them."""
    folder.mkdir()
    case = yaml.safe_load((ROOT / "datagen/configs/beam2d.yaml").read_text())
    case["dataset"] |= {"samples": 12, "shard_size": 5, "test_fraction": 0.25}
    (folder / "case.yaml").write_text(yaml.safe_dump(case))
    config = yaml.safe_load((ROOT / "surrogate/configs/det-fast.yaml").read_text())
    config |= {"name": "fuzz", "case": "beam2d"}
    config["network"] |= {"levels": 2, "channels": 2}
    config["training"] |= {"epochs": 3, "batch_size": 4, "validation_fraction": 0.2}
    config["training"] |= {"calibration_fraction": 0.2}
    (folder / "config.yaml").write_text(yaml.safe_dump(config))
    material = Material(folder, workers)
    for name, words in (
        ("run", ["run", "case.yaml", "--out", "nodal"]),
        ("structure", ["structure", "nodal", "--out", "structured"]),
        ("train", ["train", "config.yaml", "--data", "structured", "--out", "run"]),
        ("evaluate", ["evaluate", "run", "--data", "structured"]),
    ):
        answer = material.execute(name, words, folder, limit=600.0)
        if answer["code"] != 0:
            raise RuntimeError(f"{words}: {answer}")
    return material


def digests(folder: Path) -> Digests:
    """What the files below a folder hold: numbers of JSON one by one, else a digest for each."""
    found: Digests = {}
    for path in sorted(path for path in folder.rglob("*") if path.is_file()):
        name = str(path.relative_to(folder))
        try:
            if path.suffix == ".json":
                numbers = leaves(json.loads(path.read_text()), name)
                found |= {key: n for key, n in numbers.items() if SOLVER not in key}
            elif path.suffix == ".h5":
                found[name] = _of_hdf5(path)
            elif path.suffix == ".npz":
                with np.load(path) as arrays:
                    found[name] = _of({key: arrays[key] for key in arrays})
            else:
                found[name] = hashlib.sha256(path.read_bytes()).hexdigest()
        except UNREADABLE as error:
            found[name] = f"unreadable: {error}"
    return found


def _of_hdf5(path: Path) -> str:
    arrays: dict[str, Any] = {}

    def take(name: str, item: Any) -> None:
        if isinstance(item, h5py.Dataset) and not name.endswith(TIMES):
            arrays[name] = item[()]

    with h5py.File(path, "r") as file:
        file.visititems(take)
    return _of(arrays)


def _of(arrays: dict[str, Any]) -> str:
    digest = hashlib.sha256()
    for name in sorted(arrays):
        values = np.asarray(arrays[name])
        content = values.tobytes() if values.dtype != object else repr(values.tolist()).encode()
        digest.update(f"{name} {values.shape}".encode() + content)
    return digest.hexdigest()
