"""Scales of the studies: datasets, networks trained on them, passes and repeats of timing."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from fnmatch import fnmatchcase
from pathlib import Path
from typing import Any, Literal, Self

from pydantic import Field, TypeAdapter, model_validator

from experiments.framework.timing import TIMING, Timing
from shared_schema import NodeOrder, digest_of
from shared_schema.common import Frozen, InputError, changed, read_named, source_of, validate
from surrogate.learning.models import Model, UNetModel
from surrogate.learning.probabilistic import MOST_PASSES, PASSES
from surrogate.learning.runs import read_recipe, run_config


class DatasetSpec(Frozen):
    """Origin of a dataset made by `datagen`: a case, or another dataset of the same scale.

    Attributes
    ----------
    case : str, optional
        Name of a shipped case.
    samples : int, optional
        Number of samples; by default that of the case.
    of : str, optional
        Name of the dataset from which this one is made, with noise, another order of nodes or all
        of them in a row.
    noise : bool
        Add the paper's noise.
    order : {"preferred", "gmsh", "random"}
        Order of the nodes on the grid.
    grid : bool or "nodes"
        Make the structured dataset as well, for training; with "nodes" all nodes stand in a row.
    change : dict of str to value
        New values of keys of the case, such as ``mesh.elements``.
    """

    case: str | None = None
    samples: int | None = Field(None, ge=1, le=10**9)
    of: str | None = None
    noise: bool = False
    order: NodeOrder = "preferred"
    grid: bool | Literal["nodes"] = True
    change: dict[str, Any] = Field(default_factory=dict)

    @model_validator(mode="after")
    def _one_origin(self) -> Self:
        changed = self.noise or self.order != "preferred" or self.grid == "nodes"
        if (self.case is None) == (self.of is None) or changed != (self.of is not None):
            raise ValueError(
                "expected either 'case', or 'of' and one of 'noise', 'order' and 'grid: nodes'"
            )
        if self.change and self.case is None:
            raise ValueError("'change' changes a 'case'")
        return self


class RunSpec(Frozen):
    """A network to train.

    Attributes
    ----------
    config : str
        Name of a shipped configuration; its case is replaced by that of the dataset.
    data : str
        Name of the dataset.
    change : dict
        New values of keys of the configuration, nested in the same way.
    """

    config: str
    data: str
    change: dict[str, Any] = Field(default_factory=dict)


class RunSeries(RunSpec):
    """A network to train on growing numbers of samples; run NAME-nN is that on N of them.

    Attributes
    ----------
    samples : tuple of int
        Numbers of training samples N.
    sample_epochs : int, optional
        Samples that are seen in each training, so that all have as many steps: number of epochs
        times N. None for models that are fitted directly.
    """

    samples: tuple[int, ...] = Field(min_length=1)
    sample_epochs: int | None = Field(None, ge=1)

    def runs(self, name: str) -> dict[str, RunSpec]:
        """Runs of the series by name."""
        runs = {}
        for count in self.samples:
            training: dict[str, Any] = {"samples": count}
            if self.sample_epochs is not None:
                training["epochs"] = max(1, round(self.sample_epochs / count))
            change = merged(self.change, {"training": training})
            runs[f"{name}-n{count}"] = RunSpec(config=self.config, data=self.data, change=change)
        return runs


class Scale(Frozen):
    """One size of all studies.

    Attributes
    ----------
    name : str
    description : str
        Paragraph for the report.
    passes : int
        Number of stochastic passes T of a prediction.
    timing : Timing
        Repeats of a time that is measured.
    verdicts : bool
        False if the numbers say nothing about agreement with the paper.
    datasets : dict of str to DatasetSpec
        Datasets by name.
    runs : dict of str to RunSpec
        Networks by name. In a file, `series` adds those of each `RunSeries` by name.
    """

    name: str
    description: str
    passes: int = Field(PASSES, ge=1, le=MOST_PASSES)
    timing: Timing = TIMING
    verdicts: bool = True
    datasets: dict[str, DatasetSpec]
    runs: dict[str, RunSpec]

    @model_validator(mode="before")
    @classmethod
    def _with_series(cls, content: Any) -> Any:
        if not isinstance(content, Mapping) or "series" not in content:
            return content
        series = TypeAdapter(dict[str, RunSeries]).validate_python(content["series"])
        rest = {key: value for key, value in content.items() if key != "series"}
        added = {run: spec for name, one in series.items() for run, spec in one.runs(name).items()}
        return rest | {"runs": {**content.get("runs", {}), **added}}

    @model_validator(mode="after")
    def _known_datasets(self) -> Self:
        used = [spec.of for spec in self.datasets.values() if spec.of]
        for name in [*used, *(spec.data for spec in self.runs.values())]:
            if name not in self.datasets:
                raise ValueError(f"'{name}' is none of its datasets")
        return self

    def case_of(self, dataset: str) -> str:
        """Case of a dataset, or of the dataset from which it is made."""
        spec = self.datasets[dataset]
        return spec.case or self.case_of(str(spec.of))

    def folder_of(self, dataset: str) -> str:
        """Name of the folder of a dataset, the same at all scales with the same dataset."""
        spec = self.datasets[dataset]
        if spec.of:
            row = "nodes" if spec.grid == "nodes" else spec.order
            return f"{self.folder_of(spec.of)}-{'noisy' if spec.noise else row}"
        name = f"{spec.case}-{spec.samples}" if spec.samples else str(spec.case)
        return f"{name}-{digest_of(spec.change)[:8]}" if spec.change else name

    def matching(self, patterns: tuple[str, ...]) -> list[str]:
        """Names of the runs that match one of the patterns, in the order of the scale."""
        return matching(self.runs, patterns)

    def matching_datasets(self, patterns: tuple[str, ...]) -> list[str]:
        """Names of the datasets that match one of the patterns, in the order of the scale."""
        return matching(self.datasets, patterns)

    def config_of(self, run: str) -> Model:
        """Configuration of a run.

        Raises
        ------
        InputError
            If there is no such configuration, or a change does not fit into it.
        """
        spec = self.runs[run]
        content, source = read_recipe(spec.config)
        content["case"] = self.case_of(spec.data)
        if spec.change:
            content = merged(content, {"name": run, "recipe": "custom", **spec.change})
        return run_config(content, f"scale '{self.name}', run '{run}', {source}")

    def unet_of(self, run: str) -> UNetModel:
        """Configuration of a run of U-Nets; InputError if it is of another kind of model."""
        config = self.config_of(run)
        if not isinstance(config, UNetModel):
            raise InputError(
                f"scale '{self.name}', run '{run}': key 'model' = '{config.model}', expected 'unet'"
            )
        return config


def matching(names: Iterable[str], patterns: tuple[str, ...]) -> list[str]:
    """Return the names that match one of some patterns."""
    return [name for name in names if any(fnmatchcase(name, p) for p in patterns)]


def merged(content: Mapping[str, Any], change: Mapping[str, Any]) -> dict[str, Any]:
    """Merge changes into nested mappings; the value None removes a key."""
    result = dict(content)
    for key, value in change.items():
        if isinstance(value, Mapping) and isinstance(result.get(key), Mapping):
            result[key] = merged(result[key], value)
        elif value is None:
            result.pop(key, None)
        else:
            result[key] = value
    return result


def read_scale(name: str, shipped: Path, changes: Sequence[str] = ()) -> Scale:
    """Read a scale: the name of a shipped one such as ``smoke``, or a YAML file.

    Parameters
    ----------
    name : str
    shipped : Path
        Folder of the shipped scales of a report.
    changes : sequence of str
        New values of keys, such as ``passes=20`` (`changed`).

    Raises
    ------
    InputError
        If there is no such scale, or a key or value in it is wrong.
    """
    content, file = read_named(name, shipped, "--scale")
    return validate(Scale, changed(content, changes), source_of(file, changes))
