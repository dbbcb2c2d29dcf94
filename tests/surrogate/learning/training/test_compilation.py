from __future__ import annotations

from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import pytest
import torch
from safetensors.torch import load_file

from shared_schema.common.errors import WorkError
from surrogate.learning.data.dataset import Dataset
from surrogate.learning.models.model import Model
from surrogate.learning.models.unet_model import UNetModel
from tests.surrogate.resuming import trained

MakeConfig = Callable[..., UNetModel]


@pytest.fixture
def _traced(monkeypatch: pytest.MonkeyPatch) -> None:
    """Compile without the last stage, the C++ compiler, which takes a minute."""
    monkeypatch.setattr(torch, "compile", partial(torch.compile, backend="aot_eager"))


def assert_trains_as_the_plain_one(config: Model, dataset: Dataset, folder: Path) -> None:
    compiled = config.training.model_copy(update={"compile": True})
    plain = trained(config, dataset, folder / "plain")
    fast = trained(config.model_copy(update={"training": compiled}), dataset, folder / "compiled")
    for line, expected in zip(fast.metric_lines(), plain.metric_lines(), strict=True):
        for name in ("train_loss", "validation_loss", "validation_error"):
            assert line[name] == pytest.approx(expected[name], rel=1e-4), name
    assert set(load_file(fast.checkpoint)) == set(load_file(plain.checkpoint))


@pytest.mark.slow
@pytest.mark.usefixtures("_traced")
def test_compiled_network_trains_as_the_plain_one(
    tmp_path: Path, dataset: Dataset, make_config: MakeConfig
) -> None:
    """Losses agree to float32 round-off, also with a smaller last batch; names are the same."""
    assert_trains_as_the_plain_one(make_config(epochs=2), dataset, tmp_path)


@pytest.mark.slow
def test_compiled_to_machine_code(
    tmp_path: Path, dataset: Dataset, make_config: MakeConfig
) -> None:
    """One batch holds all 43 training samples, so that only one shape is compiled."""
    config = make_config(epochs=2, batch_size=43)
    assert_trains_as_the_plain_one(config, dataset, tmp_path)


@pytest.mark.slow
@pytest.mark.usefixtures("_traced")
def test_compiled_variational_network(
    tmp_path: Path, dataset: Dataset, make_config: MakeConfig
) -> None:
    """With very small standard deviations, noise has no effect, so that the losses agree."""
    lines = []
    for compiled in (False, True):
        config = make_config(
            epochs=2,
            likelihood="variational_bayes",
            variational={"initial_std": 1e-5, "kl_divergence": "sampled"},
            compile=compiled,
        )
        lines.append(trained(config, dataset, tmp_path / str(compiled)).metric_lines())
    for line, expected in zip(*lines, strict=True):
        assert line["negative_log_likelihood"] == pytest.approx(
            expected["negative_log_likelihood"], rel=1e-3
        )


def test_failed_compilation_is_one_line(
    tmp_path: Path, dataset: Dataset, make_config: MakeConfig, monkeypatch: pytest.MonkeyPatch
) -> None:
    from torch._dynamo.exc import TorchDynamoException

    def compile_nothing(network: torch.nn.Module, dynamic: bool) -> Callable[..., Any]:
        def forward(_: torch.Tensor) -> None:
            raise TorchDynamoException("InvalidCxxCompiler: no compiler\nand much more")

        return forward

    monkeypatch.setattr(torch, "compile", compile_nothing)
    with pytest.raises(WorkError) as error:
        trained(make_config(compile=True), dataset, tmp_path / "run")
    assert str(error.value) == "key 'training.compile' = True: InvalidCxxCompiler: no compiler"
