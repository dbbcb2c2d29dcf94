"""A first configuration for one's own body, from its grid, its samples and the memory there is.

It is a recipe of this project, with linear elasticity inside the network if the dataset names its
material. Sizes follow the dataset; every line says what it is and how to change it.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from math import ceil, log2
from pathlib import Path
from typing import Literal, NamedTuple

import yaml

from shared_schema.common.arguments import checked_arguments
from shared_schema.common.configuration import read_yaml
from shared_schema.common.errors import InputError
from shared_schema.common.machine import available_memory
from shared_schema.manifest import MANIFEST
from shared_schema.materials import NeoHookean
from surrogate.learning.data.dataset import Dataset
from surrogate.learning.data.joined_dataset import read_dataset
from surrogate.learning.models.kinds import run_config
from surrogate.learning.models.model import Model, TrainedModel
from surrogate.learning.models.network_model import training_memory
from surrogate.learning.probabilistic.likelihoods import Likelihood

Architecture = Literal["unet", "reduced"]
SHORT = {"deterministic": "det", "maximum_likelihood": "mle", "variational_bayes": "vb"}
STEPS = {"deterministic": 12_000, "maximum_likelihood": 10_000, "variational_bayes": 7_000}
EPOCHS = (20, 400)
BATCHES = (4, 8, 16, 32)
STEPS_PER_EPOCH = 50  # at least, if batches can be small enough
SHARE = 0.25  # of the free memory that a training may take
MOST_LEVELS = 4
WIDEST = 56  # entry of the file whose comment is aligned with the others
INPUT_MODES, OUTPUT_MODES = 48, 96
DATA = Path("data")  # where `make data` puts datasets
SET_ASIDE = 20  # samples at least for validation, and for calibration


class Line(NamedTuple):
    """A line of the file: nesting, key, value as YAML (empty for a section), and comment."""

    level: int
    key: str
    value: str
    comment: str


@dataclass(frozen=True)
class FirstConfig:
    """A first configuration for a dataset.

    Attributes
    ----------
    dataset : Dataset
    model : {"unet", "reduced"}
    likelihood : {"deterministic", "maximum_likelihood", "variational_bayes"}
    channels : int
        Number of channels of a U-Net's finest level.
    """

    dataset: Dataset
    model: Architecture
    likelihood: Likelihood
    channels: int

    @property
    def case(self) -> str:
        """Name of the dataset's case."""
        return self.dataset.manifest.name

    @property
    def samples(self) -> int:
        """Number of training samples."""
        return len(self.dataset.training)

    @property
    def batch(self) -> int:
        """Number of samples of a step: the most with enough steps in an epoch."""
        fit = [batch for batch in BATCHES if batch * STEPS_PER_EPOCH <= self.samples]
        return max(fit, default=BATCHES[0])

    @property
    def epochs(self) -> int:
        """Number of epochs with about `STEPS` steps, in tens."""
        steps = ceil(self.samples / self.batch)
        least, most = EPOCHS
        return max(least, min(most, 10 * round(STEPS[self.likelihood] / steps / 10)))

    @property
    def levels(self) -> int:
        """Number of levels: the coarsest has two points along the shortest side, or it is third."""
        halvings = int(log2(min(self.dataset.geometry.grid.shape)))
        return max(1, min(MOST_LEVELS, 1 + halvings, max(3, halvings)))

    @property
    def fraction(self) -> float:
        """Fraction of the samples that is set aside for a purpose."""
        return min(0.1, max(0.02, round(SET_ASIDE / self.samples, 2)))

    @property
    def has_mechanics(self) -> bool:
        """True if the network can know the stiffness: that of a named material, and one shape."""
        return has_material(self.dataset) and self.dataset.geometry.shapes is None

    def config(self) -> Model:
        """Return the configuration itself; its numbers are valid."""
        return run_config(yaml.safe_load(self.text()), "the suggested configuration")

    def text(self) -> str:
        """Return the file, with a comment on every line."""
        shape = " × ".join(map(str, self.dataset.geometry.grid.shape))
        nodes = len(self.dataset.geometry.coordinates)
        head = (
            f"# A first configuration for the body of case {self.case}: {nodes} nodes, a grid of\n"
            f"# {shape} points, {self.samples} training samples. `surrogate schema` has all keys.\n"
        )
        lines = list(self._lines())
        entries = [f"{'  ' * line.level}{line.key}: {line.value}".rstrip() for line in lines]
        width = max(len(entry) for entry in entries if len(entry) < WIDEST)
        return head + "".join(
            f"{entry:<{width}}  # {line.comment}\n"
            for entry, line in zip(entries, lines, strict=True)
        )

    def _lines(self) -> Iterator[Line]:
        name = f"{self.case}-{self.model}-{SHORT[self.likelihood]}"
        yield Line(0, "name", name, "of the configuration, for reports")
        yield Line(0, "case", self.case, "of the dataset; a run is for one case")
        yield Line(0, "recipe", "custom", "origin of the settings: you")
        yield Line(0, "model", self.model, "unet: on the grid; reduced: between modes of the body")
        others = "the others predict standard deviations too (`init --likelihood`)"
        yield Line(0, "likelihood", self.likelihood, others)
        yield Line(0, "network", "", "size of the network")
        yield from self._unet() if self.model == "unet" else self._reduced()
        if self.likelihood == "variational_bayes":
            yield Line(0, "ensemble", "4", "networks that are trained together")
            which = "convolutions: [2]" if self.model == "unet" else "layers: [1, 2, 3]"
            yield Line(
                0,
                "variational",
                f"{{{which}, initial_std: 5.0e-4, posterior_std: gauss_newton}}",
                "random weights",
            )
        if self.model == "unet":
            scale = "outputs in units of each node's own displacements"
            yield Line(0, "displacement_scale", "node", scale)
        yield Line(0, "training", "", "how the network is trained")
        yield from self._training()
        yield Line(0, "seed", "0", "of initial weights, splits and order of the samples")

    def _unet(self) -> Iterator[Line]:
        shape = self.dataset.geometry.grid.shape
        coarsest = " × ".join(str(max(1, n // 2 ** (self.levels - 1))) for n in shape)
        yield Line(1, "levels", str(self.levels), f"grid resolutions; the coarsest is {coarsest}")
        channels = "of the finest level; more: smaller errors, longer training"
        yield Line(1, "channels", str(self.channels), channels)
        multiplier = 2 if len(shape) == 2 else 1
        growth = "ratio of the channels of a level and of the next finer one"
        yield Line(1, "multiplier", str(multiplier), growth)
        yield Line(1, "padding", "0", "rows of zeros around the grid")
        yield Line(1, "activation", "silu", "smooth, as the solutions are")
        yield Line(1, "batch_norm", "false", "the scales of a field mean something")
        if self.has_series:
            inputs = "[force, linear_gradient, last_gradient]"
            yield Line(1, "inputs", inputs, "forces, and the series of the displacement in them")
            yield Line(1, "skip", "series", "predict the difference from the series")
            yield Line(1, "series_order", "4", "of its last term; more: slower predictions")
        elif self.has_mechanics:
            yield Line(1, "inputs", "[force, linear_gradient]", "forces, and linear elasticity")
            yield Line(1, "skip", "linear", "predict the difference from linear elasticity")

    @property
    def has_series(self) -> bool:
        """True for a body in the plane whose load series a U-Net can have."""
        in_plane = self.dataset.geometry.dimension == 2
        return in_plane and self.has_mechanics and isinstance(self.dataset.material, NeoHookean)

    def _reduced(self) -> Iterator[Line]:
        free = int(self.dataset.geometry.movable.sum())
        most = max(1, min(free, self.samples - 2 * ceil(self.fraction * self.samples)))
        yield Line(1, "input_modes", str(min(INPUT_MODES, most)), "modes of the linear response")
        yield Line(1, "output_modes", str(min(OUTPUT_MODES, most)), "modes of its correction")
        yield Line(1, "width", "256", "of the hidden layers; more: smaller errors, longer training")
        yield Line(1, "depth", "3", "hidden layers")

    def _training(self) -> Iterator[Line]:
        steps = ceil(self.samples / self.batch) * self.epochs
        yield Line(1, "epochs", str(self.epochs), f"about {steps} steps; more: smaller errors")
        yield Line(1, "batch_size", str(self.batch), "samples of a step")
        if self.likelihood == "deterministic":
            yield Line(1, "loss", "mae", "mean absolute error, as ē measures it")
        yield Line(1, "optimiser", "{name: muon, learning_rate: 3.0e-3}", "lower if it diverges")
        yield Line(1, "schedule", "{name: linear, warmup: 0.05}", "the rate decays to zero")
        share = f"{self.fraction:g}"
        kept = round(self.fraction * self.samples)
        yield Line(1, "validation_fraction", share, f"{kept} samples for the loss curve")
        yield Line(1, "calibration_fraction", share, f"{kept} samples for `evaluate --conformal`")
        if self.likelihood != "deterministic":
            yield Line(1, "recalibrate", "true", "factors on the standard deviations, fitted")
        yield Line(1, "samples_on", "auto", "disk for datasets larger than the memory")


def has_material(dataset: Dataset) -> bool:
    """True if a dataset names its material."""
    try:
        return dataset.material is not None
    except InputError:
        return False


@checked_arguments
def first_config(
    dataset: Dataset | str | Path,
    *,
    model: Architecture | None = None,
    likelihood: Likelihood = "deterministic",
) -> FirstConfig:
    """Choose a configuration with the sizes of a network for a dataset.

    Parameters
    ----------
    dataset : Dataset, str or Path
        Dataset, or its folder.
    model : {"unet", "reduced"}, optional
        By default a U-Net on a grid in the plane, and a reduced network in space, where the nodes
        are many and the samples few, and where the nodes stand in a row.
    likelihood : {"deterministic", "maximum_likelihood", "variational_bayes"}

    Returns
    -------
    FirstConfig
        Its `text` is a YAML file with a comment on every line, its `config` what `surrogate.train`
        takes.

    Raises
    ------
    InputError
        If a reduced network is wanted, and the dataset does not name its material.
    """
    if not isinstance(dataset, Dataset):
        dataset = read_dataset(dataset, on_disk=True)
    mechanics = has_material(dataset)
    if model == "reduced" and not mechanics:
        raise InputError("model reduced: the dataset names no material, expected unet", "model")
    in_space = dataset.geometry.dimension == 3
    is_reduced = mechanics and (in_space or dataset.geometry.grid.is_a_row)
    chosen: Architecture = model or ("reduced" if is_reduced else "unet")
    channels = 32 if likelihood == "deterministic" and not in_space else 16
    available = SHARE * available_memory()
    while channels > 4:
        first = FirstConfig(dataset, chosen, likelihood, channels)
        config = first.config()
        assert isinstance(config, TrainedModel)
        if training_memory(config, dataset.geometry, first.batch) <= available:
            break
        channels //= 2
    return FirstConfig(dataset, chosen, likelihood, channels)


def find_data(target: str) -> Path:
    """Return the structured dataset of a folder or of a case.

    Raises
    ------
    InputError
        If there is none.
    """
    folder = Path(target)
    if (folder / MANIFEST).is_file():
        return folder
    name = read_yaml(folder).get("name", "") if folder.is_file() else target
    places = [folder / "structured", DATA / str(name) / "structured"]
    for place in places:
        if (place / MANIFEST).is_file():
            return place
    raise InputError(
        f"CASE|DATA '{target}': no structured dataset there or at {places[-1]}; expected one made "
        "by `datagen structure`"
    )
