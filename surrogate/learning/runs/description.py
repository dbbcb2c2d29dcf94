"""The description of a run: its configuration, and the dataset that it belongs to.

The ``config.yaml`` of a run folder of version 1 lists every key of every kind of model.
"""

from __future__ import annotations

import inspect
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, Literal

from pydantic import BaseModel, Field, model_validator

from shared_schema.common.configuration import Frozen, absent
from shared_schema.common.errors import InputError
from shared_schema.common.units import Units
from shared_schema.manifest import StructuredInfo
from shared_schema.materials import Materials, materials_of
from surrogate.learning.data.load_range import LoadRange, load_range
from surrogate.learning.models.kinds import RunConfig, kind_of
from surrogate.learning.models.model import Model, TrainedModel
from surrogate.mechanics.body.elements_of_case import element_of

if TYPE_CHECKING:
    from surrogate.learning.data.dataset import Dataset

RENAMED = {  # keys of version 1, by section
    "variational": {"divergence": "kl_divergence", "spread": "posterior_std"},
    "training": {"residency": "samples_on"},
    "network": {"inputs": "force_transforms"},
}


def upgraded(run: Mapping[str, Any], kind: type[Model]) -> dict[str, Any]:
    """Convert a configuration of version 1 to the present one of a kind of model.

    Renamed keys get their present names. Keys that the kind of model does not read are dropped.
    """
    content = dict(run)
    for section, names in RENAMED.items():
        if isinstance(content.get(section), Mapping):
            old = content[section].items()
            content[section] = {names.get(key, key): value for key, value in old}
    network, members = content.get("network"), content.get("ensemble", 1)
    if isinstance(network, Mapping) and "force_transforms" in network:
        used = network["force_transforms"][:members]
        content["network"] = {**network, "force_transforms": used}
    return _known(content, kind)


def _known(content: Mapping[str, Any], model: type[BaseModel]) -> dict[str, Any]:
    """Drop the keys that a configuration class does not have, also in nested sections."""
    kept = {}
    for name, value in content.items():
        field = model.model_fields.get(name)
        if field is None:
            continue
        section = field.annotation
        if isinstance(value, Mapping) and inspect.isclass(section):
            value = _known(value, section) if issubclass(section, BaseModel) else value
        kept[name] = value
    return kept


class DataFingerprint(Frozen):
    """Identity of the dataset that a run belongs to.

    Attributes
    ----------
    case : dict
        The whole case configuration.
    digest : str
        Digest of the structured dataset.
    dimension : int
    cell_type : str
    info : StructuredInfo
        Grid, split and statistics.
    loads : LoadRange or None
        Numbers of loads and resultants of the training split; None in older files.
    forces : {"consistent"} or None
        How the dataset's loads act on elements with points between the nodes, as its manifest says
        it; absent from the file where that is None.
    """

    case: dict[str, Any]
    digest: str
    dimension: int
    cell_type: str
    info: StructuredInfo
    loads: LoadRange | None = None
    forces: Literal["consistent"] | None = Field(None, exclude_if=absent)

    @property
    def load_numbers(self) -> tuple[int, int]:
        """Smallest and largest number of loaded nodes; of older files, as the case says, else 1."""
        if self.loads is not None:
            return max(1, self.loads.fewest), max(1, self.loads.most)
        load = self.case.get("load")
        count = load.get("count", (1, 1)) if isinstance(load, Mapping) else (1, 1)
        return int(count[0]), int(count[1])

    @property
    def units(self) -> Units:
        """Labels of the units of the case."""
        return Units.of_case(self.case)

    @property
    def material(self) -> Materials:
        """Material of the body, or those of its parts; InputError if they are not shipped ones."""
        return materials_of(self.case.get("material"), "material of the run's case")


class Origin(Frozen):
    """Another run whose weights a training starts from.

    Attributes
    ----------
    run : str
        Name of its configuration.
    data : str
        Digest of its dataset.
    weights : str
        Digest of its weights.
    """

    run: str
    data: str
    weights: str


class Refinement(Frozen):
    """Training without solutions after that on a dataset, which earlier versions had.

    Attributes
    ----------
    family : str
        Random loads, as `surrogate.learning.data.case_loads` reads them.
    steps : int
    learning_rate : float
        That of the first step; it falls linearly to zero.
    seed : int
    """

    family: str
    steps: int = Field(ge=1, le=10**9)
    learning_rate: float = Field(gt=0, le=10)
    seed: int = Field(0, ge=0, le=2**63 - 1)


class RunDescription(Frozen):
    """Content of ``config.yaml``.

    Attributes
    ----------
    version : int
        Version of the file; files of version 1 lack this key.
    run : RunConfig
    data : DataFingerprint
    start_from : Origin or None
        Run whose weights the training starts from; absent from the file if there is none.
    went_on_from : tuple of int
        Numbers of epochs after which the training had ended before it went on with more; absent
        from the file if it never did.
    series : {"own"} or None
        How a load series inside a network that learns follows other elements than linear ones, and
        pressures that follow the surface: as the body does it; absent from the file if there are
        none, and in files of earlier versions, whose networks have learned beside the series of
        linear elements under dead loads.
    refined : Refinement or None
        Absent from the file if there is none; otherwise configuration and dataset are those of the
        run before.
    """

    version: Literal[2] = 2
    run: RunConfig
    data: DataFingerprint
    start_from: Origin | None = Field(None, exclude_if=lambda origin: origin is None)
    went_on_from: tuple[int, ...] = Field((), exclude_if=lambda epochs: not epochs)
    series: Literal["own"] | None = Field(None, exclude_if=absent)
    refined: Refinement | None = Field(None, exclude_if=lambda refinement: refinement is None)

    @property
    def epochs(self) -> int | None:
        """Number of epochs of the training; None for a model that is fitted directly."""
        return self.run.training.epochs if isinstance(self.run, TrainedModel) else None

    @property
    def has_series_of_before(self) -> bool:
        """Whether a network has learned beside a load series that is not the body's own."""
        return self.run.learns and self.series is None

    def with_epochs(self, epochs: int | None) -> RunDescription:
        """Return the same description with another number of epochs."""
        training = self.run.training.model_copy(update={"epochs": epochs})
        run = self.run.model_copy(update={"training": training})
        return self.model_copy(update={"run": run})

    def having_gone_on_from(self, epochs: Sequence[int]) -> RunDescription:
        """Return the same description with a record of how the training went on."""
        return self.model_copy(update={"went_on_from": tuple(epochs)})

    def as_before_loads(self) -> RunDescription:
        """Return the same description without `data.loads`, as older files have it."""
        return self.model_copy(update={"data": self.data.model_copy(update={"loads": None})})

    @model_validator(mode="before")
    @classmethod
    def _from_before(cls, content: Any) -> Any:
        """Convert version 1; `training.load_paths` of earlier programs does not matter any more."""
        if not isinstance(content, Mapping) or not isinstance(run := content.get("run"), Mapping):
            return content
        if "version" not in content:
            kind = kind_of(run)
            return (
                content if kind is None else {"version": 2, **content, "run": upgraded(run, kind)}
            )
        if not isinstance(training := run.get("training"), Mapping):
            return content
        training = {key: value for key, value in training.items() if key != "load_paths"}
        return {**content, "run": {**run, "training": training}}


def describe(config: Model, dataset: Dataset, start_from: Origin | None = None) -> RunDescription:
    """Describe a run.

    Raises
    ------
    InputError
        If the configuration is for another case than the dataset's.
    """
    manifest = dataset.manifest
    if config.case != manifest.name:
        raise InputError(
            f"config '{config.name}': key 'case' = '{config.case}', the dataset is of case "
            f"'{manifest.name}'"
        )
    data = DataFingerprint(
        case=manifest.case,
        digest=manifest.digest,
        dimension=manifest.dimension,
        cell_type=dataset.geometry.cell_type,
        info=dataset.info,
        loads=load_range(dataset) if len(dataset.training) else None,
        forces=manifest.forces,
    )
    own: Literal["own"] | None = None
    others = element_of(manifest.case) != "linear" or dataset.geometry.pressed is not None
    if config.learns and config.has_own_series and others:
        own = "own"
    return RunDescription(run=config, data=data, start_from=start_from, series=own)
