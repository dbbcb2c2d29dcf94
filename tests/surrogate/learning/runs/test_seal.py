"""The seal of a run folder: any changed byte of a finished file is found and the file is named."""

from __future__ import annotations

import json
import re
import shutil
from collections.abc import Callable
from pathlib import Path

import pytest
import torch

import surrogate
from shared_schema.common.errors import InputError
from shared_schema.common.files import sha256
from surrogate.command_line import main
from surrogate.learning.data.dataset import Dataset
from surrogate.learning.evaluation.run_report import write_report
from surrogate.learning.models.unet_model import UNetModel
from surrogate.learning.runs.folder import RunFolder
from surrogate.learning.runs.seal import Seal
from surrogate.learning.training.checkpoint import load_checkpoint
from surrogate.learning.training.loop import train
from surrogate.runtime.tensor_file import load_tensors, save_atomically

pytestmark = pytest.mark.faults

CPU = torch.device("cpu")
MakeConfig = Callable[..., UNetModel]


@pytest.fixture
def run(evaluated: Path, tmp_path: Path) -> RunFolder:
    """A copy of a trained and evaluated run."""
    shutil.copytree(evaluated, tmp_path / "run")
    return RunFolder(tmp_path / "run")


def read_everything(run: RunFolder) -> None:
    run.metric_lines()
    surrogate.load(run.folder)
    write_report(run.folder, run.folder / "a.html")


def test_all_finished_files_are_listed(run: RunFolder) -> None:
    found = {p.relative_to(run.folder).as_posix() for p in run.folder.rglob("*") if p.is_file()}
    assert run.seal.files().keys() == found - {"manifest.json", "checkpoint/last.safetensors"}


@pytest.mark.parametrize(
    ("file", "old", "new"),
    [
        ("config.yaml", b"padding: 1", b"padding: 2"),
        ("config.yaml", b"dropout: 0.0", b"dropout: 0.1"),
        ("config.yaml", b"activation: relu", b"activation: silu"),
        ("metrics.jsonl", b'"epoch": 1', b'"epoch": 7'),
        ("hardware.txt", b"1 thread", b"7 thread"),
        ("manifest.json", b'"version": 1', b'"version":  1'),
        ("evaluation.json", b'"case": "beam2d"', b'"case": "beam3d"'),
        ("figures/errors.png", b"IHDR", b"IHDS"),
        ("model.safetensors", b"free", b"fref"),
    ],
)
def test_a_changed_character_is_found(run: RunFolder, file: str, old: bytes, new: bytes) -> None:
    path = run.folder / file
    content = path.read_bytes()
    assert old in content
    path.write_bytes(content.replace(old, new, 1))
    with pytest.raises(InputError, match=f"{file}: (damaged|line)"):
        read_everything(run)


def test_a_damaged_finished_run_is_not_called_trained(
    run: RunFolder, dataset: Dataset, make_config: MakeConfig
) -> None:
    content = bytearray(run.model.read_bytes())
    content[-9] ^= 1
    run.model.write_bytes(content)
    for sealed in (True, False):
        if not sealed:
            run.seal.path.unlink()
        with pytest.raises(InputError, match=r"model\.safetensors: damaged"):
            train(make_config(epochs=40), dataset, run.folder, device="cpu")


def test_a_model_that_is_not_listed_is_not_finished(
    run: RunFolder, dataset: Dataset, make_config: MakeConfig
) -> None:
    """The state after a kill between the model and the manifest; the next `train` repairs it."""
    expected = run.model.read_bytes()
    run.seal.withdraw([run.model])
    run.model.write_bytes(b"")
    with pytest.raises(InputError, match="the run is not finished"):
        surrogate.load(run.folder)
    train(make_config(epochs=40), dataset, run.folder, device="cpu")
    assert run.model.read_bytes() == expected
    surrogate.load(run.folder)


@pytest.mark.parametrize("content", ["", "[]", "{}", '{"version": 1, "files": 3}', "9" * 5000])
def test_another_manifest_is_refused(run: RunFolder, content: str) -> None:
    run.seal.path.write_text(content)
    with pytest.raises(InputError, match=r"manifest\.json: "):
        surrogate.load(run.folder)


@pytest.mark.parametrize("file", ["hardware.txt", "figures/deformed.png"])
def test_a_missing_file_is_named(run: RunFolder, file: str) -> None:
    (run.folder / file).unlink()
    with pytest.raises(InputError, match=f"{file}: no such file"):
        read_everything(run)


def test_runs_of_earlier_versions_are_read_and_said_to_be_unsealed(
    run: RunFolder, data: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    predicted = surrogate.load(run.folder).predict([[0.0, 0.0]] * 31 + [[0.5, 1.0]])
    run.seal.path.unlink()
    again = surrogate.load(run.folder).predict([[0.0, 0.0]] * 31 + [[0.5, 1.0]])
    assert (again == predicted).all()
    folder, page = str(run.folder), str(tmp_path / "a.html")
    commands = [
        ["evaluate", folder, "--data", str(data), "--device", "cpu"],
        ["report", folder, "--out", page],
        ["predict", folder, "--load", "3.5,1.5:0,1", "--out", str(tmp_path / "u.npz")],
    ]
    for command in commands:
        assert main(command) == 0
        assert f"surrogate: warning: {folder}: unsealed, " in capsys.readouterr().err
    assert not run.seal.exists


def test_a_run_without_an_epoch_gives_way(
    tmp_path: Path, dataset: Dataset, make_config: MakeConfig
) -> None:
    """A configuration that diverges at once does not bind the folder."""
    run = RunFolder(tmp_path / "run")
    wrong = make_config().model_copy(update={"seed": 7})
    for config in (wrong, make_config(epochs=1)):
        with pytest.MonkeyPatch.context() as patch:
            if config is wrong:
                patch.setattr("surrogate.learning.training.loop.all_finite", lambda _: False)
                with pytest.raises(Exception, match="diverged in epoch 1"):
                    train(config, dataset, run.folder, device="cpu")
            else:
                train(config, dataset, run.folder, device="cpu")
    assert run.description().run.seed == 0


@pytest.mark.parametrize(
    "status", ["[]", "{}", "3", '{"epoch": "x"}', '{"epoch": -1, "seconds": 1}']
)
def test_other_json_in_a_checkpoint_is_refused(
    tmp_path: Path, dataset: Dataset, make_config: MakeConfig, status: str
) -> None:
    run = RunFolder(tmp_path / "run")
    train(make_config(), dataset, run.folder, device="cpu", stop_after=1)
    tensors, _ = load_tensors(run.checkpoint)
    content = run.checkpoint.read_bytes()
    assert content.count(b'epoch\\": 1') == 1
    run.checkpoint.write_bytes(content.replace(b'epoch\\": 1', b'epoch\\": 2'))
    with pytest.raises(InputError, match=r"last\.safetensors: damaged"):
        load_checkpoint(run.checkpoint, {}, [])
    save_atomically(tensors, run.checkpoint, {"status": status})
    with pytest.raises(InputError, match="not a checkpoint of this run"):
        load_checkpoint(run.checkpoint, {}, [])


def test_seal_of_no_files_is_not_a_missing_one(tmp_path: Path) -> None:
    seal = Seal(tmp_path)
    assert seal.files() == {}
    seal.add([tmp_path / "a"])  # unsealed folders stay so
    assert not seal.exists
    seal.make()
    assert seal.exists
    assert json.loads(seal.path.read_text())["files"] == {}


@pytest.mark.parametrize("sealed", [True, False])
@pytest.mark.parametrize("file", ["config.yaml", "model.safetensors", "manifest.json"])
def test_links_in_a_run_are_refused(run: RunFolder, file: str, sealed: bool) -> None:
    """A run folder may itself be a link; what is in it is not."""
    (run.folder.parent / "link").symlink_to(run.folder)
    surrogate.load(run.folder.parent / "link")
    if not sealed and file != "manifest.json":
        run.seal.path.unlink()
    path = run.folder / file
    path.rename(run.folder.parent / "elsewhere")
    path.symlink_to(run.folder.parent / "elsewhere")
    with pytest.raises(InputError, match=f"{file}: a symbolic link, expected the file itself"):
        surrogate.load(run.folder)


def test_weights_larger_than_the_memory(run: RunFolder) -> None:
    """A file of 8 TiB, none of which is on the disk."""
    with run.model.open("r+b") as file:
        file.truncate(1 << 43)
    with pytest.raises(InputError, match=r"model\.safetensors: the file: needs 8.19e\+03 GiB"):
        run.read_tensors()


@pytest.mark.parametrize("name", ["../secret.txt", "figures/../../secret.txt", "/etc/hostname"])
def test_a_manifest_that_lists_a_file_elsewhere_is_refused(run: RunFolder, name: str) -> None:
    """Whoever writes a manifest can also write its digest; nothing outside the folder is read."""
    secret = run.folder / name
    if secret.is_relative_to(run.folder):
        secret.write_text("secret")
    run.seal._write(run.seal.files() | {name: sha256(secret)})
    outside = f"manifest.json: lists {secret}: outside of {run.folder}, expected a file in it"
    for read in (surrogate.load, lambda folder: RunFolder(folder).seal.require_intact()):
        with pytest.raises(InputError, match=re.escape(outside)):
            read(run.folder)


def test_element_that_is_seen_in_many_places(tmp_path: Path) -> None:
    """An array of one element counts as contiguous with whatever stride."""
    given = {"one": torch.zeros(()).expand(1), "many": torch.ones(1).expand(3)}
    assert given["one"].stride() == (0,)
    save_atomically(given, tmp_path / "file.safetensors")
    read, _ = load_tensors(tmp_path / "file.safetensors")
    torch.testing.assert_close(read, given)
