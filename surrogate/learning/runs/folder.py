"""The folder of a run: configuration, weights, measures. No file in it is a pickle.

::

    manifest.json       checksums of all finished files, except those of TensorBoard
    config.yaml         resolved configuration, and the dataset of the training
    model.safetensors   weights, scales, mesh and grid map
    metrics.jsonl       one line per epoch, each with its own checksum
    hardware.txt        name of the hardware of the training
    evaluation.json     errors on the test split
    intervals.safetensors   factors of conformal intervals (with `evaluate --conformal`)
    fast_certificate.safetensors   calibrated ratios (with `evaluate --certify`, `calibrate`)
    modal_cubature.safetensors   points of the equilibrium in modes (with `surrogate balance`)
    columns.safetensors   columns of the compliance (with `Surrogate.prepare`)
    figures/            figures
    checkpoint/         last.safetensors, to resume from, with its own checksum
    tensorboard/        event files of TensorBoard (with `train --tensorboard`)
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path
from typing import Any

import yaml
from torch import Tensor

from shared_schema.common.configuration import difference_text, differences, read_yaml, validate
from shared_schema.common.errors import InputError
from shared_schema.common.files import complete_or_absent, remove_partial_files, write_text
from shared_schema.common.folder_lock import LOCK, FolderLock
from surrogate.learning.runs.description import RunDescription
from surrogate.learning.runs.seal import Seal, read_lines, write_lines
from surrogate.runtime.tensor_file import load_tensors, save_atomically


class RunFolder:
    """Paths and files of one run.

    Parameters
    ----------
    folder : Path
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.config = folder / "config.yaml"
        self.model = folder / "model.safetensors"
        self.metrics = folder / "metrics.jsonl"
        self.hardware = folder / "hardware.txt"
        self.evaluation = folder / "evaluation.json"
        self.intervals = folder / "intervals.safetensors"
        self.fast_certificate = folder / "fast_certificate.safetensors"
        self.modal_cubature = folder / "modal_cubature.safetensors"
        self.columns = folder / "columns.safetensors"
        self.figures = folder / "figures"
        self.checkpoint = folder / "checkpoint" / "last.safetensors"
        self.tensorboard = folder / "tensorboard"
        self.seal = Seal(folder)

    @property
    def is_finished(self) -> bool:
        """True if the training has ended with a model."""
        return self.seal.lists(self.model)

    @property
    def unsealed(self) -> str | None:
        """Remark that nothing in the folder can be checked; None if it has a manifest."""
        if self.seal.exists or not self.config.is_file():
            return None
        return f"{self.folder}: unsealed, an earlier version made it; its files are read unchecked"

    def require_free(self, description: RunDescription) -> RunDescription:
        """Require that a run can start, resume or go on in the folder; nothing is written.

        A run without a finished epoch gives way to another one. A training that has ended goes on
        if the description has more epochs, and is the same otherwise.

        Returns
        -------
        RunDescription
            The description with the record of how the training went on.

        Raises
        ------
        InputError
            If the folder belongs to another run (the message names the first difference), holds
            other files, or a finished file in it is damaged.
        """
        if self.config.is_file():
            existing = self.description()
            if existing.data.loads is None:
                description = description.as_before_loads()
            description = description.having_gone_on_from(existing.went_on_from)
            if existing != description and self._is_bound():
                description = self._going_on(existing, description)
            self.seal.require_intact()
            self.metric_lines()
        elif self.folder.exists() and (not self.folder.is_dir() or self._content()):
            raise InputError(
                f"out '{self.folder}': holds something else, expected a new folder", "out"
            )
        return description

    def _going_on(self, existing: RunDescription, wanted: RunDescription) -> RunDescription:
        """Return the description of a training that goes on with more epochs; InputError if not."""
        before, epochs = existing.epochs, wanted.epochs
        where = f"--out '{self.folder}'"
        done, _ = self.training_effort()
        is_longer = before is not None and epochs is not None and epochs > before
        has_ended = before is not None and (self.is_finished or done >= before)
        goes_on = is_longer and has_ended
        expected = existing.with_epochs(epochs) if goes_on else existing
        if expected != wanted:
            difference = first_difference(expected.model_dump(), wanted.model_dump())
            raise InputError(f"{where}: a run with another {difference}")
        assert before is not None
        if done < before:
            raise InputError(
                f"{where}: early stopping has ended the training after epoch {done} of {before}; "
                "more epochs would not change it"
            )
        if not self.checkpoint.is_file():
            raise InputError(
                f"{where}: no {self.checkpoint.name} to go on from; `--start-from "
                f"{self.folder}` with another folder trains on from its weights"
            )
        return wanted.having_gone_on_from((*existing.went_on_from, before))

    def start(self, description: RunDescription) -> None:
        """Make the folder, or continue in it after `require_free`; seal its configuration.

        A training that goes on is not finished until its new end; its evaluation is dropped.

        Raises
        ------
        InputError
            See `require_free`.
        """
        description = self.require_free(description)
        for folder in (self.folder, self.checkpoint.parent, self.figures):
            remove_partial_files(folder)
        if self._is_bound():
            resumes = self.description().went_on_from == description.went_on_from
            if not self.seal.exists:  # an earlier version made the folder
                write_lines(self.metrics, self.metric_lines())
            elif resumes and self.seal.lists(self.config):
                return
            if not resumes:
                self.seal.make()  # lists nothing, so that nothing counts as finished
                self._write_config(description)
        else:
            self.folder.mkdir(parents=True, exist_ok=True)
            self._write_config(description)
        self.seal.make(self.config)

    def _write_config(self, description: RunDescription) -> None:
        content = description.model_dump(mode="json")
        write_text(self.config, yaml.safe_dump(content, sort_keys=False))

    @contextmanager
    def owned(self) -> Iterator[None]:
        """Work alone in the folder, which is made; if it stays empty, it is removed again.

        Raises
        ------
        InputError
            If another process works in the folder.
        """
        try:
            with FolderLock(self.folder):
                yield
        finally:
            with suppress(OSError):
                self.folder.rmdir()

    def _content(self) -> list[Path]:
        return [path for path in self.folder.iterdir() if path.name != LOCK]

    def _is_bound(self) -> bool:
        """True if the folder has results, so that it belongs to its configuration."""
        return self.checkpoint.is_file() or self.model.is_file()

    def description(self) -> RunDescription:
        """Read ``config.yaml``; InputError if it is missing or damaged."""
        if not self.config.is_file():
            raise InputError(f"{self.folder}: no run there, expected a folder with config.yaml")
        self.seal.require_intact(self.config)
        return validate(RunDescription, read_yaml(self.config), str(self.config))

    def read_tensors(self) -> dict[str, Tensor]:
        """Read ``model.safetensors``; InputError if the run is not finished or damaged."""
        if not self.is_finished:
            raise InputError(f"{self.folder}: the run is not finished, no {self.model.name} in it")
        self.seal.require_intact(self.model)
        return load_tensors(self.model)[0]

    def write_tensors(self, tensors: dict[str, Tensor]) -> None:
        """Write ``model.safetensors`` atomically, and seal all that the training has written."""
        save_atomically(tensors, self.model)
        self.seal.add(p for p in (self.model, self.metrics, self.hardware) if p.is_file())

    def write_model(self, tensors: dict[str, Tensor], hardware: str) -> None:
        """Write the name of the hardware of a training, then its model; the run is finished."""
        write_text(self.hardware, hardware + "\n")
        self.write_tensors(tensors)

    def trained_on(self) -> str:
        """Return the name of the hardware of the training; "unknown" if the file is missing."""
        self.seal.require_intact(self.hardware)
        return self.hardware.read_text().strip() if self.hardware.is_file() else "unknown"

    def metric_lines(self) -> list[dict[str, Any]]:
        """Read every complete line of ``metrics.jsonl``; an incomplete last line is left out.

        Raises
        ------
        InputError
            If a line is damaged.
        """
        self.seal.require_intact(self.metrics)
        return read_lines(self.metrics, checked=self.seal.exists)

    def training_effort(self) -> tuple[int, float]:
        """Return epochs and seconds of the training; those of the evaluation if it has no lines."""
        if lines := self.metric_lines():
            return lines[-1]["epoch"], lines[-1]["seconds"]
        if not self.evaluation.is_file():
            return 0, 0.0
        evaluation = self.read_evaluation()
        return evaluation["epochs"], evaluation["training_seconds"]

    def progress(self) -> str:
        """Describe how far the training is, such as "trained, 80 of 80 epochs, 405 s"."""
        learns = self.description().run.learns
        trained = "trained" if learns else "ready, without training"
        state = trained if self.is_finished else "stopped; resume with the same command"
        of, (done, seconds) = self.description().epochs, self.training_effort()
        epochs = "" if of is None else f"{done} of {of} epochs, "
        return f"{state}, {epochs}{seconds:.0f} s"

    def keep_metric_lines(self, epoch: int) -> None:
        """Delete the lines of epochs after `epoch`; InputError if a line before is missing."""
        lines = [line for line in self.metric_lines() if line["epoch"] <= epoch]
        if len(lines) < epoch:
            raise InputError(
                f"{self.metrics}: {len(lines)} lines of epochs, expected {epoch} as in "
                f"{self.checkpoint.name}"
            )
        write_lines(self.metrics, lines)

    def write_evaluation(self, files: Mapping[Path, bytes]) -> None:
        """Write all files of an evaluation in place of those before, or none of them.

        Parameters
        ----------
        files : mapping of Path to bytes
            New content of ``evaluation.json``, ``intervals.safetensors``,
            ``fast_certificate.safetensors`` and the figures. Other figures are removed; what is
            calibrated and not among the new files stays.

        Raises
        ------
        InputError
            If another process works in the folder.
        OSError
            If a file cannot be written; those before are then still there.
        """
        with FolderLock(self.folder, "RUN"):
            self.figures.mkdir(exist_ok=True)
            for folder in (self.folder, self.figures):
                remove_partial_files(folder)
            before = [self.evaluation, *self.figures.iterdir()]
            with ExitStack() as all_or_none:
                for path, content in files.items():
                    all_or_none.enter_context(complete_or_absent(path)).write_bytes(content)
                self.seal.withdraw([*before, *files])
                for path in before:
                    path.unlink(missing_ok=True)
            self.seal.add(files)

    def write_fast_certificate(self, content: bytes, measured: Any = None) -> None:
        """Write ``fast_certificate.safetensors``, and seal it.

        What the evaluation says of earlier bounds is replaced by what is `measured`, if anything.

        Raises
        ------
        InputError
            If another process works in the folder.
        """
        files = {self.fast_certificate: content}
        if self.seal.lists(self.evaluation):
            evaluation = self.read_evaluation()
            evaluation.pop("fast_certificate", None)
            if measured is not None:
                evaluation["fast_certificate"] = measured
            files[self.evaluation] = (json.dumps(evaluation, indent=1) + "\n").encode()
        self._write_sealed(files)

    def write_columns(self, content: bytes) -> None:
        """Write ``columns.safetensors``, and seal it; InputError as above."""
        self._write_sealed({self.columns: content})

    def write_cubature(self, content: bytes) -> None:
        """Write ``modal_cubature.safetensors``, and seal it; InputError as above."""
        self._write_sealed({self.modal_cubature: content})

    def _write_sealed(self, files: Mapping[Path, bytes]) -> None:
        with FolderLock(self.folder, "RUN"):
            remove_partial_files(self.folder)
            with ExitStack() as all_or_none:
                for path, content in files.items():
                    all_or_none.enter_context(complete_or_absent(path)).write_bytes(content)
                self.seal.withdraw(files)
            self.seal.add(files)

    def read_figures(self) -> dict[str, bytes]:
        """Read the figures of the evaluation by file name; InputError if one is damaged or gone."""
        if self.seal.exists:
            listed = (self.folder / name for name in self.seal.files())
            files = sorted(path for path in listed if path.parent == self.figures)
            for path in files:
                self.seal.require_intact(path)
        else:
            files = sorted(self.figures.glob("*.png"))
        return {path.name: path.read_bytes() for path in files}

    def read_evaluation(self) -> dict[str, Any]:
        """Read ``evaluation.json``; InputError if it is missing or damaged."""
        if not self.seal.lists(self.evaluation):
            raise InputError(f"{self.folder}: not evaluated yet, no {self.evaluation.name} in it")
        self.seal.require_intact(self.evaluation)
        return read_mapping(self.evaluation)

    def mean_error(self) -> float | None:
        """Return ē in m on the test split of the run's own dataset; None if it is not known."""
        try:
            evaluation = self.read_evaluation()
            own = evaluation["trained_on_this_data"]
            return float(evaluation["test"]["mean_error"]) if own else None
        except (InputError, KeyError, TypeError, ValueError):
            return None


def read_mapping(path: Path) -> dict[str, Any]:
    """Read a mapping from a JSON file; InputError if the file is missing or damaged."""
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError, RecursionError) as error:
        raise InputError(f"{path}: damaged ({error})") from None
    if not isinstance(content, dict):
        raise InputError(f"{path}: damaged, expected a mapping")
    return content


def first_difference(old: dict[str, Any], new: dict[str, Any]) -> str:
    """Describe the first difference of two nested mappings: ``key = new, the folder has old``."""
    key, values = next(iter(differences(old, new).items()))
    return difference_text(key, *values)
