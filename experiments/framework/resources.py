"""Datasets, trained networks and predictions of one scale; each is made or read once."""

from __future__ import annotations

from collections.abc import Callable, Hashable, Sequence
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
import torch

from experiments.framework.experiment import Experiment, Setting
from experiments.framework.machine import machine
from experiments.framework.record import DatasetRecord, RunRecord
from experiments.framework.scale import Scale
from shared_schema import MANIFEST, Kind, Manifest, digest_of, read_manifest
from shared_schema.common import InputError
from surrogate import Dataset, Surrogate, load, read_dataset, train
from surrogate.learning.data import NodalDataset, read_nodal_dataset
from surrogate.learning.inference import fit_fast_certificate
from surrogate.learning.measures import Extrapolation, extrapolate
from surrogate.learning.models import Model
from surrogate.learning.networks import parameter_count
from surrogate.learning.probabilistic import Distribution
from surrogate.learning.runs import RunFolder
from surrogate.mechanics.certify import FastCertificate
from surrogate.runtime.device import hardware

Value = TypeVar("Value")
SEED = Setting.seed  # of the stochastic passes


class Resources(Setting):
    """Datasets, trained networks and predictions of one scale: the setting of a study.

    Parameters
    ----------
    scale : Scale
    data : Path
        Folder of the datasets.
    runs : Path
        Folder of the runs. The folder of a run is named after its configuration and the digest of
        configuration and dataset, so that an existing folder is never that of another run.
    device : torch.device
    """

    def __init__(self, scale: Scale, data: Path, runs: Path, device: torch.device) -> None:
        self.scale = scale
        self.device = device
        self.data, self.runs = data, runs
        self._cache: dict[Hashable, Any] = {}

    def configuration(self) -> dict[str, Any]:
        """Name of the scale and number of stochastic passes."""
        return {"scale": self.scale.name, "passes": self.scale.passes}

    def machine(self) -> dict[str, Any]:
        """Describe processor, load and device."""
        return {**machine(), "hardware": hardware(self.device)}

    def fingerprint(self, experiment: Experiment[Any]) -> str:
        """Digest of all that the findings of a study depend on.

        The timing of the scale is left out: more repeats change the noise of a time only.
        """
        scale = self.scale
        return digest_of(
            {
                "study": experiment.name,
                "device": self.device.type if experiment.times else None,
                "passes": scale.passes,
                "datasets": {
                    name: self.manifest(name).digest
                    for name in scale.matching_datasets(experiment.datasets)
                },
                "runs": {run: self.run_fingerprint(run) for run in scale.matching(experiment.runs)},
            }
        )

    def prepare(self, experiment: Experiment[Any]) -> None:
        """Train the missing networks of a study."""
        for run in self.scale.matching(experiment.runs):
            self.trained(run)

    def used_datasets(self, experiment: Experiment[Any]) -> dict[str, DatasetRecord]:
        """Entries of the datasets of a study, those of its runs included."""
        scale = self.scale
        of_runs = [scale.runs[run].data for run in scale.matching(experiment.runs)]
        names = dict.fromkeys([*scale.matching_datasets(experiment.datasets), *of_runs])
        return {name: self.dataset_record(name) for name in names}

    def used_runs(self, experiment: Experiment[Any]) -> dict[str, RunRecord]:
        """Entries of the trained networks of a study."""
        return {run: self.run_record(run) for run in self.scale.matching(experiment.runs)}

    def manifest(self, dataset: str) -> Manifest:
        """Read the manifest of the structured dataset, or of the nodal one if it has no grid.

        Raises
        ------
        InputError
            If the manifest is missing or damaged, its number of samples is not that of the scale,
            or the structured dataset was not made from the nodal one beside it.
        """
        return self._cached(("manifest", dataset), lambda: self._manifest(dataset))

    def _manifest(self, dataset: str) -> Manifest:
        spec = self.scale.datasets[dataset]
        kind: Kind = "structured" if spec.grid else "nodal"
        manifest = read_manifest(self._folder(dataset) / kind, kind)
        expected = spec.samples or manifest.case["dataset"]["samples"]
        found = manifest.samples + manifest.failed
        if spec.case and found != expected:
            raise InputError(
                f"{self._folder(dataset) / kind}: {found} load cases in it, expected {expected} "
                f"by scale '{self.scale.name}'"
            )
        source = self.nodal_folder(dataset)
        if manifest.structured and (source / MANIFEST).is_file():
            digest = read_manifest(source, "nodal").digest
            if manifest.structured.source_digest != digest:
                raise InputError(
                    f"{self._folder(dataset) / kind}: made of samples with digest "
                    f"{manifest.structured.source_digest[:8]}, expected {digest[:8]} of {source}"
                )
        return manifest

    def structured(self, dataset: str) -> Dataset:
        """Read a structured dataset."""
        folder = self._folder(dataset) / "structured"
        return self._cached(("structured", dataset), lambda: read_dataset(folder))

    def nodal_folder(self, dataset: str) -> Path:
        """Folder of a nodal dataset; another order of nodes shares that of its origin."""
        spec = self.scale.datasets[dataset]
        if spec.of and not spec.noise:
            return self.nodal_folder(spec.of)
        return self._folder(dataset) / "nodal"

    def nodal(self, dataset: str) -> NodalDataset:
        """Read a nodal dataset."""
        folder = self.nodal_folder(dataset)
        return self._cached(("nodal", folder), lambda: read_nodal_dataset(folder))

    def config_of(self, name: str) -> Model:
        """Configuration of a run."""
        return self._cached(("configuration", name), lambda: self.scale.config_of(name))

    def run(self, name: str) -> RunFolder:
        """Folder of a run, trained or not."""
        config = self.config_of(name)
        return RunFolder(self.runs / f"{config.name}-{self.run_fingerprint(name)[:8]}")

    def run_fingerprint(self, name: str) -> str:
        """Digest of the configuration and the dataset of a run."""
        return self._cached(("fingerprint", name), lambda: self._run_fingerprint(name))

    def _run_fingerprint(self, name: str) -> str:
        config = self.config_of(name)
        data = self.manifest(self.scale.runs[name].data).digest
        return digest_of({"config": config.plain(), "data": data})

    def trained(self, name: str) -> RunFolder:
        """Folder of a run; trains it first, or resumes its training, if it is not trained."""
        run = self.run(name)
        if not run.is_finished:
            self.runs.mkdir(parents=True, exist_ok=True)
            train(
                self.config_of(name),
                self.dataset_of(name),
                run.folder,
                device=self.device.type,
            )
        return run

    def surrogate(self, name: str) -> Surrogate:
        """Load the trained network of a run."""
        return self._cached(
            ("surrogate", name), lambda: load(self.trained(name).folder, self.device.type)
        )

    def case_of(self, name: str) -> str:
        """Case of a run."""
        return self.scale.case_of(self.scale.runs[name].data)

    def dataset_of(self, name: str) -> Dataset:
        """Structured dataset of a run."""
        return self.structured(self.scale.runs[name].data)

    def predicted_test(self, name: str) -> Distribution:
        """Predict the test split of the dataset of a run: fields (M, n_nodes, d) in m."""
        return self._cached(("test", name), lambda: self._predicted_test(name))

    def _predicted_test(self, name: str) -> Distribution:
        force = self.dataset_of(name).nodal_test.force
        return self.surrogate(name).averaged_passes(force, self.scale.passes, SEED)

    def predicted_loads(self, name: str, dataset: str) -> Extrapolation:
        """Predict all samples of another dataset of the same body by the network of a run."""
        folder = self.nodal_folder(dataset)
        return self._cached(
            ("loads", name, dataset),
            lambda: extrapolate(self.surrogate(name), folder, self.scale.passes, SEED),
        )

    def fast_certificate(self, name: str) -> FastCertificate | None:
        """Fast certificate of a run, calibrated on its held-out samples; None without these."""
        return self._cached(("certificate", name), lambda: self._fast_certificate(name))

    def _fast_certificate(self, name: str) -> FastCertificate | None:
        passes = self.scale.passes
        try:
            return fit_fast_certificate(self.surrogate(name), self.dataset_of(name), passes, SEED)
        except InputError:
            return None

    def dataset_record(self, name: str) -> DatasetRecord:
        """Entry of a dataset in the record of a study."""
        manifest = self.manifest(name)
        return DatasetRecord(case=manifest.name, samples=manifest.samples, digest=manifest.digest)

    def run_record(self, name: str) -> RunRecord:
        """Entry of a trained network in the record of a study."""
        spec, config, run = self.scale.runs[name], self.config_of(name), self.trained(name)
        lines = run.metric_lines()
        return RunRecord(
            config=spec.config,
            change=spec.change,
            data=spec.data,
            seed=config.seed,
            fingerprint=self.run_fingerprint(name),
            epochs=lines[-1]["epoch"],
            minutes=minutes_of([line["seconds"] for line in lines]),
            parameters=parameter_count(self.surrogate(name).network),
            network=config.architecture,
            training=config.training_summary,
            hardware=run.trained_on(),
        )

    def _folder(self, dataset: str) -> Path:
        return self.data / self.scale.folder_of(dataset)

    def _cached(self, key: Hashable, make: Callable[[], Value]) -> Value:
        if key not in self._cache:
            self._cache[key] = make()
        return self._cache[key]


def minutes_of(seconds: Sequence[float]) -> float:
    """Minutes of a training: number of epochs times the median time of one.

    A pause of the machine does not count.

    Parameters
    ----------
    seconds : sequence of float
        Times from the start of the training to the end of every epoch.
    """
    return float(np.median(np.diff(seconds, prepend=0)) * len(seconds) / 60)
