"""From a body to a network that predicts in a millisecond, in about a minute: each step in one go.

Samples of the body's case (`surrogate.mechanics.sampling`) train a reduced network at the nodes;
those of them that it does not learn from calibrate its fast bounds and measure its errors. Each
step goes on where it was ended.
"""

from __future__ import annotations

import logging
import math
import time
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import torch

from shared_schema.common.arguments import checked_arguments
from shared_schema.common.command_line import laid_out
from shared_schema.common.errors import InputError
from shared_schema.common.files import require_writable
from surrogate.learning.data.dataset import Dataset
from surrogate.learning.data.joined_dataset import read_dataset
from surrogate.learning.data.samples import Samples
from surrogate.learning.evaluation.run_evaluation import evaluate
from surrogate.learning.inference.export import require_packages
from surrogate.learning.models.model import TrainedModel
from surrogate.learning.planning.trial_steps import DryRun, dry_run
from surrogate.learning.runs.config_reader import read_config
from surrogate.learning.runs.folder import RunFolder
from surrogate.learning.training.loop import train
from surrogate.mechanics.sampling.sampled_body import SampledBody
from surrogate.mechanics.sampling.sampling import sample
from surrogate.page.factory import run_datagen
from surrogate.page.page import write_page

logger = logging.getLogger(__name__)
SAMPLES = 500
FEWEST = 200  # samples, of which a tenth calibrates the bounds
RECIPE, INPUT_MODES, OUTPUT_MODES = "reduced-fast", 48, 96
CHANGES = "network.width=128", "training.batch_size=16"  # steps of a few milliseconds
HELD_OUT = "training.validation_fraction=0.05", "training.calibration_fraction=0.05"
TIMED = 16  # loads, after a first one, that the plan is made from
DRAWN = 128  # random samples that a step of the training is timed on


@dataclass(frozen=True)
class Plan:
    """What the steps take.

    Attributes
    ----------
    nodes, samples, workers : int
    began : float
        Seconds until a process has solved its first load.
    rate : float
        Loads a second of one process.
    steps : int
        Of the training.
    training : DryRun
        Some of these steps.
    """

    nodes: int
    samples: int
    workers: int
    began: float
    rate: float
    steps: int
    training: DryRun

    def __str__(self) -> str:
        return laid_out(self.rows())

    def rows(self) -> Iterator[tuple[str, str]]:
        """Yield names and values for a table."""
        rate, step = self.workers * self.rate, self.training.seconds
        sampling, training = self.began + self.samples / rate, self.steps * step
        yield "body", f"{self.nodes} nodes"
        yield "samples", f"{self.samples}, {rate:.3g}/s by {self.workers}: {sampling:.0f} s"
        what = f"{self.training.architecture}, {self.steps} steps of {1e3 * step:.2g} ms"
        yield "network", f"{what}: {training:.0f} s"
        yield "errors, bounds, page", "10 to 20 s for some thousands of nodes"


@checked_arguments
def network_of_body(
    body: str | Path, out: str | Path, *, samples: int = SAMPLES, workers: int = 1
) -> Path:
    """Make samples of a body, a reduced network, its errors, fast bounds and page, or go on.

    What the steps take is logged before.

    Parameters
    ----------
    body : str or Path
        A dataset of the body, such as the folder that `datagen body` makes.
    out : str or Path
        Folder for the datasets `samples` and `grid`, the run `network` and the page
        ``network.html``.
    samples : int
        Number of samples.
    workers : int
        Processes that make samples (`surrogate.sample`).

    Returns
    -------
    Path
        The run folder.

    Raises
    ------
    InputError
        If there is no such body, its case asks for what the learner does not solve, a number is
        wrong, a package or the program `datagen` is missing, or the folder belongs to another body.
    """
    folder, run = Path(out), RunFolder(Path(out) / "network")
    if samples < FEWEST:
        raise InputError(f"samples {samples}: expected {FEWEST} at least", "samples")
    require_packages("onnx")
    require_writable(folder)
    if not run.is_finished:
        for line in str(plan(Path(body), samples, workers)).splitlines():
            logger.info(line)
        sample(body, folder / "samples", samples, workers=workers)
        made = ("structure", folder / "samples", "--grid", "nodes", "--out", folder / "grid")
        run_datagen(*made)
    data = read_dataset(folder / "grid")
    train(configuration(data), data, run.folder)
    if not run.evaluation.is_file():
        evaluation = evaluate(run.folder, data, certify=True)
        evaluation.write()
        for line in evaluation.lines():
            logger.info(line)
    write_page(run.folder, folder / "network.html")
    return run.folder


def configuration(data: Dataset) -> TrainedModel:
    """The recipe for a dataset, with no more modes than a small body has."""
    most = int(data.geometry.movable.sum())
    modes = {"input_modes": INPUT_MODES, "output_modes": OUTPUT_MODES}
    limited = (f"network.{name}={min(count, most)}" for name, count in modes.items())
    config = read_config(RECIPE, changes=(*CHANGES, *HELD_OUT, *limited), data=data)
    assert isinstance(config, TrainedModel)
    return config


def plan(body: Path, samples: int, workers: int) -> Plan:
    """Solve some loads, and take some steps of the training with random samples."""
    before = time.perf_counter()
    sampled = SampledBody.read(body, samples)
    list(sampled.solved([0]))
    began = time.perf_counter()
    list(sampled.solved(range(1, 1 + TIMED)))
    rate = TIMED / (time.perf_counter() - began)
    data = read_dataset(body, needs_samples=False).at_nodes()
    config = configuration(data)
    shape = (2, DRAWN, data.geometry.dimension, *data.geometry.grid.mask.shape)
    fields = torch.randn(shape, generator=torch.Generator().manual_seed(0))
    training = config.training
    learned = samples * (1 - training.validation_fraction - training.calibration_fraction)
    return Plan(
        nodes=len(data.geometry.coordinates),
        samples=samples,
        workers=workers,
        began=began - before,
        rate=rate,
        steps=math.ceil(learned / training.batch_size) * training.epochs,
        training=dry_run(config, replace(data, train_in_memory=Samples(*fields))),
    )
