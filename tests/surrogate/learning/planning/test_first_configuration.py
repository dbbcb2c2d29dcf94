"""A first configuration for a dataset: valid, commented, of a size that fits."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
import torch

from shared_schema.common.errors import InputError
from surrogate.command_line import main
from surrogate.learning.data.dataset import Dataset
from surrogate.learning.models.network_model import training_memory
from surrogate.learning.models.reduced_model import ReducedModel
from surrogate.learning.models.unet_model import UNetModel
from surrogate.learning.planning import first_configuration as module
from surrogate.learning.planning.first_configuration import FirstConfig, first_config
from surrogate.learning.planning.trial_steps import dry_run
from surrogate.learning.runs.config_reader import read_config

CPU = torch.device("cpu")


def test_every_line_has_a_comment(dataset: Dataset) -> None:
    first = first_config(dataset)
    head, body = first.text().splitlines()[:2], first.text().splitlines()[2:]
    assert all(line.startswith("# ") for line in head)
    assert "32 nodes" in head[0]  # a grid of 8 × 4 points
    assert "8 × 4 points" in head[1]
    assert all(re.search(r":.* {2}# \w", line) for line in body)


def test_in_the_plane_and_in_space(dataset: Dataset, dataset_3d: Dataset) -> None:
    plane, space = first_config(dataset).config(), first_config(dataset_3d).config()
    assert isinstance(plane, UNetModel)
    assert plane.network.skip == "series"
    assert plane.network.levels == 3
    assert isinstance(space, ReducedModel)
    for config, samples in ((plane, dataset), (space, dataset_3d)):
        assert config.case == samples.manifest.name
        assert dry_run(config, samples, device="cpu").steps > 0


def test_nodes_in_a_row(dataset: Dataset, monkeypatch: pytest.MonkeyPatch) -> None:
    """Not on a grid, U-Nets are refused: `datagen structure --grid nodes` in the plane."""
    monkeypatch.setattr(type(dataset.geometry.grid), "is_a_row", True)
    assert isinstance(first_config(dataset).config(), ReducedModel)


@pytest.mark.parametrize("likelihood", ["maximum_likelihood", "variational_bayes"])
@pytest.mark.parametrize("model", ["unet", "reduced"])
def test_standard_deviations(dataset: Dataset, model: str, likelihood: str) -> None:
    options: dict[str, Any] = {"model": model, "likelihood": likelihood}
    config = first_config(dataset, **options).config()
    assert config.likelihood == likelihood
    assert config.predicts_std
    if isinstance(config, ReducedModel) and likelihood == "variational_bayes":
        assert config.ensemble == 4


@pytest.mark.parametrize(
    ("samples", "batch", "epochs"),
    [(5700, 32, 70), (1000, 16, 190), (300, 4, 160), (60, 4, 400), (100_000, 32, 20)],
)
def test_batches_and_epochs_follow_the_samples(
    dataset: Dataset, monkeypatch: pytest.MonkeyPatch, samples: int, batch: int, epochs: int
) -> None:
    """12 000 steps and 50 steps an epoch, unless that takes more than 400 epochs, or under 20."""
    monkeypatch.setattr(FirstConfig, "samples", samples)
    first = FirstConfig(dataset, "unet", "deterministic", 32)
    assert (first.batch, first.epochs) == (batch, epochs)


def test_less_memory_less_channels(dataset: Dataset, monkeypatch: pytest.MonkeyPatch) -> None:
    """The most channels, halved, whose training takes a quarter of what is free at most."""
    assert first_config(dataset).channels == 32
    monkeypatch.setattr(module, "available_memory", lambda: 8e6)
    first = first_config(dataset)
    twice = replace(first, channels=2 * first.channels)
    needed, more = (
        training_memory(config, dataset.geometry, first.batch)
        for config in (first.config(), twice.config())
        if isinstance(config, UNetModel)
    )
    assert first.channels < 32
    assert needed <= 2e6 < more


def test_without_a_material(dataset: Dataset) -> None:
    """Forces alone go in; a reduced network, which needs the material, is refused."""
    manifest = dataset.manifest.model_copy(update={"case": {"name": dataset.manifest.name}})
    bare = replace(dataset, manifest=manifest)
    config = first_config(bare).config()
    assert isinstance(config, UNetModel)
    assert not config.needs_material
    with pytest.raises(InputError, match="model reduced: the dataset names no material"):
        first_config(bare, model="reduced")


def test_command(
    data: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """By folder, and by the name of a case whose dataset is at data/CASE/structured."""
    monkeypatch.chdir(tmp_path)
    assert main(["init", str(data), "--out", "a.yaml"]) == 0
    assert "next: surrogate train a.yaml --data" in capsys.readouterr().out
    name = read_config("a.yaml").case
    (tmp_path / "data" / name).mkdir(parents=True)
    (tmp_path / "data" / name / "structured").symlink_to(data)
    Path("case.yaml").write_text(f"name: {name}\n")
    for number, target in enumerate((name, "case.yaml", f"data/{name}")):
        assert main(["init", target, "--out", f"{number}.yaml"]) == 0
        assert Path(f"{number}.yaml").read_text() == Path("a.yaml").read_text()
    for target, out, part in (
        (str(data), "a.yaml", "exists, expected a new file"),
        ("other", "b.yaml", "no structured dataset there or at data/other/structured"),
        (str(data), "b.txt", "expected a file name ending in .yaml"),
    ):
        assert main(["init", target, "--out", out]) == 2
        assert part in capsys.readouterr().err
