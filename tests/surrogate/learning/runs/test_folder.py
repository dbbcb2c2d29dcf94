from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest
import torch

from shared_schema.common.errors import InputError
from surrogate.learning.data.dataset import Dataset
from surrogate.learning.models.unet_model import UNetModel
from surrogate.learning.runs.description import describe
from surrogate.learning.runs.folder import RunFolder, first_difference
from surrogate.runtime.tensor_file import save_atomically


def test_start_and_take_up_again(
    tmp_path: Path, dataset: Dataset, make_config: Callable[..., UNetModel]
) -> None:
    description = describe(make_config(), dataset)
    run = RunFolder(tmp_path / "a" / "run")
    run.start(description)
    assert run.description() == description
    run.start(description)
    assert sorted(path.name for path in run.folder.iterdir()) == ["config.yaml", "manifest.json"]
    run.write_tensors({"x": torch.ones(2)})
    with pytest.raises(InputError, match=r"another run\.seed = 3, the folder has 0"):
        run.start(describe(make_config().model_copy(update={"seed": 3}), dataset))


@pytest.mark.parametrize("kind", ["file", "folder"])
def test_foreign_content_is_kept(
    tmp_path: Path, dataset: Dataset, make_config: Callable[..., UNetModel], kind: str
) -> None:
    path = tmp_path / "run"
    if kind == "folder":
        path.mkdir()
    kept = path / "notes.txt" if kind == "folder" else path
    kept.write_text("mine")
    with pytest.raises(InputError, match="holds something else"):
        RunFolder(path).start(describe(make_config(), dataset))
    assert kept.read_text() == "mine"


def test_first_difference() -> None:
    old = {"a": {"b": 1, "c": [1, 2]}, "d": None}
    assert first_difference(old, {"a": {"b": 1, "c": [1]}, "d": None}) == (
        "a.c = [1], the folder has [1, 2]"
    )
    assert first_difference(old, {"a": old["a"], "d": 2}) == "d = 2, the folder has None"
    assert first_difference(old, {**old, "e": 5}) == "e = 5, the folder has None"


def test_no_run_and_damaged_configuration(tmp_path: Path) -> None:
    run = RunFolder(tmp_path)
    with pytest.raises(InputError, match="no run there"):
        run.description()
    run.config.write_text("run: {}")
    with pytest.raises(InputError, match=r"config\.yaml: key 'run.name' is missing"):
        run.description()


def test_failed_save_keeps_the_old_file(tmp_path: Path) -> None:
    path = tmp_path / "a" / "x.safetensors"
    save_atomically({"x": torch.ones(2)}, path)
    before = path.read_bytes()
    with pytest.raises((TypeError, ValueError, AttributeError)):
        save_atomically({"x": "no tensor"}, path)  # type: ignore[dict-item]
    assert path.read_bytes() == before
    assert list(path.parent.iterdir()) == [path]
