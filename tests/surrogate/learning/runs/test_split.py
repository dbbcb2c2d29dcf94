from __future__ import annotations

from collections.abc import Callable

import pytest
import torch

from shared_schema.common.errors import InputError
from surrogate.learning.data.dataset import Dataset
from surrogate.learning.models.unet_model import UNetModel
from surrogate.learning.runs.split import split_training

MakeConfig = Callable[..., UNetModel]


def test_parts_are_disjoint_and_whole(dataset: Dataset, make_config: MakeConfig) -> None:
    """A fifth of 48 samples is 9.6, rounded to 10; a tenth is 4.8, rounded to 5."""
    config = make_config(validation_fraction=0.2, calibration_fraction=0.1)
    parts = split_training(dataset.train, config)
    counts = [len(part) for part in (parts.train, parts.validation, parts.calibration)]
    assert counts == [33, 10, 5]
    rows = torch.cat((parts.train.force, parts.validation.force, parts.calibration.force))
    expected = dataset.train.force.flatten(1).tolist()
    assert sorted(rows.flatten(1).tolist()) == sorted(expected)


def test_parts_follow_from_the_seed(dataset: Dataset, make_config: MakeConfig) -> None:
    config = make_config(validation_fraction=0.2, calibration_fraction=0.1)
    first, again = (split_training(dataset.train, config) for _ in range(2))
    other = split_training(dataset.train, config.model_copy(update={"seed": 1}))
    for name in ("train", "validation", "calibration"):
        force = getattr(first, name).force
        assert torch.equal(force, getattr(again, name).force)
        assert not torch.equal(force[:5], getattr(other, name).force[:5])


def test_validation_does_not_depend_on_calibration(
    dataset: Dataset, make_config: MakeConfig
) -> None:
    with_it, without = (
        split_training(
            dataset.train, make_config(validation_fraction=0.2, calibration_fraction=fraction)
        ).validation
        for fraction in (0.1, 0.0)
    )
    assert torch.equal(with_it.force, without.force)


def test_nothing_left_to_train_on(dataset: Dataset, make_config: MakeConfig) -> None:
    config = make_config(validation_fraction=0.5, calibration_fraction=0.5)
    with pytest.raises(
        InputError,
        match=r"'training.validation_fraction' = 0.5, 'training.calibration_fraction' = 0.5 leave "
        "none of 48 samples",
    ):
        split_training(dataset.train, config)


def test_number_of_samples(dataset: Dataset, make_config: MakeConfig) -> None:
    """A fifth of the first 20 samples is 4, a tenth 2."""
    fractions = {"validation_fraction": 0.2, "calibration_fraction": 0.1}
    parts = split_training(dataset.train, make_config(samples=20, **fractions))
    counts = [len(part) for part in (parts.train, parts.validation, parts.calibration)]
    assert counts == [14, 4, 2]
    rows = torch.cat((parts.train.force, parts.validation.force, parts.calibration.force))
    expected = dataset.train.force[:20].flatten(1).tolist()
    assert sorted(rows.flatten(1).tolist()) == sorted(expected)
    with pytest.raises(InputError, match=r"'training\.samples' = 49: expected 48 at most"):
        split_training(dataset.train, make_config(samples=49))


@pytest.mark.parametrize("option", [{"recalibrate": True}, {"early_stopping": {"patience": 2}}])
def test_no_validation_samples(
    dataset: Dataset, make_config: MakeConfig, option: dict[str, object]
) -> None:
    config = make_config(likelihood="maximum_likelihood", validation_fraction=0.01, **option)
    with pytest.raises(
        InputError, match=f"takes none of 48 samples, but 'training.{next(iter(option))}'"
    ):
        split_training(dataset.train, config)
